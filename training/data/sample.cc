// SPDX-License-Identifier: Apache-2.0
#include "training/data/sample.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

absl::Status Broken(const Sample& sample, absl::string_view what) {
  return absl::InternalError(absl::StrCat("sample of '", sample.source, "': ", what));
}

absl::Status ValidateImages(const Sample& sample) {
  if (sample.frames.empty()) return Broken(sample, "no frames");
  for (const cv::Mat& frame : sample.frames) {
    if (frame.type() != CV_8UC3 || frame.empty()) return Broken(sample, "a frame is not 8-bit RGB");
    if (frame.size() != sample.frames[0].size()) return Broken(sample, "frames differ in size");
  }
  if (sample.has_masks() && sample.masks.size() != sample.frames.size()) return Broken(sample, "a mask is missing");
  for (const cv::Mat& mask : sample.masks) {
    if (mask.type() != CV_32SC1) return Broken(sample, "a mask is not 32-bit ids");
    if (mask.size() != sample.frames[0].size()) return Broken(sample, "a mask differs in size from the frames");
  }
  return absl::OkStatus();
}

// The rows of 'values' (width values each) at 'points' of every frame.
template <typename T>
std::vector<T> Gather(const std::vector<T>& values, int64_t frames, int64_t old_points, int64_t width,
                      const std::vector<int64_t>& points) {
  std::vector<T> out;
  out.reserve(static_cast<size_t>(frames * width) * points.size());
  for (int64_t s = 0; s < frames; ++s) {
    for (const int64_t n : points) {
      const auto from = values.begin() + (s * old_points + n) * width;
      out.insert(out.end(), from, from + width);
    }
  }
  return out;
}

}  // namespace

int64_t Sample::QueryFrame(int64_t point) const {
  for (int64_t s = 0; s < num_frames(); ++s) {
    if (Valid(s, point) && Visible(s, point)) return s;
  }
  return -1;
}

int32_t Sample::IdAt(int64_t frame, cv::Point2f xy) const {
  if (!has_masks()) return 0;
  const cv::Mat& mask = masks[static_cast<size_t>(frame)];
  // Compared as floats first: a wild position must not overflow the conversion.
  if (!(xy.x > -0.5f && xy.y > -0.5f && xy.x < mask.cols - 0.5f && xy.y < mask.rows - 0.5f)) return 0;
  return mask.at<int32_t>(static_cast<int>(std::lround(xy.y)), static_cast<int>(std::lround(xy.x)));
}

void Sample::AllocatePoints(int64_t points) {
  const size_t cells = frames.size() * static_cast<size_t>(points);
  tracks.assign(2 * cells, 0.f);
  visible.assign(cells, 0);
  valid.assign(cells, 0);
  hidden.clear();
  object_ids.assign(static_cast<size_t>(points), 0);
}

void Sample::SetHidden(int64_t frame, int64_t point) {
  hidden.resize(valid.size(), 0);
  hidden[At(frame, point)] = 1;
}

void Sample::SelectPoints(const std::vector<int64_t>& points) {
  tracks = Gather(tracks, num_frames(), num_points(), 2, points);
  visible = Gather(visible, num_frames(), num_points(), 1, points);
  valid = Gather(valid, num_frames(), num_points(), 1, points);
  if (!hidden.empty()) hidden = Gather(hidden, num_frames(), num_points(), 1, points);
  object_ids = Gather(object_ids, 1, num_points(), 1, points);
}

absl::Status Sample::Validate() const {
  const absl::Status images = ValidateImages(*this);
  if (!images.ok()) return images;
  const size_t cells = frames.size() * object_ids.size();
  if (tracks.size() != 2 * cells || visible.size() != cells || valid.size() != cells) {
    return Broken(*this, absl::StrCat("tracks, visible and valid do not have ", num_frames(), " x ", num_points()));
  }
  if (!hidden.empty() && hidden.size() != cells) return Broken(*this, "hidden has another size than valid");
  if (!std::all_of(tracks.begin(), tracks.end(), [](float v) { return std::isfinite(v); })) {
    return Broken(*this, "a position is not finite");
  }
  for (int64_t s = 0; s < num_frames(); ++s) {
    for (int64_t n = 0; n < num_points(); ++n) {
      if (Visible(s, n) && !(Valid(s, n) && Inside(Position(s, n)))) {
        return Broken(*this, absl::StrCat("point ", n, " is visible in frame ", s, " but not valid or not inside"));
      }
      if (!hidden.empty() && hidden[At(s, n)] != 0 && Valid(s, n)) {
        return Broken(*this, absl::StrCat("point ", n, " is valid in frame ", s, " and hidden nobody knows where"));
      }
    }
  }
  return absl::OkStatus();
}

}  // namespace holdfast
