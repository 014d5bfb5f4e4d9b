// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/stream_clip_tracker.h"

#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

// Writes the final part of every run into a ClipEstimate. Its calls end before Finish() or the stream's destructor
// return, so that the estimate needs no lock.
class FinalEstimates final : public TrackObserver {
 public:
  explicit FinalEstimates(const Sample& clip) : frames_(clip.num_frames()), points_(clip.num_points()) {
    estimate_.positions.assign(clip.tracks.size(), std::numeric_limits<float>::quiet_NaN());
    estimate_.visible.assign(clip.visible.size(), 0);
    estimate_.confidence.assign(clip.visible.size(), 0);
  }

  void OnAccepted(const SessionAccepted& accepted) override { estimate_.processing_size = accepted.processing_size; }
  void OnTracks(TrackUpdate update) override {
    for (const PointRun& run : update.runs) Take(run);
  }
  void OnDone(const absl::Status&, const SessionSummary&) override {}

  absl::StatusOr<ClipEstimate> Result(const std::vector<int64_t>& query_frames) {
    if (!stray_.ok()) return stray_;
    for (int64_t n = 0; n < points_; ++n) {
      for (int64_t frame = query_frames[n]; frame < frames_; ++frame) {
        if (std::isfinite(estimate_.positions[2 * (frame * points_ + n)])) continue;
        return absl::InternalError(absl::StrCat("no final estimate of point ", n, " in frame ", frame));
      }
    }
    return std::move(estimate_);
  }

 private:
  void Take(const PointRun& run) {
    const int64_t end = run.first_frame + run.final_count;
    if (run.id >= static_cast<PointId>(points_) || run.first_frame < 0 || end > frames_) {
      stray_ = absl::InternalError(absl::StrCat("an estimate of point ", run.id, " in frames ", run.first_frame, "..",
                                                end - 1, ", which are not of this clip"));
      return;
    }
    for (int64_t i = 0; i < run.final_count; ++i) {
      const size_t at = (run.first_frame + i) * points_ + run.id;
      estimate_.positions[2 * at] = run.x[i];
      estimate_.positions[2 * at + 1] = run.y[i];
      estimate_.visible[at] = run.visible[i];
      estimate_.confidence[at] = run.confidence[i];
    }
  }

  const int64_t frames_;
  const int64_t points_;
  ClipEstimate estimate_;
  absl::Status stray_;
};

std::string RawBytes(const cv::Mat& image) {
  const cv::Mat rows = image.isContinuous() ? image : image.clone();
  return std::string(reinterpret_cast<const char*>(rows.data), rows.total() * rows.elemSize());
}

Frame MakeFrame(const Sample& clip, int64_t index, const std::vector<int64_t>& query_frames) {
  Frame frame;
  frame.index = index;
  frame.bytes = RawBytes(clip.frames[index]);
  for (int64_t n = 0; n < clip.num_points(); ++n) {
    if (query_frames[n] != index) continue;
    const cv::Point2f xy = clip.Position(index, n);
    frame.points.push_back({static_cast<PointId>(n), xy.x, xy.y});
  }
  return frame;
}

}  // namespace

StreamClipTracker::StreamClipTracker(PointTracker& tracker, StreamClipTrackerOptions options)
    : tracker_(tracker), options_(std::move(options)) {}

absl::StatusOr<ClipEstimate> StreamClipTracker::Track(const Sample& clip, const std::vector<int64_t>& query_frames) {
  SessionConfig config;
  config.encoding = FrameEncoding::kRgb24;
  config.raw_size = clip.size();
  config.processing_size = options_.processing_size;
  config.hop_frames = options_.hop_frames;
  config.iterations = options_.iterations;
  config.send_provisional = false;
  FinalEstimates estimates(clip);
  if (options_.iterations_taken) options_.iterations_taken();  // those of the clip before
  absl::StatusOr<std::unique_ptr<TrackStream>> stream = tracker_.Open(config, estimates);
  if (!stream.ok()) return stream.status();
  for (int64_t index = 0; index < clip.num_frames(); ++index) {
    absl::Status pushed = (*stream)->PushFrame(MakeFrame(clip, index, query_frames));
    if (!pushed.ok()) return pushed;
  }
  if (absl::Status finished = (*stream)->Finish(); !finished.ok()) return finished;
  absl::StatusOr<ClipEstimate> estimate = estimates.Result(query_frames);
  if (estimate.ok() && options_.iterations_taken) estimate->iterations = options_.iterations_taken();
  return estimate;
}

}  // namespace holdfast
