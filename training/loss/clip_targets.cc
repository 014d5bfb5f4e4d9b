// SPDX-License-Identifier: Apache-2.0
#include "training/loss/clip_targets.h"

#include <algorithm>
#include <cstring>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

// Images of one size, rows copied one by one: a picture may be a view into a larger one.
torch::Tensor StackImages(const std::vector<cv::Mat>& images, const std::vector<int64_t>& shape,
                          torch::ScalarType dtype) {
  torch::Tensor stack = torch::empty(shape, dtype);
  char* to = static_cast<char*>(stack.data_ptr());
  for (const cv::Mat& image : images) {
    const size_t row_bytes = image.cols * image.elemSize();
    for (int y = 0; y < image.rows; ++y, to += row_bytes) std::memcpy(to, image.ptr(y), row_bytes);
  }
  return stack;
}

// [S, N] flags -> [N, S] bool
torch::Tensor Flags(const std::vector<uint8_t>& flags, int64_t frames, int64_t points) {
  torch::Tensor tensor = torch::empty({frames, points}, torch::kUInt8);
  std::copy(flags.begin(), flags.end(), tensor.data_ptr<uint8_t>());
  return tensor.t().contiguous().to(torch::kBool);
}

}  // namespace

ClipTensors ClipTensors::To(const torch::Device& device) const {
  ClipTensors out = {frames.to(device),
                     {targets.tracks.to(device), targets.visible.to(device), targets.valid.to(device), {}}};
  if (targets.masks.defined()) out.targets.masks = targets.masks.to(device);
  return out;
}

absl::StatusOr<ClipTensors> ToTensors(const Sample& sample, int64_t stride) {
  const absl::Status valid = sample.Validate();
  if (!valid.ok()) return valid;
  const int64_t s = sample.num_frames(), n = sample.num_points();
  const int64_t h = sample.size().height, w = sample.size().width;
  if (n == 0) return absl::InvalidArgumentError(absl::StrCat("a clip of '", sample.source, "' has no points"));
  if (h % stride != 0 || w % stride != 0) {
    return absl::InvalidArgumentError(absl::StrCat("a clip of '", sample.source, "' is ", w, " x ", h,
                                                   " pixels; both must be multiples of ", stride));
  }
  torch::Tensor tracks = torch::empty({s, n, 2});
  std::copy(sample.tracks.begin(), sample.tracks.end(), tracks.data_ptr<float>());
  ClipTensors clip;
  clip.frames = StackImages(sample.frames, {s, h, w, 3}, torch::kUInt8);
  clip.targets = {tracks.transpose(0, 1).contiguous(), Flags(sample.visible, s, n), Flags(sample.valid, s, n), {}};
  if (sample.has_masks()) clip.targets.masks = StackImages(sample.masks, {s, h, w}, torch::kInt32);
  return clip;
}

}  // namespace holdfast
