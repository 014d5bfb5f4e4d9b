// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_command.h"

#include <algorithm>
#include <map>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "absl/synchronization/mutex.h"
#include "api/clock.h"
#include "client/cli/answer_times.h"
#include "client/cli/frame_reader.h"
#include "client/cli/progress.h"
#include "client/cli/track_extent.h"
#include "client/cli/track_lines.h"
#include "client/cli/track_table.h"
#include "client/cli/track_writer.h"
#include "client/cli/video.h"
#include "io/atomic_file.h"

namespace holdfast {
namespace {

absl::Status ReaderIsGone() { return absl::DataLossError("standard output takes no more lines"); }

int64_t TotalFrames(const TrackOptions& options, const FrameSource& source) {
  if (options.max_frames == 0) return source.frames();
  return source.frames() == 0 ? options.max_frames : std::min(source.frames(), options.max_frames);
}

// One session from the first frame to the written files. The main thread reads and sends frames and paints; the
// tracker's thread delivers estimates.
class TrackRun final : public TrackObserver {
 public:
  TrackRun(const TrackOptions& options, const TrackEnvironment& environment, std::unique_ptr<FrameSource> source,
           const std::vector<StartPoint>& points)
      : options_(options),
        environment_(environment),
        encoder_(source->size(), options.max_side, options.jpeg_quality),
        facts_{source->size(), source->fps()},
        total_frames_(TotalFrames(options, *source)),
        reader_(std::move(source)),
        overlay_(options.overlay, facts_),
        answers_([] { return SystemClock().SteadyNow(); }),
        table_(points),
        progress_({environment.terminal, total_frames_, [] { return SystemClock().SteadyNow(); }}, environment.log) {
    if (options.lines()) lines_.emplace(points, environment.out);
    for (const StartPoint& point : points) starts_[point.frame].push_back(encoder_.ToSent(point.query));
  }

  absl::Status Run(PointTracker& tracker) {
    auto stream = tracker.Open(Config(), *this);
    if (!stream.ok()) return stream.status();
    const absl::Status status = Track(**stream);
    stream->reset();  // no answer comes any more
    const absl::Status written = WriteFiles(status.ok());
    environment_.stop.SetCallback(nullptr);
    if (status.ok()) return written;
    if (!written.ok()) environment_.log << "warning: " << written.message() << "\n";
    return status;
  }

  void OnTracks(TrackUpdate update) override {
    for (PointRun& run : update.runs) encoder_.FromSent(run);
    absl::MutexLock lock(&mutex_);
    // The frame that is just being sent is not counted yet.
    if (broken_.ok() && update.frames_received > sent_ + 1) {
      broken_ = absl::InternalError(
          absl::StrCat("the tracker speaks of ", update.frames_received, " frames after ", sent_, " were sent"));
    }
    if (broken_.ok()) broken_ = table_.Apply(update);
    if (broken_.ok() && lines_ && !lines_->Write(update)) broken_ = ReaderIsGone();
    processed_ = std::max(processed_, update.frames_processed);
    const int64_t answered = answers_.Answered(update);
    const int64_t done = options_.live ? answered : processed_;
    progress_.Update(done, sent_ - done);
  }

  void OnWarning(const absl::Status& warning) override {
    absl::MutexLock lock(&mutex_);
    environment_.log << "warning: " << warning.message() << "\n";
  }

  void OnReconnecting(const absl::Status& lost) override {
    absl::MutexLock lock(&mutex_);
    progress_.Interrupt();
    environment_.log << absl::StripPrefix(lost.message(), "holdfast: ") << "; reconnecting\n" << std::flush;
  }

  void OnResumed(const SessionAccepted& accepted) override {
    absl::MutexLock lock(&mutex_);
    environment_.log << "resumed at frame " << accepted.first_frame << " on " << accepted.server << "\n" << std::flush;
  }

  // Finish returns the status as well. Nobody waits for the input of a session that is over.
  void OnDone(const absl::Status&, const SessionSummary&) override { reader_.Stop(); }

 private:
  absl::Status Track(TrackStream& stream) {
    environment_.stop.SetCallback([this, &stream] {
      stream.Cancel();
      reader_.Stop();
    });
    absl::Status status = PushFrames(stream);
    if (status.ok()) status = stream.Finish();
    // The stream goes away, and files are written whether an interrupt comes or not; a second one ends the program.
    environment_.stop.SetCallback([] {});
    if (!status.ok() && environment_.stop.stopped()) return absl::CancelledError("interrupted");
    if (!input_error_.ok()) return input_error_;
    return status.ok() ? CheckAnswers() : status;
  }

  SessionConfig Config() {
    SessionConfig config;
    config.encoding = FrameEncoding::kJpeg;
    config.processing_size = options_.processing_size;
    config.hop_frames = options_.hop_frames;
    config.iterations = options_.iterations;
    config.send_provisional = true;  // kept where the session ends before they are final
    config.emit = options_.live ? Emit::kEveryFrame : Emit::kWindows;
    config.points = PointsOf(0);
    config.frames_per_second = options_.promise_fps;
    config.label = "holdfast track";
    if (options_.promise_fps > 0) {
      absl::MutexLock lock(&mutex_);
      config.expected_points = static_cast<int>(table_.tracks().size());
    }
    return config;
  }

  std::vector<PointQuery> PointsOf(int64_t frame) const {
    const auto found = starts_.find(frame);
    return found == starts_.end() ? std::vector<PointQuery>() : found->second;
  }

  // An error is one of the session. One of the input ends the input: the tracker still finishes what it has.
  absl::Status PushFrames(TrackStream& stream) {
    for (int64_t i = 0; options_.max_frames == 0 || i < options_.max_frames; ++i) {
      absl::StatusOr<Frame> frame = NextFrame(i);
      if (absl::IsCancelled(frame.status())) break;  // the session is over, Finish knows why
      if (!frame.ok()) input_error_ = frame.status();
      if (!frame.ok() || frame->bytes.empty()) break;
      answers_.Sent();
      absl::Status status = stream.PushFrame(*std::move(frame));
      if (status.ok()) status = AfterFrame();
      if (!status.ok()) return status;
    }
    return absl::OkStatus();
  }

  // Without bytes at the end of the input.
  absl::StatusOr<Frame> NextFrame(int64_t index) {
    Frame frame;
    const absl::StatusOr<cv::Mat> picture = reader_.Next();
    if (!picture.ok()) return picture.status();
    if (picture->empty()) return frame;
    const absl::Status held = overlay_.Add(*picture);
    if (!held.ok()) return held;
    absl::StatusOr<std::string> bytes = encoder_.Encode(*picture);
    if (!bytes.ok()) return bytes.status();
    frame.index = index;
    frame.bytes = *std::move(bytes);
    if (index > 0) frame.points = PointsOf(index);  // those of frame 0 are in the config
    return frame;
  }

  absl::Status AfterFrame() {
    absl::MutexLock lock(&mutex_);
    ++sent_;
    const int64_t done = options_.live ? answers_.answered() : processed_;
    progress_.Update(done, sent_ - done);
    return broken_.ok() ? overlay_.Paint(table_, options_.live ? table_.answered_frames() : table_.final_frames())
                        : broken_;
  }

  // REQUIRES: the session ended well.
  absl::Status CheckAnswers() {
    absl::MutexLock lock(&mutex_);
    if (!broken_.ok() || table_.final_frames() == table_.frames()) return broken_;
    return absl::InternalError("the tracker ended the session before every estimate was final");
  }

  TrackExtent Extent(bool complete) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    TrackExtent extent;
    extent.complete = complete;
    extent.frames = complete ? std::max(sent_, table_.frames()) : table_.estimated_frames();
    extent.final_frames = complete ? extent.frames : std::min(table_.final_frames(), extent.frames);
    extent.expected_frames = complete ? extent.frames : std::max(total_frames_, sent_);
    return extent;
  }

  // The tracks come first: they are what a second interrupt must not take.
  absl::Status WriteFiles(bool complete) {
    absl::MutexLock lock(&mutex_);
    progress_.Close();
    const TrackExtent extent = Extent(complete);
    if (!complete && extent.frames == 0) {
      environment_.log << "no estimate came, no file is written\n";
      return absl::OkStatus();
    }
    std::vector<std::string> files;
    absl::Status status;
    if (lines_) {
      if (!lines_->End(extent)) status = ReaderIsGone();
    } else if (!options_.out.empty()) {
      status = WriteTracks(options_.out, table_, facts_, extent);
      if (status.ok()) files.push_back(options_.out);
    }
    absl::Status painted = overlay_.Paint(table_, extent.frames);
    if (painted.ok()) painted = overlay_.Close();
    if (painted.ok()) files.insert(files.end(), {options_.overlay.video, options_.overlay.still});
    files.erase(std::remove(files.begin(), files.end(), ""), files.end());
    Report(extent, files);
    status.Update(painted);
    return status;
  }

  void Report(const TrackExtent& extent, const std::vector<std::string>& files) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!extent.complete) {
      if (!files.empty()) {
        environment_.log << "kept in " << absl::StrJoin(files, ", ") << ": " << Describe(extent) << "\n";
      }
      return;
    }
    WarnOfLatePoints();
    environment_.log << absl::StrFormat("%d points, final on all %d frames\n", table_.tracks().size(), extent.frames);
    if (options_.live) environment_.log << answers_.Summary();
    for (const std::string& path : files) environment_.log << "wrote " << path << "\n";
  }

  void WarnOfLatePoints() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    size_t late = 0;
    for (auto it = starts_.lower_bound(sent_); it != starts_.end(); ++it) late += it->second.size();
    if (late == 0) return;
    environment_.log << "warning: " << late << " points start after the last frame and were not tracked\n";
  }

  const TrackOptions& options_;
  const TrackEnvironment& environment_;
  const FrameEncoder encoder_;
  const VideoFacts facts_;
  const int64_t total_frames_;  // as the input announces; 0: not known
  FrameReader reader_;
  std::map<int64_t, std::vector<PointQuery>> starts_;  // by frame, pixels of the sent frames
  OverlayVideo overlay_;                               // of the main thread
  AnswerTimes answers_;
  absl::Status input_error_;  // of the main thread

  absl::Mutex mutex_;
  TrackTable table_ ABSL_GUARDED_BY(mutex_);
  std::optional<TrackLines> lines_ ABSL_GUARDED_BY(mutex_);
  Progress progress_ ABSL_GUARDED_BY(mutex_);
  int64_t sent_ ABSL_GUARDED_BY(mutex_) = 0;       // frames
  int64_t processed_ ABSL_GUARDED_BY(mutex_) = 0;  // frames
  absl::Status broken_ ABSL_GUARDED_BY(mutex_);    // the tracker's answers contradict the session
};

absl::Status CheckOutputs(const TrackOptions& options) {
  for (const std::string& path :
       {options.lines() ? std::string() : options.out, options.overlay.video, options.overlay.still}) {
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
  if (!out.empty() && !lines() && !TrackFormatOf(out).ok()) return TrackFormatOf(out).status();
  if (absl::Status status = overlay.Validate(); !status.ok()) return status;
  if (absl::Status status = points.Validate(); !status.ok()) return status;
  if (jpeg_quality < 1 || jpeg_quality > 100) return absl::InvalidArgumentError("--jpeg_quality: expected 1..100");
  if (max_side < 0 || (max_side > 0 && max_side < 32)) {
    return absl::InvalidArgumentError("--max_side: expected 0 or at least 32");
  }
  if (!processing_size.empty() && !IsProcessingSize(processing_size)) {
    return absl::InvalidArgumentError(absl::StrCat("--processing_size: expected multiples of ", kProcessingSizeStep,
                                                   ", such as 512x384; got ", ToString(processing_size)));
  }
  if (max_frames < 0) return absl::InvalidArgumentError("--max_frames: expected 0 or more");
  if (hop_frames < 0) return absl::InvalidArgumentError("--hop: expected 0 or more");
  if (iterations < 0) return absl::InvalidArgumentError("--iterations: expected 0 or more");
  return absl::OkStatus();
}

absl::Status RunTrack(const TrackOptions& options, const TrackEnvironment& environment) {
  const absl::Status outputs = CheckOutputs(options);
  if (!outputs.ok()) return outputs;
  auto source = FrameSource::Open(options.input);
  if (!source.ok()) return source.status();
  auto points = CollectPoints(options.points, (*source)->size());
  if (!points.ok()) return points.status();
  const auto tracker = environment.connect();
  if (!tracker.ok()) return tracker.status();
  TrackRun run(options, environment, *std::move(source), *points);
  return run.Run(**tracker);
}

}  // namespace holdfast
