// SPDX-License-Identifier: Apache-2.0
#include "client/track_command.h"

#include <algorithm>
#include <map>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "client/atomic_file.h"
#include "client/progress.h"
#include "client/track_table.h"
#include "client/track_writer.h"
#include "client/video.h"

namespace holdfast {
namespace {

Progress::Options ProgressOptions(const TrackOptions& options, const FrameSource& source, bool terminal) {
  Progress::Options progress;
  progress.terminal = terminal;
  progress.total = source.frames();
  if (options.max_frames > 0 && (progress.total == 0 || progress.total > options.max_frames)) {
    progress.total = options.max_frames;
  }
  progress.now = [] { return absl::Now(); };
  return progress;
}

// One session from the first frame to the written files. The main thread reads and sends frames and paints; the
// tracker's thread delivers estimates.
class TrackRun final : public TrackObserver {
 public:
  TrackRun(const TrackOptions& options, const TrackEnvironment& environment, FrameSource& source,
           const std::vector<StartPoint>& points)
      : options_(options),
        environment_(environment),
        source_(source),
        encoder_(source.size(), options.max_side, options.jpeg_quality),
        facts_{source.size(), source.fps()},
        overlay_(options.overlay, facts_),
        table_(points),
        progress_(ProgressOptions(options, source, environment.terminal), environment.log) {
    for (const StartPoint& point : points) starts_[point.frame].push_back(encoder_.ToSent(point.query));
  }

  absl::Status Run(PointTracker& tracker) {
    absl::Status status = Track(tracker);
    if (environment_.stop.stopped()) status = absl::CancelledError("interrupted");
    if (!status.ok() && NothingFinal()) return status;
    const absl::Status written = WriteFiles();
    return status.ok() ? written : status;
  }

  void OnTracks(TrackUpdate update) override {
    for (PointRun& run : update.runs) encoder_.FromSent(run);
    absl::MutexLock lock(&mutex_);
    if (broken_.ok()) broken_ = table_.Apply(update);
    processed_ = std::max(processed_, update.frames_processed);
    progress_.Update(processed_, sent_ - processed_);
  }

  void OnWarning(const absl::Status& warning) override {
    absl::MutexLock lock(&mutex_);
    environment_.log << "warning: " << warning.message() << "\n";
  }

  void OnDone(const absl::Status&, const SessionSummary&) override {}  // Finish returns it as well

 private:
  absl::Status Track(PointTracker& tracker) {
    auto stream = tracker.Open(Config(), *this);
    if (!stream.ok()) return stream.status();
    environment_.stop.SetCallback([&stream] { (*stream)->Cancel(); });
    absl::Status status = PushFrames(**stream);
    if (status.ok()) status = (*stream)->Finish();
    environment_.stop.SetCallback(nullptr);
    return status.ok() ? Broken() : status;
  }

  SessionConfig Config() {
    SessionConfig config;
    config.encoding = FrameEncoding::kJpeg;
    config.processing_size = options_.processing_size;
    config.hop_frames = options_.hop_frames;
    config.iterations = options_.iterations;
    config.send_provisional = false;  // files hold final estimates alone
    config.points = PointsOf(0);
    config.label = "holdfast track";
    return config;
  }

  std::vector<PointQuery> PointsOf(int64_t frame) const {
    const auto found = starts_.find(frame);
    return found == starts_.end() ? std::vector<PointQuery>() : found->second;
  }

  absl::Status PushFrames(TrackStream& stream) {
    for (int64_t i = 0; options_.max_frames == 0 || i < options_.max_frames; ++i) {
      if (environment_.stop.stopped()) return absl::CancelledError("interrupted");
      const absl::StatusOr<cv::Mat> picture = source_.Next();
      if (!picture.ok()) return picture.status();
      if (picture->empty()) break;
      absl::Status status = overlay_.Add(*picture);
      if (status.ok()) status = PushFrame(stream, i, *picture);
      if (status.ok()) status = AfterFrame();
      if (!status.ok()) return status;
    }
    return absl::OkStatus();
  }

  absl::Status PushFrame(TrackStream& stream, int64_t index, const cv::Mat& picture) {
    absl::StatusOr<std::string> bytes = encoder_.Encode(picture);
    if (!bytes.ok()) return bytes.status();
    Frame frame;
    frame.index = index;
    frame.bytes = *std::move(bytes);
    if (index > 0) frame.points = PointsOf(index);  // those of frame 0 are in the config
    return stream.PushFrame(std::move(frame));
  }

  absl::Status AfterFrame() {
    absl::MutexLock lock(&mutex_);
    progress_.Update(processed_, ++sent_ - processed_);
    return broken_.ok() ? overlay_.Paint(table_) : broken_;
  }

  absl::Status Broken() {
    absl::MutexLock lock(&mutex_);
    return broken_;
  }

  bool NothingFinal() {
    absl::MutexLock lock(&mutex_);
    progress_.Close();
    return table_.final_frames() == 0;
  }

  absl::Status WriteFiles() {
    absl::MutexLock lock(&mutex_);
    progress_.Close();
    WarnOfLatePoints();
    absl::Status status = overlay_.Paint(table_);
    if (status.ok()) status = overlay_.Close();
    if (status.ok() && !options_.out.empty()) status = WriteTracks(options_.out, table_, facts_);
    if (!status.ok()) return status;
    environment_.log << absl::StrFormat("%d points, final on %d of %d frames sent\n", table_.tracks().size(),
                                        table_.final_frames(), sent_);
    for (const std::string& path : {options_.out, options_.overlay.video, options_.overlay.still}) {
      if (!path.empty()) environment_.log << "wrote " << path << "\n";
    }
    return absl::OkStatus();
  }

  void WarnOfLatePoints() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    size_t late = 0;
    for (auto it = starts_.lower_bound(sent_); it != starts_.end(); ++it) late += it->second.size();
    if (late == 0) return;
    environment_.log << "warning: " << late << " points start after the last frame and were not tracked\n";
  }

  const TrackOptions& options_;
  const TrackEnvironment& environment_;
  FrameSource& source_;
  const FrameEncoder encoder_;
  const VideoFacts facts_;
  std::map<int64_t, std::vector<PointQuery>> starts_;  // by frame, pixels of the sent frames
  OverlayVideo overlay_;                               // of the main thread

  absl::Mutex mutex_;
  TrackTable table_ ABSL_GUARDED_BY(mutex_);
  Progress progress_ ABSL_GUARDED_BY(mutex_);
  int64_t sent_ ABSL_GUARDED_BY(mutex_) = 0;       // frames
  int64_t processed_ ABSL_GUARDED_BY(mutex_) = 0;  // frames
  absl::Status broken_ ABSL_GUARDED_BY(mutex_);    // the tracker's answers contradict the session
};

absl::Status CheckOutputs(const TrackOptions& options) {
  for (const std::string& path : {options.out, options.overlay.video, options.overlay.still}) {
    const absl::Status writable = path.empty() ? absl::OkStatus() : CheckWritable(path);
    if (!writable.ok()) return writable;
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status TrackOptions::Validate() const {
  if (out.empty() && !overlay.wanted()) {
    return absl::InvalidArgumentError("nothing to write: give --out, --overlay or --still");
  }
  if (!out.empty() && !TrackFormatOf(out).ok()) return TrackFormatOf(out).status();
  if (absl::Status status = overlay.Validate(); !status.ok()) return status;
  if (absl::Status status = points.Validate(); !status.ok()) return status;
  if (jpeg_quality < 1 || jpeg_quality > 100) return absl::InvalidArgumentError("--jpeg_quality: expected 1..100");
  if (max_side < 0 || (max_side > 0 && max_side < 32)) {
    return absl::InvalidArgumentError("--max_side: expected 0 or at least 32");
  }
  if (max_frames < 0) return absl::InvalidArgumentError("--max_frames: expected 0 or more");
  if (hop_frames < 0) return absl::InvalidArgumentError("--hop: expected 0 or more");
  if (iterations < 0) return absl::InvalidArgumentError("--iterations: expected 0 or more");
  return absl::OkStatus();
}

absl::Status RunTrack(const TrackOptions& options, const TrackEnvironment& environment) {
  const absl::Status outputs = CheckOutputs(options);
  if (!outputs.ok()) return outputs;
  const auto source = FrameSource::Open(options.input);
  if (!source.ok()) return source.status();
  auto points = CollectPoints(options.points, (*source)->size());
  if (!points.ok()) return points.status();
  const auto tracker = environment.connect();
  if (!tracker.ok()) return tracker.status();
  TrackRun run(options, environment, **source, *points);
  return run.Run(**tracker);
}

}  // namespace holdfast
