// SPDX-License-Identifier: Apache-2.0
#include "client/cli/frame_choice.h"

#include <algorithm>
#include <utility>

namespace holdfast {

FrameChoice::FrameChoice(int64_t first, int64_t every, std::set<int64_t> queried)
    : first_(first), every_(every), queried_(std::move(queried)) {}

bool FrameChoice::Wants(int64_t frame) const { return IsRegular(frame) || IsQueried(frame); }

int64_t FrameChoice::After(int64_t frame) const {
  if (frame < first_) return first_;
  const int64_t regular = frame + every_ - (frame - first_) % every_;
  const auto queried = queried_.upper_bound(frame);
  return queried == queried_.end() ? regular : std::min(regular, *queried);
}

int64_t FrameChoice::CountOf(int64_t frames) const {
  if (frames <= first_) return 0;
  int64_t count = (frames - first_ + every_ - 1) / every_;
  for (const int64_t frame : queried_) count += frame < frames && !IsRegular(frame) ? 1 : 0;
  return count;
}

}  // namespace holdfast
