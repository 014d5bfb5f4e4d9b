// SPDX-License-Identifier: Apache-2.0
// One clip with its ground truth: what every dataset gives and every consumer (trainer, evaluator) takes.
// Letters: S frames, N points, H W image. Pixel (0, 0) is the centre of the first pixel; x right, y down.
#pragma once

#include <opencv2/core.hpp>

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "api/types.h"

namespace holdfast {

struct Sample {
  std::vector<cv::Mat> frames;      // S x [H, W] CV_8UC3, **RGB**
  std::vector<float> tracks;        // [S, N, 2] (x, y), pixels; always finite; any value where not valid
  std::vector<uint8_t> visible;     // [S, N] 0 or 1; 1 implies valid and inside the frame
  std::vector<uint8_t> valid;       // [S, N] 0 or 1: the label can be trusted, visible or not
  std::vector<uint8_t> hidden;      // [S, N] 1: not valid, but known to be hidden. Empty: nothing of the kind is known
  std::vector<int32_t> object_ids;  // [N] mask id of the object the point lies on; 0: none or unknown
  std::vector<cv::Mat> masks;       // S x [H, W] CV_32SC1, object ids; 0: unlabelled. Empty: the source has no masks
  std::string source;               // data set and sequence, for reports
  double fps = 0;                   // of the source; 0: unknown

  int64_t num_frames() const { return static_cast<int64_t>(frames.size()); }
  int64_t num_points() const { return static_cast<int64_t>(object_ids.size()); }
  bool has_masks() const { return !masks.empty(); }
  ImageSize size() const { return frames.empty() ? ImageSize{} : ImageSize{frames[0].cols, frames[0].rows}; }

  // Place of (frame, point) in 'visible' and 'valid'; twice that in 'tracks'.
  size_t At(int64_t frame, int64_t point) const { return static_cast<size_t>(frame * num_points() + point); }
  bool Visible(int64_t frame, int64_t point) const { return visible[At(frame, point)] != 0; }
  bool Valid(int64_t frame, int64_t point) const { return valid[At(frame, point)] != 0; }
  cv::Point2f Position(int64_t frame, int64_t point) const {
    const size_t at = 2 * At(frame, point);
    return {tracks[at], tracks[at + 1]};
  }
  void SetPosition(int64_t frame, int64_t point, cv::Point2f xy) {
    const size_t at = 2 * At(frame, point);
    tracks[at] = xy.x;
    tracks[at + 1] = xy.y;
  }
  bool Inside(cv::Point2f xy) const {
    return xy.x >= 0 && xy.y >= 0 && xy.x <= static_cast<float>(size().width - 1) &&
           xy.y <= static_cast<float>(size().height - 1);
  }

  // First frame in which the point is valid and visible ("query-first"); -1: never.
  int64_t QueryFrame(int64_t point) const;
  // Mask id under the nearest pixel; 0 outside the frame, without masks or where unlabelled.
  int32_t IdAt(int64_t frame, cv::Point2f xy) const;

  // Gives N x S arrays of zeros; frames must be there.
  void AllocatePoints(int64_t points);
  // Says that a point is hidden and nobody knows where.
  void SetHidden(int64_t frame, int64_t point);
  // Keeps the given points, in the given order.
  void SelectPoints(const std::vector<int64_t>& points);

  // Everything the comments above promise about sizes, types and values; INTERNAL names what is broken.
  absl::Status Validate() const;
};

}  // namespace holdfast
