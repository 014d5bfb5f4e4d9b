// SPDX-License-Identifier: Apache-2.0
#include "server/engine/tracks/window.h"

namespace holdfast {

std::optional<WindowPlan> WindowSchedule::Next(int64_t newest, bool ended) const {
  // Full windows first, also after the end: a last one is only for frames that no full one reaches.
  const WindowPlan full = Full();
  // The point may be queried anew at the newest frame, which then is not this track's: one that would make that frame
  // final waits for the next.
  const bool waits = full.final_before > full.last && !ended;
  if (newest >= full.last + (waits ? 1 : 0)) return full;
  if (ended) {
    if (newest <= covered_) return std::nullopt;  // only the query's frame, or a window ended exactly here
    return began() ? Shifted(newest) : First(WindowKind::kLast, newest);
  }
  // Until the first full window a viewer would wait for options_.frames frames; early ones answer every hop, as full
  // ones do later, and each begins at the query again.
  if (!options_.early || began()) return std::nullopt;
  const int64_t frames = (newest - query_ + 1) / options_.hop * options_.hop;
  if (frames < 2 || query_ + frames - 1 <= covered_) return std::nullopt;
  return First(WindowKind::kEarly, query_ + frames - 1);
}

void WindowSchedule::Ran(const WindowPlan& plan) {
  covered_ = plan.last;
  if (plan.kind == WindowKind::kFull) next_start_ += options_.hop;
}

WindowPlan WindowSchedule::First(WindowKind kind, int64_t last) const {
  const int64_t final_before = kind == WindowKind::kLast ? last + 1 : query_ + 1;
  return {kind, query_, last, /*from_query=*/true, final_before};
}

WindowPlan WindowSchedule::Full() const {
  // The next window keeps its first frame. A last window may begin as early as one frame after this one and revise
  // what follows its own first frame.
  const int64_t kept = options_.revise_last ? next_start_ + 1 : next_start_ + options_.hop;
  return {WindowKind::kFull, next_start_, next_start_ + options_.frames - 1, !began(), kept + 1};
}

// A full window moved back until it ends with the video, not a short one: the network was trained on full ones, and the
// frames it sees again are in the cache.
WindowPlan WindowSchedule::Shifted(int64_t last) const {
  return {WindowKind::kLast, last - options_.frames + 1, last, /*from_query=*/false, last + 1};
}

}  // namespace holdfast
