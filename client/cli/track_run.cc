// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_run.h"

#include <algorithm>
#include <atomic>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "absl/synchronization/mutex.h"
#include "api/clock.h"
#include "client/cli/answer_times.h"
#include "client/cli/backward_pass.h"
#include "client/cli/frame_choice.h"
#include "client/cli/frame_reader.h"
#include "client/cli/frame_spool.h"
#include "client/cli/live_bound.h"
#include "client/cli/progress.h"
#include "client/cli/track_extent.h"
#include "client/cli/track_output.h"
#include "client/cli/track_queries.h"
#include "client/cli/track_table.h"

namespace holdfast {
namespace {

int64_t TotalFrames(const TrackOptions& options, const FrameChoice& choice, const FrameSource& source) {
  const int64_t frames = choice.CountOf(source.frames());
  if (options.max_frames == 0) return frames;
  return frames == 0 ? options.max_frames : std::min(frames, options.max_frames);
}

// Those on the way back count a second time: those up to the last one that something starts on, unless it is the first.
int64_t ProgressTotal(const TrackOptions& options, const FrameChoice& choice, int64_t total, int64_t last_queried) {
  const int64_t past = choice.CountOf(last_queried);
  if (!options.both || total == 0 || past == 0) return total;
  return total + std::min(total, past + 1);
}

// The overlay plays as long as what it was made of.
VideoFacts OverlayFacts(const TrackOptions& options, VideoFacts facts) {
  constexpr double kSlowest = 0.01;  // that a video's header can be relied on to hold
  facts.fps = std::max(kSlowest, facts.fps / static_cast<double>(options.every));
  return facts;
}

OverlayVideo::Options OverlayOptions(const TrackOptions& options) {
  OverlayVideo::Options overlay = options.overlay;
  overlay.keep_long = options.both;
  return overlay;
}

// One run from the first frame to the written files. The main thread reads and sends frames and paints; the tracker's
// thread delivers estimates.
class TrackRun final : public TrackObserver {
 public:
  TrackRun(const TrackOptions& options, const TrackEnvironment& environment, const FrameEncoder& encoder,
           TrackQueries queries, TrackInputs inputs)
      : options_(options),
        environment_(environment),
        encoder_(encoder),
        queries_(std::move(queries)),
        facts_{inputs.source->size(), inputs.source->fps()},
        choice_(options.start_frame, options.every, queries_.frames()),
        total_frames_(TotalFrames(options, choice_, *inputs.source)),
        input_frames_(inputs.source->frames()),
        drop_(options.live && inputs.source->live()),
        reader_(std::move(inputs.source), {choice_, drop_}),
        overlay_(OverlayOptions(options), OverlayFacts(options, facts_),
                 [view = inputs.view](const cv::Mat& picture) { view->Show(picture); }),
        answers_([this] { return clock_.SteadyNow(); }),
        table_(inputs.points, inputs.object,
               options.both ? TrackTable::Direction::kBoth : TrackTable::Direction::kForward),
        output_(options.out, inputs.points, environment.out),
        progress_({environment.terminal, ProgressTotal(options, choice_, total_frames_, *queries_.frames().rbegin()),
                   [] { return SystemClock().SteadyNow(); }},
                  environment.log) {}

  absl::Status Run(PointTracker& tracker) {
    auto stream = tracker.Open(queries_.Config(), *this);
    if (!stream.ok()) return stream.status();
    absl::Status status = Track(**stream);
    stream->reset();  // no answer comes any more
    if (status.ok() && options_.both) status = TrackBackward(tracker);
    if (status.ok()) status = CheckAnswers();
    const absl::Status written = WriteFiles(status.ok());
    environment_.stop.SetCallback(nullptr);
    if (status.ok()) return written;
    if (!written.ok()) environment_.log << "warning: " << written.message() << "\n";
    return status;
  }

  void OnAccepted(const SessionAccepted& accepted) override {
    absl::MutexLock lock(&mutex_);
    if (options_.hop.most > 0)
      environment_.log << "a window every " << accepted.hop_frames << " frames\n" << std::flush;
    if (!queries_.has_object() || accepted.limits.max_objects > 0) return;
    broken_ = absl::UnimplementedError("--mask: the server is too old, it knows no objects");
  }

  void OnTracks(TrackUpdate update) override {
    for (PointRun& run : update.runs) encoder_.FromSent(run);
    for (ObjectRun& run : update.objects) encoder_.FromSent(run);
    queries_.NameObjectPoints(update);
    absl::MutexLock lock(&mutex_);
    table_.RestoreQueries(update.runs);
    // The frame that is just being sent is not counted yet.
    if (broken_.ok() && update.frames_received > sent_ + 1) {
      broken_ = absl::InternalError(
          absl::StrCat("the tracker speaks of ", update.frames_received, " frames after ", sent_, " were sent"));
    }
    if (broken_.ok()) broken_ = table_.Apply(update);
    if (broken_.ok()) broken_ = output_.Write(update, table_);
    processed_ = std::max(processed_, update.frames_processed);
    const int64_t answered = answers_.Answered(update);
    live_bound_.Answered(answered, clock_.SteadyNow());
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
    environment_.log << "resumed at frame " << table_.Number(accepted.first_frame) << " on " << accepted.server << "\n"
                     << std::flush;
  }

  // Finish returns the status as well. Nobody waits for the input of a session that is over.
  void OnDone(const absl::Status&, const SessionSummary&) override { StopReading(); }

 private:
  absl::Status Track(TrackStream& stream) {
    environment_.stop.SetCallback([this, &stream] {
      stream.Cancel();
      StopReading();
    });
    absl::Status status = PushFrames(stream);
    if (status.ok()) status = stream.Finish();
    // The stream goes away, and files are written whether an interrupt comes or not; a second one ends the program.
    environment_.stop.SetCallback([] {});
    if (!status.ok() && environment_.stop.stopped()) return absl::CancelledError("interrupted");
    return input_error_.ok() ? status : input_error_;
  }

  // Does not wait for who writes results to a reader that has stalled.
  void StopReading() {
    reader_.Stop();
    over_ = true;
    if (mutex_.TryLock()) mutex_.Unlock();  // so that AwaitAnswers looks; else whoever has the lock gives it back
  }

  // What lies before the queries, after a session that ended well. An object's points have their places by then and are
  // points as any other.
  absl::Status TrackBackward(PointTracker& tracker) {
    const std::vector<PastQuery> queries = PastQueries();
    if (queries.empty()) return absl::OkStatus();
    BackwardPass pass(queries_.BackwardConfig(queries.size()), queries, *spool_, *this,
                      [this](const TrackUpdate& update) { return OnPast(update); });
    return pass.Run(tracker, environment_.stop);
  }

  std::vector<PastQuery> PastQueries() ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    std::vector<PastQuery> queries;
    for (const TableTrack& track : table_.tracks()) {
      if (track.query_frame == 0 || track.query_frame >= sent_ || table_.WasPlacedAnew(track)) continue;
      queries.push_back({encoder_.ToSent(track.start.query), track.query_frame});
    }
    return queries;
  }

  absl::Status OnPast(TrackUpdate update) {
    for (PointRun& run : update.runs) encoder_.FromSent(run);
    absl::MutexLock lock(&mutex_);
    absl::Status status = table_.ApplyBackward(update);
    if (status.ok()) status = output_.Write(update, table_);
    progress_.Update(sent_ + update.frames_processed, 0);
    return status;
  }

  // An error is one of the session. One of the input ends the input: the tracker still finishes what it has.
  absl::Status PushFrames(TrackStream& stream) {
    for (int64_t i = 0; options_.max_frames == 0 || i < options_.max_frames; ++i) {
      if (drop_) AwaitAnswers();
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

  void AwaitAnswers() ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(this, &TrackRun::MaySend));
  }

  // Frames before the first query's have no answers to wait for.
  bool MaySend() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const bool answers_come = sent_ > 0 && table_.Number(sent_ - 1) >= *queries_.frames().begin();
    return over_ || !answers_come || sent_ - answers_.answered() < live_bound_.frames();
  }

  // Without bytes at the end of the input.
  absl::StatusOr<Frame> NextFrame(int64_t index) {
    Frame frame;
    absl::StatusOr<InputFrame> input = reader_.Next();
    if (!input.ok()) return input.status();
    doubt_ = input->doubt;
    if (input->picture.empty()) {
      input_frames_ = input->number;
      return frame;
    }
    absl::StatusOr<std::string> bytes = encoder_.Encode(input->picture);
    if (!bytes.ok()) return bytes.status();
    absl::Status kept = overlay_.Add(input->picture);
    if (options_.both && kept.ok()) kept = KeepForTheWayBack(input->number, *bytes);
    if (!kept.ok()) return kept;
    frame.index = index;
    frame.bytes = *std::move(bytes);
    frame.capture_time = input->capture_time;
    if (index > 0) {  // what starts on the first frame is in the config
      frame.points = queries_.PointsOf(input->number);
      frame.objects = queries_.ObjectsOf(input->number);
    }
    absl::MutexLock lock(&mutex_);
    table_.AddFrame(input->number, input->capture_time);
    return frame;
  }

  absl::Status KeepForTheWayBack(int64_t number, const std::string& bytes) {
    if (number > *queries_.frames().rbegin()) return absl::OkStatus();
    if (!spool_) {
      absl::StatusOr<FrameSpool> spool = FrameSpool::Create();
      if (!spool.ok()) return spool.status();
      spool_.emplace(*std::move(spool));
    }
    return spool_->Append(bytes);
  }

  absl::Status AfterFrame() {
    absl::MutexLock lock(&mutex_);
    ++sent_;
    const int64_t done = options_.live ? answers_.answered() : processed_;
    progress_.Update(done, sent_ - done);
    if (!broken_.ok() || options_.both) return broken_;  // what lies before a query comes last
    return overlay_.Paint(table_, options_.live ? table_.answered_frames() : table_.final_frames());
  }

  // REQUIRES: the session ended well.
  absl::Status CheckAnswers() {
    absl::MutexLock lock(&mutex_);
    if (*queries_.frames().begin() >= EndInInput()) {
      return absl::InvalidArgumentError(absl::StrCat("nothing was tracked: what is to be tracked starts at frame ",
                                                     *queries_.frames().begin(), ", after the last frame"));
    }
    if (!broken_.ok() || table_.final_frames() == table_.frames()) return broken_;
    return absl::InternalError("the tracker ended the session before every estimate was final");
  }

  TrackExtent Extent(bool complete) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    TrackExtent extent;
    extent.complete = complete;
    extent.frames = complete ? std::max(sent_, table_.frames()) : table_.estimated_frames();
    extent.final_frames = complete ? extent.frames : std::min(table_.final_frames(), extent.frames);
    extent.expected_frames = complete ? extent.frames : std::max(total_frames_, sent_);
    if (extent.frames > 0) {
      extent.input_goes_on = table_.Number(extent.frames - 1) + 1 < std::max(input_frames_, EndInInput());
    }
    return extent;
  }

  // The tracks come first: they are what a second interrupt must not take.
  absl::Status WriteFiles(bool complete) {
    absl::MutexLock lock(&mutex_);
    progress_.Close();
    if (!doubt_.empty()) environment_.log << "warning: " << doubt_ << "\n";
    const TrackExtent extent = Extent(complete);
    if (!complete && extent.frames == 0) {
      environment_.log << "no estimate came, no file is written\n";
      return absl::OkStatus();
    }
    std::vector<std::string> files;
    absl::Status status = output_.End(table_, facts_, extent);
    if (status.ok()) files.push_back(output_.file());
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
        const auto number = [this](int64_t frame) {
          mutex_.AssertHeld();
          return NumberOf(frame);
        };
        environment_.log << "kept in " << absl::StrJoin(files, ", ") << ": " << Describe(extent, number) << "\n";
      }
      return;
    }
    const int64_t late = WarnOfLatePoints();
    const auto anew = std::count_if(table_.tracks().begin(), table_.tracks().end(), [this](const TableTrack& track) {
      mutex_.AssertHeld();
      return table_.WasPlacedAnew(track);
    });
    environment_.log << absl::StrFormat(
        "%d points%s, final on all %d frames\n", static_cast<int64_t>(table_.tracks().size()) - late,
        anew > 0 ? absl::StrCat(", ", anew, " of them placed anew") : "", extent.frames);
    if (options_.live) environment_.log << answers_.Summary();
    if (drop_) environment_.log << reader_.dropped() << " frames came faster than answers and were left out\n";
    for (const std::string& path : files) environment_.log << "wrote " << path << "\n";
  }

  // In the input, of a frame that is tracked or would have been.
  int64_t NumberOf(int64_t frame) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    int64_t known = std::min(frame, table_.input_frames() - 1);
    int64_t number = known < 0 ? -1 : table_.Number(known);
    for (; known < frame; ++known) number = choice_.After(number);
    return number;
  }

  int64_t EndInInput() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return sent_ == 0 ? 0 : table_.Number(sent_ - 1) + 1;
  }

  // Their number.
  int64_t WarnOfLatePoints() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const auto late = static_cast<int64_t>(queries_.CountPointsFrom(EndInInput()));
    if (queries_.ObjectIsFrom(EndInInput())) {
      environment_.log << "warning: the object of --mask starts after the last frame and was not tracked\n";
    }
    if (late > 0)
      environment_.log << "warning: " << late << " points start after the last frame and were not tracked\n";
    return late;
  }

  const TrackOptions& options_;
  const TrackEnvironment& environment_;
  const FrameEncoder encoder_;
  const TrackQueries queries_;
  const VideoFacts facts_;
  const FrameChoice choice_;
  const int64_t total_frames_;  // that are tracked, as the input announces; 0: not known
  int64_t input_frames_;        // all that it announces, and at its end those that it had; of the main thread
  const bool drop_;             // frames of the input are left out when they come too fast
  FrameReader reader_;
  std::optional<FrameSpool> spool_;  // as sent, up to the last one that something starts on; of the main thread
  OverlayVideo overlay_;             // of the main thread
  const SystemClock clock_;
  AnswerTimes answers_;
  absl::Status input_error_;       // of the main thread
  std::string doubt_;              // of the main thread; about the input
  std::atomic<bool> over_{false};  // no more frames are wanted

  absl::Mutex mutex_;
  TrackTable table_ ABSL_GUARDED_BY(mutex_);
  TrackOutput output_ ABSL_GUARDED_BY(mutex_);
  Progress progress_ ABSL_GUARDED_BY(mutex_);
  LiveBound live_bound_ ABSL_GUARDED_BY(mutex_);
  int64_t sent_ ABSL_GUARDED_BY(mutex_) = 0;       // frames
  int64_t processed_ ABSL_GUARDED_BY(mutex_) = 0;  // frames
  absl::Status broken_ ABSL_GUARDED_BY(mutex_);    // the tracker's answers contradict the session
};

}  // namespace

absl::Status TrackInput(const TrackOptions& options, const TrackEnvironment& environment, TrackInputs inputs,
                        PointTracker& tracker) {
  const FrameEncoder encoder(inputs.source->size(), options.max_side, options.jpeg_quality);
  absl::StatusOr<TrackQueries> queries = TrackQueries::Create(options, encoder, inputs.points, inputs.object);
  if (!queries.ok()) return queries.status();
  return TrackRun(options, environment, encoder, *std::move(queries), std::move(inputs)).Run(tracker);
}

}  // namespace holdfast
