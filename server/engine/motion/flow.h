// SPDX-License-Identifier: Apache-2.0
// Classical optical flow (pyramidal Lucas-Kanade) on grey pictures: pure functions of pictures and points. A point's
// result depends on the pictures and on that point alone, whatever other points are asked for in the same call. Knows
// no sessions and no windows; OpenCV stays behind this header. Safe to call from several threads.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/types/span.h"
#include "api/types.h"

namespace holdfast {

struct GrayImage {
  ImageSize size;
  std::vector<uint8_t> pixels;  // [height, width]
};

// A picture that belongs to another object. Of a picture that is not there the size is empty.
struct GrayView {
  ImageSize size;
  const uint8_t* pixels = nullptr;
  int stride = 0;  // from one row to the next
};

// The size in which frames are looked at, of a frame's own shape: what turns in it is not sheared. What is lost by
// processing a large frame at a small size is found again here: it keeps its own size up to the area of 1.5 times the
// processing size each way, and twice its larger side. A frame of fewer pixels than are processed is enlarged to as
// many.
ImageSize FlowSize(ImageSize frame, ImageSize processing);

// Pixels of a picture that are 'of_512' pixels of one whose longer side is 512, in which limits are given.
inline float FlowPixels(float of_512, ImageSize picture) {
  return of_512 * static_cast<float>(std::max(picture.width, picture.height)) / 512;
}

struct FlowPoint {  // pixels of the grey picture; (0, 0) is the centre of the first one
  float x = 0;
  float y = 0;
};

// A grey picture and its halvings, made once for all points. Immutable.
class FlowPyramid {
 public:
  explicit FlowPyramid(const GrayImage& image);
  ~FlowPyramid();
  FlowPyramid(const FlowPyramid&) = delete;
  FlowPyramid& operator=(const FlowPyramid&) = delete;

  ImageSize size() const { return size_; }
  GrayImage picture() const;  // a copy of what it was made of
  GrayView half() const;      // smoothed, every second pixel; tiny pictures have none
  int64_t bytes() const { return BytesOf(size_); }
  // Of the pyramid of a picture of this size.
  static int64_t BytesOf(ImageSize size);
  // The most that the pyramid of any frame takes.
  static int64_t MostBytes(ImageSize processing);

  struct Levels;
  const Levels& levels() const { return *levels_; }

 private:
  const ImageSize size_;
  const std::unique_ptr<const Levels> levels_;
};
using FlowPyramidPtr = std::shared_ptr<const FlowPyramid>;

struct FlowStep {
  FlowPoint at;
  bool held = false;  // false: the point was not found again, and 'at' is where it came from
};

// Carries points from one picture to the next. A point counts as found when the way back ends within 'max_round_trip'
// pixels of where it came from.
std::vector<FlowStep> CarryPoints(const FlowPyramid& from, const FlowPyramid& to, absl::Span<const FlowPoint> points,
                                  float max_round_trip);

// A place where a point was found again, and how well. All of it is finite.
struct FlowMatch {
  FlowPoint at;
  float round_trip = 0;  // pixels from where the point came to where the way back ends
  float move = 0;        // pixels from where the search began
  float difference = 0;  // of the two patches: mean absolute difference of grey levels
};

// As CarryPoints, but looks near 'starts' only; empty where nothing is found.
std::vector<std::optional<FlowMatch>> FollowPoints(const FlowPyramid& from, const FlowPyramid& to,
                                                   absl::Span<const FlowPoint> points,
                                                   absl::Span<const FlowPoint> starts);

// The surroundings of a point in the halved picture, cut out so that they can be looked for in pictures to come without
// the picture they are from. Its pixels are those that come back from its code, so that a patch that was kept as code
// finds the same.
struct FlowPatch {
  static constexpr int kSide = 28;
  // Grey values that differ as much as they can take less.
  static constexpr size_t kMaxCodeBytes = size_t{3} * kSide * kSide;
  // With more code than pictures usually make.
  static constexpr int64_t kBytes = int64_t{kSide} * kSide + 512;

  FlowPoint at;                 // within the patch; in the middle, but for points beyond the picture
  std::string code;             // of the pixels (patch_coding.h)
  std::vector<uint8_t> pixels;  // [kSide, kSide]

  GrayView view() const { return {{kSide, kSide}, pixels.data(), kSide}; }
};
// Of a tiny picture, which is not halved, a blank one.
FlowPatch CutPatch(const FlowPyramid& picture, FlowPoint at);
// From what was kept of a patch; empty where 'code' is none.
std::optional<FlowPatch> ReadPatch(FlowPoint at, std::string code);

}  // namespace holdfast
