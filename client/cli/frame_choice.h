// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <set>

namespace holdfast {

// Which frames of the input are tracked: the 'first' one, from there on every 'every'-th, and those that points start
// on, wherever they lie: a position is true on its own frame only. Frames have the numbers of the input.
class FrameChoice {
 public:
  // REQUIRES: first >= 0, every > 0; no point starts before 'first'.
  FrameChoice(int64_t first, int64_t every, std::set<int64_t> queried);

  int64_t first() const { return first_; }
  bool Wants(int64_t frame) const;
  // Whether points start there. Such a frame is tracked whatever has to be left out.
  bool IsQueried(int64_t frame) const { return queried_.count(frame) > 0; }
  // The next frame that is tracked behind 'frame', where there are so many.
  int64_t After(int64_t frame) const;
  // How many of the frames 0 .. frames - 1 are tracked.
  int64_t CountOf(int64_t frames) const;

 private:
  bool IsRegular(int64_t frame) const { return frame >= first_ && (frame - first_) % every_ == 0; }

  const int64_t first_;
  const int64_t every_;
  const std::set<int64_t> queried_;
};

}  // namespace holdfast
