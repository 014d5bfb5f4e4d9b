// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/lk_baseline.h"

#include <limits>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

// Points of one frame, in processing pixels.
struct Cloud {
  std::vector<cv::Point2f> xy;  // [N]
  std::vector<uint8_t> seen;    // [N]
};

class LucasKanade final : public ClipTracker {
 public:
  explicit LucasKanade(const LucasKanadeOptions& options) : options_(options) {}

  std::string name() const override {
    return absl::StrCat("lucas-kanade (window ", options_.window, ", ", options_.levels, " levels)");
  }

  absl::StatusOr<ClipEstimate> Track(const Sample& clip, const std::vector<int64_t>& query_frames) override {
    try {
      return TrackClip(clip, query_frames);
    } catch (const cv::Exception& error) {
      return absl::InternalError(absl::StrCat("optical flow: ", error.what()));
    }
  }

 private:
  ClipEstimate TrackClip(const Sample& clip, const std::vector<int64_t>& query_frames) const {
    ClipEstimate estimate;
    estimate.processing_size = options_.processing_size.empty() ? clip.size() : options_.processing_size;
    estimate.positions.assign(clip.tracks.size(), std::numeric_limits<float>::quiet_NaN());
    estimate.visible.assign(clip.visible.size(), 0);
    const cv::Point2f scale(static_cast<float>(estimate.processing_size.width) / clip.size().width,
                            static_cast<float>(estimate.processing_size.height) / clip.size().height);
    Cloud cloud{std::vector<cv::Point2f>(query_frames.size()), std::vector<uint8_t>(query_frames.size())};
    std::vector<cv::Mat> before;
    for (int64_t frame = 0; frame < clip.num_frames(); ++frame) {
      std::vector<cv::Mat> now = Pyramid(clip.frames[frame], estimate.processing_size);
      if (frame > 0) Advance(before, now, frame, query_frames, cloud);
      for (int64_t n = 0; n < clip.num_points(); ++n) {
        if (query_frames[n] > frame) continue;
        if (query_frames[n] == frame) {
          const cv::Point2f query = clip.Position(frame, n);
          cloud.xy[n] = {query.x * scale.x, query.y * scale.y};
          cloud.seen[n] = 1;
        }
        const size_t at = clip.At(frame, n);
        estimate.positions[2 * at] = cloud.xy[n].x / scale.x;
        estimate.positions[2 * at + 1] = cloud.xy[n].y / scale.y;
        estimate.visible[at] = cloud.seen[n];
      }
      before = std::move(now);
    }
    return estimate;
  }

  std::vector<cv::Mat> Pyramid(const cv::Mat& frame, ImageSize size) const {
    cv::Mat gray;
    cv::cvtColor(frame, gray, cv::COLOR_RGB2GRAY);
    if (gray.cols != size.width || gray.rows != size.height) {
      cv::resize(gray, gray, cv::Size(size.width, size.height), 0, 0, cv::INTER_AREA);
    }
    std::vector<cv::Mat> pyramid;
    cv::buildOpticalFlowPyramid(gray, pyramid, Window(), options_.levels);
    return pyramid;
  }

  // Moves the points queried before 'frame' from the frame before to this one.
  void Advance(const std::vector<cv::Mat>& before, const std::vector<cv::Mat>& now, int64_t frame,
               const std::vector<int64_t>& query_frames, Cloud& cloud) const {
    std::vector<size_t> ids;
    std::vector<cv::Point2f> from;
    for (size_t n = 0; n < query_frames.size(); ++n) {
      if (query_frames[n] >= frame) continue;
      ids.push_back(n);
      from.push_back(cloud.xy[n]);
    }
    if (ids.empty()) return;
    std::vector<cv::Point2f> to;
    std::vector<cv::Point2f> back;
    std::vector<uint8_t> found;
    std::vector<uint8_t> found_back;
    cv::calcOpticalFlowPyrLK(before, now, from, to, found, cv::noArray(), Window(), options_.levels);
    cv::calcOpticalFlowPyrLK(now, before, to, back, found_back, cv::noArray(), Window(), options_.levels);
    for (size_t i = 0; i < ids.size(); ++i) {
      if (found[i]) cloud.xy[ids[i]] = to[i];
      cloud.seen[ids[i]] = found[i] && found_back[i] && cv::norm(back[i] - from[i]) <= options_.max_round_trip_px;
    }
  }

  cv::Size Window() const { return {options_.window, options_.window}; }

  const LucasKanadeOptions options_;
};

}  // namespace

absl::Status LucasKanadeOptions::Validate() const {
  if (processing_size.width < 0 || processing_size.height < 0 || processing_size.width > 16384 ||
      processing_size.height > 16384 || (processing_size.width == 0) != (processing_size.height == 0)) {
    return absl::InvalidArgumentError("lucas-kanade: processing_size must be empty or within 16384x16384");
  }
  if (window < 3 || levels < 0 || levels > 10 || max_round_trip_px < 0) {
    return absl::InvalidArgumentError("lucas-kanade: window >= 3, levels in 0..10 and max_round_trip_px >= 0 expected");
  }
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<ClipTracker>> CreateLucasKanade(const LucasKanadeOptions& options) {
  if (absl::Status status = options.Validate(); !status.ok()) return status;
  return std::make_unique<LucasKanade>(options);
}

}  // namespace holdfast
