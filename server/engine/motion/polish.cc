// SPDX-License-Identifier: Apache-2.0
#include "server/engine/motion/polish.h"

#include <optional>

namespace holdfast {
namespace {

// When a place found near an estimate is better than the estimate. Pixels of a frame 512 wide; chosen on annotated real
// video.
struct Limits {
  float round_trip = 0;  // the way back ends within so many pixels
  float move = 0;        // and the place is within so many pixels of the estimate
  float difference = 0;  // and the patches differ by less, a mean absolute difference of grey levels
};
// The patch of the query does not drift, but turned, scaled or elsewhere in a repeated texture it is found next to its
// place: it comes first where hardly anything has changed, and last where it is only similar.
constexpr Limits kSameAsQuery = {0.3f, 10, 8};
constexpr Limits kFromBefore = {1, 20, 30};
constexpr Limits kLikeQuery = {0.7f, 10, 20};

bool Within(const std::optional<FlowMatch>& match, const Limits& limits, int width) {
  const float scale = static_cast<float>(width) / 512;
  return match && match->round_trip <= limits.round_trip * scale && match->move <= limits.move * scale &&
         match->difference < limits.difference;
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

// The point of that frame is where it was found, if it was, 'how'; the search in the next frame goes on from there.
void MoveTo(const Place& place, const std::optional<FlowMatch>& match, Evidence::Polish how) {
  PolishTrack& track = *place.track;
  if (match) track.positions[place.at] = match->at;
  track.previous = track.positions[place.at];
  track.outcomes[place.at] = match ? how : Evidence::Polish::kNotFound;
}

// A visible position that the query's patch does not decide.
struct Open {
  Place place;
  FlowPoint from;  // polished, on the frame before
  FlowPoint estimate;
  std::optional<FlowMatch> like_query;  // what is left if the frame before does not help
};

void DecideFromBefore(absl::Span<const Open> open, const FlowPyramid& before, const FlowPyramid& now) {
  std::vector<FlowPoint> from, estimates;
  for (const Open& point : open) {
    from.push_back(point.from);
    estimates.push_back(point.estimate);
  }
  const auto found = FollowPoints(before, now, from, estimates);
  for (size_t i = 0; i < open.size(); ++i) {
    if (Within(found[i], kFromBefore, now.size().width)) {
      MoveTo(open[i].place, found[i], Evidence::Polish::kFromBefore);
    } else {
      MoveTo(open[i].place, open[i].like_query, Evidence::Polish::kFromQuery);
    }
  }
}

}  // namespace

void PolishFrame(absl::Span<PolishTrack> tracks, int64_t frame, const FlowPyramid& before, const FlowPyramid& now) {
  std::vector<Open> open;
  for (const Place& place : PlacesOn(tracks, frame)) {
    PolishTrack& track = *place.track;
    track.outcomes.resize(place.at + 1, Evidence::Polish::kNotTried);
    if (!track.visible[place.at]) {
      track.previous.reset();
      continue;
    }
    const FlowPoint estimate = track.positions[place.at];
    std::optional<FlowMatch> match;
    if (track.patch != nullptr) match = FindPatch(*track.patch, now, estimate);
    const bool same = Within(match, kSameAsQuery, now.size().width);
    if (!Within(match, kLikeQuery, now.size().width)) match.reset();
    if (same || !track.previous) {
      MoveTo(place, match, Evidence::Polish::kFromQuery);
    } else {
      open.push_back({place, *track.previous, estimate, match});
    }
  }
  DecideFromBefore(open, before, now);
}

}  // namespace holdfast
