// SPDX-License-Identifier: Apache-2.0
#include "server/engine/motion/polish.h"

#include <cmath>
#include <optional>

#include "server/engine/motion/alignment.h"

namespace holdfast {
namespace {

// When a place found near an estimate is better than the estimate: limits in pixels of a frame 512 wide, chosen on
// annotated real video.
// From the frame before: the way back ends where it began, the place is near, and the patches differ by less, a mean
// absolute difference of grey levels.
constexpr float kRoundTrip = 1;
constexpr float kMove = 20;
constexpr float kDifference = 30;
// From the query: what is as much alike is hardly another place.
constexpr float kLeastCorrelation = 0.85f;
constexpr float kQueryMove = 10;

// Where a position is on one frame.
struct Place {
  PolishTrack* track = nullptr;
  size_t at = 0;
};

std::vector<Place> PlacesOn(absl::Span<PolishTrack> tracks, int64_t frame) {
  std::vector<Place> places;
  for (PolishTrack& track : tracks) {
    const int64_t at = frame - track.first;
    if (at >= 0 && at < static_cast<int64_t>(track.positions.size())) places.push_back({&track, size_t(at)});
  }
  return places;
}

// The point of that frame is at 'position', found so; the search in the next frame goes on from there.
void Settle(const Place& place, FlowPoint position, Evidence::Polish how) {
  PolishTrack& track = *place.track;
  track.positions[place.at] = position;
  track.previous = position;
  track.outcomes[place.at] = how;
}

FlowPoint EstimateAt(const Place& place) { return place.track->positions[place.at]; }

// False: the surroundings of the query are not there, about as they were last.
bool SettleByQuery(const Place& place, FlowPoint start, const FlowPyramid& now) {
  PolishTrack& track = *place.track;
  if (track.patch == nullptr) return false;
  const std::optional<Alignment> found = AlignPatch(*track.patch, now, start, track.deformation);
  if (!found || found->correlation < kLeastCorrelation) return false;
  if (std::hypot(found->at.x - start.x, found->at.y - start.y) > FlowPixels(kQueryMove, now.size())) return false;
  track.deformation = found->deformation;
  Settle(place, found->at, Evidence::Polish::kFromQuery);
  return true;
}

// Where the positions of the frame before lead to, where they lead anywhere.
std::vector<std::optional<FlowPoint>> LeadFromBefore(absl::Span<const Place> places, const FlowPyramid& before,
                                                     const FlowPyramid& now) {
  std::vector<FlowPoint> from, estimates;
  std::vector<size_t> known;
  for (size_t i = 0; i < places.size(); ++i) {
    if (!places[i].track->previous) continue;
    known.push_back(i);
    from.push_back(*places[i].track->previous);
    estimates.push_back(EstimateAt(places[i]));
  }
  const float round_trip = FlowPixels(kRoundTrip, now.size()), move = FlowPixels(kMove, now.size());
  const auto found = FollowPoints(before, now, from, estimates);
  std::vector<std::optional<FlowPoint>> led(places.size());
  for (size_t i = 0; i < known.size(); ++i) {
    const std::optional<FlowMatch>& match = found[i];
    if (match && match->round_trip <= round_trip && match->move <= move && match->difference < kDifference) {
      led[known[i]] = match->at;
    }
  }
  return led;
}

}  // namespace

void PolishFrame(absl::Span<PolishTrack> tracks, int64_t frame, const FlowPyramid& before, const FlowPyramid& now) {
  std::vector<Place> open;
  for (const Place& place : PlacesOn(tracks, frame)) {
    PolishTrack& track = *place.track;
    track.outcomes.resize(place.at + 1, Evidence::Polish::kNotTried);
    if (!track.visible[place.at]) {
      track.previous.reset();
    } else if (!SettleByQuery(place, EstimateAt(place), now)) {
      open.push_back(place);
    }
  }
  const std::vector<std::optional<FlowPoint>> led = LeadFromBefore(open, before, now);
  for (size_t i = 0; i < open.size(); ++i) {
    if (!led[i]) {
      Settle(open[i], EstimateAt(open[i]), Evidence::Polish::kNotFound);
    } else if (!SettleByQuery(open[i], *led[i], now)) {
      Settle(open[i], *led[i], Evidence::Polish::kFromBefore);
    }
  }
}

}  // namespace holdfast
