// SPDX-License-Identifier: Apache-2.0
#include "server/prometheus_metrics.h"

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include <iterator>
#include <sstream>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "program/flags.h"
#include "server/process_stats.h"

namespace holdfast {
namespace {

using prometheus::Counter;
using prometheus::Family;
using prometheus::Gauge;
using prometheus::Histogram;
using prometheus::MetricFamily;
using prometheus::MetricType;
using Buckets = Histogram::BucketBoundaries;

Buckets StageBuckets() { return {.0005, .001, .0025, .005, .01, .025, .05, .1, .25, .5, 1, 2.5, 5, 10, 30}; }
Buckets LatencyBuckets() { return {.01, .025, .05, .1, .25, .5, 1, 2.5, 5, 10, 30, 60}; }
Buckets TokenBuckets() { return {1e3, 4e3, 16e3, 64e3, 256e3, 1e6, 4e6, 16e6}; }
Buckets CountBuckets() { return {0, 1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024}; }

const char* Name(SessionOutcome outcome) {
  switch (outcome) {
    case SessionOutcome::kCompleted:
      return "completed";
    case SessionOutcome::kFailed:
      return "failed";
    case SessionOutcome::kClientError:
      return "client_error";
    case SessionOutcome::kSuspended:
      return "suspended";
    case SessionOutcome::kCancelled:
      return "cancelled";
  }
  return "other";
}

const char* Name(FrameResult result) {
  switch (result) {
    case FrameResult::kTracked:
      return "tracked";
    case FrameResult::kRejected:
      return "rejected";
    case FrameResult::kDropped:
      return "dropped";
  }
  return "other";
}

const char* Name(RejectReason reason) {
  switch (reason) {
    case RejectReason::kSessions:
      return "sessions";
    case RejectReason::kMemory:
      return "memory";
    case RejectReason::kWork:
      return "work";
  }
  return "other";
}

const char* Name(RefusalReason reason) {
  switch (reason) {
    case RefusalReason::kLoading:
      return "loading";
    case RefusalReason::kDraining:
      return "draining";
    case RefusalReason::kStreams:
      return "streams";
    case RefusalReason::kCaller:
      return "caller";
    case RefusalReason::kToken:
      return "token";
  }
  return "other";
}

const char* Name(SpanResult result) { return result == SpanResult::kSent ? "sent" : "dropped"; }

const char* Name(ResumeResult result) {
  switch (result) {
    case ResumeResult::kResumed:
      return "resumed";
    case ResumeResult::kRefused:
      return "refused";
    case ResumeResult::kOverloaded:
      return "overloaded";
  }
  return "other";
}

MetricFamily Single(const char* name, const char* help, MetricType type, double value) {
  prometheus::ClientMetric metric;
  (type == MetricType::Counter ? metric.counter.value : metric.gauge.value) = value;
  return {name, help, type, {metric}};
}

std::vector<MetricFamily> CollectProcess() {
  const ProcessStats s = ReadProcessStats();
  return {
      Single("process_cpu_seconds_total", "User and system CPU time spent.", MetricType::Counter, s.cpu_seconds),
      Single("process_start_time_seconds", "Start of the process since the epoch.", MetricType::Gauge,
             s.start_time_seconds),
      Single("process_resident_memory_bytes", "Resident memory.", MetricType::Gauge,
             static_cast<double>(s.resident_bytes)),
      Single("process_virtual_memory_bytes", "Virtual memory.", MetricType::Gauge,
             static_cast<double>(s.virtual_bytes)),
      Single("process_open_fds", "Open file descriptors.", MetricType::Gauge, static_cast<double>(s.open_fds)),
      Single("process_max_fds", "Limit of open file descriptors.", MetricType::Gauge, static_cast<double>(s.max_fds)),
  };
}

}  // namespace

struct PrometheusMetrics::Impl {
  Family<Counter>& AddCounters(const char* name, const char* help) {
    return prometheus::BuildCounter().Name(name).Help(help).Register(registry);
  }
  Gauge& AddGauge(const char* name, const char* help) {
    return prometheus::BuildGauge().Name(name).Help(help).Register(registry).Add({});
  }
  Family<Histogram>& AddHistograms(const char* name, const char* help) {
    return prometheus::BuildHistogram().Name(name).Help(help).Register(registry);
  }
  // Every label value is made at the start, so that rates are right from the first event on.
  template <typename Enum>
  static void Prepare(Family<Counter>& family, const char* label, std::initializer_list<Enum> values) {
    for (const Enum value : values) family.Add({{label, Name(value)}});
  }

  prometheus::Registry registry;
  Gauge& sessions_active = AddGauge("holdfast_sessions_active", "Sessions open now.");
  Family<Counter>& sessions = AddCounters("holdfast_sessions_total", "Sessions that ended, by outcome.");
  Gauge& points_active = AddGauge("holdfast_points_active", "Points tracked now, over all sessions.");
  Family<Counter>& frames = AddCounters("holdfast_frames_total", "Frames received, by result.");
  Family<Histogram>& stages = AddHistograms("holdfast_stage_seconds", "Time a frame or batch spent in a stage.");
  Histogram& first_latency =
      AddHistograms("holdfast_frame_latency_seconds", "From a frame's arrival to its first estimate.")
          .Add({}, LatencyBuckets());
  Histogram& final_latency =
      AddHistograms("holdfast_final_latency_seconds", "From a frame's arrival to its final estimate.")
          .Add({}, LatencyBuckets());
  Histogram& lag = AddHistograms("holdfast_session_lag_frames", "Frames received but not processed, at each frame.")
                       .Add({}, CountBuckets());
  Histogram& batch_rows =
      AddHistograms("holdfast_batch_rows", "Rows (point windows) of a refinement batch.").Add({}, CountBuckets());
  Histogram& iterations = AddHistograms("holdfast_refine_iterations", "Iterations of a row of a refinement batch.")
                              .Add({}, Buckets{1, 2, 3, 4, 6, 8, 12, 16});
  Family<Counter>& rejected =
      AddCounters("holdfast_admission_rejected_total", "Streams and sessions refused at the door, by reason.");
  Family<Counter>& resumes =
      AddCounters("holdfast_resumes_total", "Streams that began with the token of a checkpoint, by result.");
  Counter& checkpoints = AddCounters("holdfast_checkpoints_total", "Checkpoints sent to clients.").Add({});
  Histogram& checkpoint_bytes =
      AddHistograms("holdfast_checkpoint_bytes", "Length of a checkpoint's token.").Add({}, TokenBuckets());
  Family<Counter>& spans = AddCounters("holdfast_spans_total", "Spans of traces, by what became of them.");
  Gauge& cache_bytes = AddGauge("holdfast_cache_bytes", "Features held now, over all sessions.");
  Gauge& work_budget =
      AddGauge("holdfast_work_budget", "Point-frames a second that sessions may be promised, as of the last batch.");
  Gauge& work_promised = AddGauge("holdfast_work_promised", "Point-frames a second that sessions were promised.");
  Counter& precision_fallbacks =
      AddCounters("holdfast_precision_fallbacks_total",
                  "Processing sizes left in float32 because bfloat16 computed something else.")
          .Add({});
  Family<Gauge>& model_info =
      prometheus::BuildGauge().Name("holdfast_model_info").Help("What is loaded; always 1.").Register(registry);
};

PrometheusMetrics::PrometheusMetrics(std::shared_ptr<spdlog::logger> log)
    : impl_(std::make_unique<Impl>()), log_(std::move(log)) {
  Impl::Prepare(impl_->sessions, "outcome",
                {SessionOutcome::kCompleted, SessionOutcome::kFailed, SessionOutcome::kClientError,
                 SessionOutcome::kCancelled, SessionOutcome::kSuspended});
  Impl::Prepare(impl_->frames, "result", {FrameResult::kTracked, FrameResult::kRejected, FrameResult::kDropped});
  Impl::Prepare(impl_->rejected, "reason", {RejectReason::kSessions, RejectReason::kMemory, RejectReason::kWork});
  Impl::Prepare(impl_->rejected, "reason",
                {RefusalReason::kLoading, RefusalReason::kDraining, RefusalReason::kStreams, RefusalReason::kCaller,
                 RefusalReason::kToken});
  Impl::Prepare(impl_->spans, "result", {SpanResult::kSent, SpanResult::kDropped});
  Impl::Prepare(impl_->resumes, "result", {ResumeResult::kResumed, ResumeResult::kRefused, ResumeResult::kOverloaded});
  for (const Stage stage :
       {Stage::kDecode, Stage::kFlow, Stage::kQueue, Stage::kEncode, Stage::kRefine, Stage::kEmit}) {
    impl_->stages.Add({{"stage", StageName(stage)}}, StageBuckets());
  }
  prometheus::BuildGauge()
      .Name("holdfast_build_info")
      .Help("The program's version; always 1.")
      .Register(impl_->registry)
      .Add({{"version", std::string(ProgramVersion())}})
      .Set(1);
}

PrometheusMetrics::~PrometheusMetrics() = default;

std::string PrometheusMetrics::Text() const {
  std::vector<MetricFamily> families = impl_->registry.Collect();
  std::vector<MetricFamily> process = CollectProcess();
  std::move(process.begin(), process.end(), std::back_inserter(families));
  std::ostringstream text;
  prometheus::TextSerializer().Serialize(text, families);
  return text.str();
}

void PrometheusMetrics::ModelLoaded(const TrackerInfo& info) {
  impl_->model_info
      .Add({{"name", info.model_name},
            {"preset", info.preset},
            {"weights_sha256", info.weights_sha256},
            {"precision", info.precision},
            {"device", info.device}})
      .Set(1);
}

void PrometheusMetrics::SessionOpened() { impl_->sessions_active.Increment(); }

void PrometheusMetrics::SessionClosed(SessionOutcome outcome) {
  impl_->sessions_active.Decrement();
  impl_->sessions.Add({{"outcome", Name(outcome)}}).Increment();
}

void PrometheusMetrics::AdmissionRejected(RejectReason reason) {
  impl_->rejected.Add({{"reason", Name(reason)}}).Increment();
}

void PrometheusMetrics::PointsActive(int64_t delta) { impl_->points_active.Increment(static_cast<double>(delta)); }

void PrometheusMetrics::FrameDone(FrameResult result) { impl_->frames.Add({{"result", Name(result)}}).Increment(); }

void PrometheusMetrics::StageTook(Stage stage, absl::Duration duration) {
  impl_->stages.Add({{"stage", StageName(stage)}}, StageBuckets()).Observe(absl::ToDoubleSeconds(duration));
}

void PrometheusMetrics::FirstEstimate(absl::Duration since_arrival) {
  impl_->first_latency.Observe(absl::ToDoubleSeconds(since_arrival));
}

void PrometheusMetrics::FinalEstimate(absl::Duration since_arrival) {
  impl_->final_latency.Observe(absl::ToDoubleSeconds(since_arrival));
}

void PrometheusMetrics::SessionLag(int64_t frames) { impl_->lag.Observe(static_cast<double>(frames)); }

void PrometheusMetrics::BatchRefined(absl::Span<const int> iterations) {
  impl_->batch_rows.Observe(static_cast<double>(iterations.size()));
  for (const int taken : iterations) impl_->iterations.Observe(taken);
}

void PrometheusMetrics::CacheBytes(int64_t bytes) { impl_->cache_bytes.Set(static_cast<double>(bytes)); }

void PrometheusMetrics::WorkBudget(double work) { impl_->work_budget.Set(work); }

void PrometheusMetrics::WorkPromised(double work) { impl_->work_promised.Set(work); }

void PrometheusMetrics::PrecisionFellBack(ImageSize size, absl::string_view why) {
  impl_->precision_fallbacks.Increment();
  log_->warn(absl::StrCat("frames processed at ", ToString(size),
                          " are computed in float32: bfloat16 gives other results on this machine (", why, ")"));
}

void PrometheusMetrics::StreamRefused(RefusalReason reason) {
  impl_->rejected.Add({{"reason", Name(reason)}}).Increment();
}

void PrometheusMetrics::SessionResumed(ResumeResult result) {
  impl_->resumes.Add({{"result", Name(result)}}).Increment();
}

void PrometheusMetrics::CheckpointSent(int64_t token_bytes) {
  impl_->checkpoints.Increment();
  impl_->checkpoint_bytes.Observe(static_cast<double>(token_bytes));
}

void PrometheusMetrics::SpansDone(SpanResult result, int64_t count) {
  impl_->spans.Add({{"result", Name(result)}}).Increment(static_cast<double>(count));
}

}  // namespace holdfast
