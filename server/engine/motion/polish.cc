// SPDX-License-Identifier: Apache-2.0
#include "server/engine/motion/polish.h"

#include <cstdlib>

namespace holdfast {
namespace {

// Chosen on annotated real video; pixels of a frame 512 wide.
FlowLimits FromQuery() { return {0.7f, 10, 20}; }
FlowLimits FromBefore() { return {0.5f, 10, 20}; }

FlowLimits AtWidth(FlowLimits limits, int width) {
  const float scale = static_cast<float>(width) / 512;
  return {limits.round_trip * scale, limits.move * scale, limits.difference};
}

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

// Moves the point of that frame to where it was found, if it was; the search in the next frame goes on from there.
// 'how' it was found.
void MoveTo(const Place& place, std::optional<FlowPoint> found, Evidence::Polish how) {
  PolishTrack& track = *place.track;
  if (found) track.positions[place.at] = *found;
  track.previous = track.positions[place.at];
  track.outcomes[place.at] = found ? how : Evidence::Polish::kNotFound;
}

}  // namespace

void PolishFrame(absl::Span<PolishTrack> tracks, int64_t frame, const FlowPyramid& before, const FlowPyramid& now) {
  std::vector<Place> left;
  std::vector<FlowPoint> from, starts;
  for (const Place& place : PlacesOn(tracks, frame)) {
    PolishTrack& track = *place.track;
    track.outcomes.resize(place.at + 1, Evidence::Polish::kNotTried);
    const FlowPoint estimate = track.positions[place.at];
    if (!track.visible[place.at]) {
      track.previous.reset();
      continue;
    }
    std::optional<FlowPoint> found;
    if (track.patch != nullptr) {
      found = FindPatch(*track.patch, now, estimate, AtWidth(FromQuery(), now.size().width));
    }
    if (found || !track.previous) {
      MoveTo(place, found, Evidence::Polish::kFromQuery);
      continue;
    }
    left.push_back(place);
    from.push_back(*track.previous);
    starts.push_back(estimate);
  }
  const auto found = FollowPoints(before, now, from, starts, AtWidth(FromBefore(), now.size().width));
  for (size_t i = 0; i < left.size(); ++i) MoveTo(left[i], found[i], Evidence::Polish::kFromBefore);
}

}  // namespace holdfast
