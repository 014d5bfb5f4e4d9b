// SPDX-License-Identifier: Apache-2.0
#include "server/engine/engine_with_model.h"

#include <algorithm>
#include <functional>
#include <opencv2/core/utility.hpp>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/engine/admission.h"
#include "server/engine/input/decode_pool.h"
#include "server/engine/input/object_input.h"
#include "server/engine/input/point_check.h"
#include "server/engine/input/session_config.h"
#include "server/engine/resume.h"
#include "server/engine/scheduler.h"
#include "server/engine/session.h"
#include "server/engine/tracks/calibration.h"
#include "server/engine/work_meter.h"

namespace holdfast {
namespace {

std::string NewSessionId() {
  std::random_device random;
  const uint64_t high = random(), low = random();
  return absl::StrCat(absl::Hex(high << 32 | low, absl::kZeroPad16));
}

// The way of a session's jobs to the decode pool, until the session's owner closes it: jobs that are still running then
// may ask for more. Thread-safe.
class JobDoor {
 public:
  explicit JobDoor(std::unique_ptr<DecodePool::Queue> queue) : queue_(std::move(queue)) {}
  void Submit(std::function<void()> job) {
    absl::MutexLock lock(&mutex_);
    if (queue_ != nullptr) queue_->Submit(std::move(job));
  }
  void Close() {
    std::unique_ptr<DecodePool::Queue> queue;
    absl::MutexLock lock(&mutex_);
    queue.swap(queue_);
  }

 private:
  absl::Mutex mutex_;
  std::unique_ptr<DecodePool::Queue> queue_ ABSL_GUARDED_BY(mutex_);
};

// The caller's end of a session.
class SessionHandle final : public EngineSession {
 public:
  SessionHandle(std::shared_ptr<Session> session, std::shared_ptr<JobDoor> jobs, Scheduler& scheduler)
      : session_(std::move(session)), jobs_(std::move(jobs)), scheduler_(scheduler) {}

  ~SessionHandle() override {
    Cancel();
    session_->AwaitDone();
    jobs_->Close();
  }

  const SessionAccepted& accepted() const override { return session_->accepted(); }

  absl::StatusOr<Room> PushFrame(Frame frame) override { return session_->PushFrame(std::move(frame)); }

  absl::Status AddPoints(const std::vector<PointQuery>& points) override {
    absl::Status status = session_->AddPoints(points);
    scheduler_.Notify();
    return status;
  }

  absl::Status RemovePoints(const std::vector<PointId>& ids) override {
    absl::Status status = session_->RemovePoints(ids);
    scheduler_.Notify();
    return status;
  }

  void Finish() override { Fail(absl::OkStatus()); }

  void Fail(absl::Status status) override {
    session_->inbox().End(std::move(status));
    scheduler_.Notify();
  }

  void Suspend(absl::Status status) override {
    session_->inbox().Suspend(std::move(status));
    scheduler_.Notify();
  }

  void Cancel() override {
    session_->inbox().Cancel();
    scheduler_.Notify();
  }

 private:
  const std::shared_ptr<Session> session_;
  const std::shared_ptr<JobDoor> jobs_;
  Scheduler& scheduler_;
};

class EngineImpl final : public Engine {
 public:
  EngineImpl(const EngineOptions& options, std::optional<Calibration> calibration, std::unique_ptr<TrackerModel> model,
             Clock& clock, EngineMetrics& metrics)
      : options_(options),
        calibration_(calibration),
        model_(std::move(model)),
        clock_(clock),
        metrics_(metrics),
        info_(MakeInfo(options, model_->info())),
        meter_({model_->info().costs, info_.default_hop_frames, options.iterations, options.max_load}, clock, metrics),
        default_frame_work_(meter_.Of(DefaultSession(info_)).frame),
        admission_({options.max_sessions, options.cache_budget_bytes}, meter_, metrics),
        scheduler_({options.max_batch_frames, options.max_batch_rows, options.least_step / model_->info().stride},
                   {*model_, meter_, clock, metrics}),
        pool_(options.decode_threads, clock) {
    cv::setNumThreads(1);  // each call runs on its thread of the pool; OpenCV's own would take the network's cores
  }

  TrackerInfo info() const override {
    TrackerInfo info = info_;
    const Admission::Load load = admission_.load();
    info.load.sessions = load.sessions;
    info.load.points = load.points;
    info.load.work_promised = load.work;
    info.load.work_budget = meter_.Budget();
    info.load.frame_work = default_frame_work_;
    return info;
  }

  const SessionLimits& limits() const override { return options_.limits; }

  absl::Status CheckPlaces() override { return admission_.CheckPlaces(); }

  absl::StatusOr<std::unique_ptr<EngineSession>> OpenSession(const SessionConfig& config,
                                                             SessionListener& listener) override {
    if (config.resume_token.empty()) return OpenSession(config, std::nullopt, listener);
    if (options_.sealer == nullptr)
      return absl::FailedPreconditionError("config.resume_token: this server has no checkpoints");
    absl::StatusOr<SessionState> state = options_.sealer->Unseal(config.resume_token);
    if (!state.ok()) return state.status();
    const absl::StatusOr<SessionConfig> resumed = ResumedConfig(config, *state, model_->info(), options_.least_step);
    if (!resumed.ok()) return resumed.status();
    return OpenSession(*resumed, *std::move(state), listener);
  }

 private:
  // 'state': of the session that this one goes on with.
  absl::StatusOr<std::unique_ptr<EngineSession>> OpenSession(const SessionConfig& config,
                                                             std::optional<SessionState> state,
                                                             SessionListener& listener) {
    auto accepted = Negotiate(config, options_, model_->info());
    if (!accepted.ok()) return accepted.status();
    accepted->session_id = NewSessionId();
    if (state) accepted->first_frame = state->next_frame;
    auto place = FindPlace(config, *accepted, state);
    if (!place.ok()) return place.status();
    const auto jobs = std::make_shared<JobDoor>(pool_.NewQueue());
    const Session::Threads threads{[jobs](std::function<void()> job) { jobs->Submit(std::move(job)); },
                                   [this] { scheduler_.Notify(); }};
    auto session =
        std::make_shared<Session>(place->options, listener, clock_, metrics_, threads, std::move(place->ticket));
    if (state) {
      session->Resume(*std::move(state));
    } else {
      absl::Status added = session->inbox().AddPoints("config.points", config.points);
      added.Update(session->inbox().AddObjects("config.objects", config.objects));
      if (!added.ok()) return added;
    }
    metrics_.SessionOpened();
    scheduler_.Add(session);
    return std::make_unique<SessionHandle>(std::move(session), jobs, scheduler_);
  }

  struct Place {
    Session::Options options;
    std::unique_ptr<Admission::Ticket> ticket;
  };
  // 'accepted': with the least hop of the session's bounds. The place has the least one that there is time for.
  absl::StatusOr<Place> FindPlace(const SessionConfig& config, const SessionAccepted& accepted,
                                  const std::optional<SessionState>& state) {
    std::vector<Session::Options> choices;
    std::vector<Admission::Demand> demands;
    const int most = std::max(accepted.hop_frames, config.max_hop_frames);
    for (int hop = accepted.hop_frames; hop <= most; ++hop) {
      choices.push_back(MakeOptions(config, WithHop(accepted, config, hop)));
      if (absl::Status status = Prepare(state, choices.back()); !status.ok()) return status;
      demands.push_back(DemandOf(config, choices.back()));
    }
    auto ticket = admission_.Admit(demands);
    if (!ticket.ok()) return ticket.status();
    const size_t choice = (*ticket)->choice();
    return Place{std::move(choices[choice]), *std::move(ticket)};
  }

  Admission::Demand DemandOf(const SessionConfig& config, const Session::Options& options) const {
    Admission::Demand demand;
    const int64_t frame_bytes = model_->FrameBytes(options.accepted.processing_size);
    demand.bytes = frame_bytes * options.max_cached_frames + Session::FlowBytes(options);
    demand.insists = config.frames_per_second > 0;
    demand.frames_per_second = demand.insists ? config.frames_per_second : options_.least_frames_per_second;
    demand.work = meter_.Of(options.accepted);
    const int64_t known =
        static_cast<int64_t>(options.inbox.resumed ? options.inbox.resumed->ids.size() : config.points.size());
    demand.points = std::max<int64_t>(config.expected_points, known + PointsOf(config.objects));
    return demand;
  }

  // Checkpoints of the session, and where it goes on.
  absl::Status Prepare(const std::optional<SessionState>& state, Session::Options& options) const {
    if (state) {
      if (absl::Status status = CheckState(*state, options.windows, model_->info().channels); !status.ok())
        return status;
      // Nothing is forgotten before all of them are there again.
      options.max_cached_frames = std::max(options.max_cached_frames, FramesToReplay(*state));
    }
    if (options.sealer != nullptr) {
      options.accepted.replay_frames = static_cast<int>(Session::ReplayFrames(options));
    } else {
      options.accepted.checkpoint_interval_frames = 0;
    }
    if (!state) return absl::OkStatus();
    options.inbox.resumed = ResumedInbox(*state);
    const int64_t points = static_cast<int64_t>(options.inbox.resumed->ids.size());
    return CheckPointCount(points, options.inbox.limits.max_points);
  }

  static SessionAccepted DefaultSession(const TrackerInfo& info) {
    SessionAccepted session;
    session.processing_size = info.default_processing_size;
    session.hop_frames = info.default_hop_frames;
    session.iterations = info.default_iterations;
    return session;
  }

  static TrackerInfo MakeInfo(const EngineOptions& options, const ModelInfo& model) {
    TrackerInfo info;
    info.model_name = model.name;
    info.preset = model.preset;
    info.weights_sha256 = model.weights_sha256;
    info.precision = model.precision;
    info.device = model.device;
    info.default_processing_size = options.processing_size;
    info.window_frames = model.window_frames;
    info.default_hop_frames = options.chaining == Chaining::kPublished ? model.window_frames - 1 : options.hop_frames;
    info.default_iterations = options.iterations;
    info.default_motion_prior = options.motion_prior && options.chaining != Chaining::kPublished;
    info.default_polish = options.polish && options.chaining != Chaining::kPublished;
    info.calibrated_confidence = !model.calibration.empty();
    info.max_sessions = options.max_sessions;
    info.limits = options.limits;
    return info;
  }

  Session::Options MakeOptions(const SessionConfig& config, const SessionAccepted& accepted) const {
    Session::Options options;
    options.accepted = accepted;
    options.inbox.format = {config.encoding, config.raw_size, accepted.limits.max_frame_pixels};
    options.inbox.limits = accepted.limits;
    options.inbox.max_pending_frames = options_.max_pending_frames;
    options.windows.frames = accepted.window_frames;
    options.windows.hop = accepted.hop_frames;
    options.windows.early = config.send_provisional;
    options.windows.polish = accepted.polish;
    options.windows.revise_last = options_.chaining == Chaining::kPublished;
    options.provisional = config.send_provisional;
    options.carry_templates = options_.chaining == Chaining::kPublished;
    options.confidence.calibration = calibration_ ? &*calibration_ : nullptr;
    options.confidence.sink = options_.evidence ? &options_.evidence : nullptr;
    // The published chaining carries templates from window to window, which no token has room for.
    options.sealer = options_.chaining == Chaining::kPublished ? nullptr : options_.sealer;
    options.weights_sha256 = model_->info().weights_sha256;
    options.least_step = options_.least_step;
    options.stride = model_->info().stride;
    options.max_cached_frames = accepted.window_frames + accepted.hop_frames + options_.max_pending_frames;
    return options;
  }

  const EngineOptions options_;
  const std::optional<Calibration> calibration_;
  const std::unique_ptr<TrackerModel> model_;
  Clock& clock_;
  EngineMetrics& metrics_;
  const TrackerInfo info_;
  WorkMeter meter_;
  const double default_frame_work_;
  Admission admission_;
  Scheduler scheduler_;
  DecodePool pool_;  // last: its jobs notify the scheduler
};

}  // namespace

absl::StatusOr<std::unique_ptr<Engine>> CreateEngineWithModel(const EngineOptions& options,
                                                              std::unique_ptr<TrackerModel> model, Clock& clock,
                                                              EngineMetrics& metrics) {
  if (absl::Status status = options.Validate(); !status.ok()) return status;
  if (options.hop_frames >= model->info().window_frames) {
    return absl::InvalidArgumentError(absl::StrCat("hop_frames is ", options.hop_frames,
                                                   ", expected less than the model's window of ",
                                                   model->info().window_frames));
  }
  std::optional<Calibration> calibration;
  if (const std::string& json = model->info().calibration; !json.empty()) {
    absl::StatusOr<Calibration> parsed = Calibration::FromJson(json);
    if (!parsed.ok()) return parsed.status();
    calibration = *std::move(parsed);
  }
  return std::make_unique<EngineImpl>(options, calibration, std::move(model), clock, metrics);
}

}  // namespace holdfast
