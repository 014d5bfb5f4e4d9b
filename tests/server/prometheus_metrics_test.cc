// SPDX-License-Identifier: Apache-2.0
#include "server/prometheus_metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <memory>
#include <sstream>
#include <thread>
#include <vector>

#include "server/logging.h"
#include "server/process_stats.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

std::shared_ptr<spdlog::logger> Silent() { return MakeLogger(LogFormat::kText, "off"); }

TEST(PrometheusMetricsTest, EveryFamilyIsThereFromTheStart) {
  PrometheusMetrics metrics(Silent());
  metrics.ModelLoaded({});
  const std::string text = metrics.Text();
  for (const char* family : {"holdfast_sessions_active gauge",
                             "holdfast_sessions_total counter",
                             "holdfast_points_active gauge",
                             "holdfast_frames_total counter",
                             "holdfast_stage_seconds histogram",
                             "holdfast_frame_latency_seconds histogram",
                             "holdfast_final_latency_seconds histogram",
                             "holdfast_session_lag_frames histogram",
                             "holdfast_batch_rows histogram",
                             "holdfast_refine_iterations histogram",
                             "holdfast_admission_rejected_total counter",
                             "holdfast_cache_bytes gauge",
                             "holdfast_resumes_total counter",
                             "holdfast_checkpoints_total counter",
                             "holdfast_checkpoint_bytes histogram",
                             "holdfast_model_info gauge",
                             "holdfast_build_info gauge",
                             "process_cpu_seconds_total counter",
                             "process_resident_memory_bytes gauge",
                             "process_open_fds gauge",
                             "process_start_time_seconds gauge"}) {
    EXPECT_THAT(text, HasSubstr(std::string("# TYPE ") + family + "\n"));
  }
  EXPECT_THAT(text, HasSubstr("holdfast_sessions_total{outcome=\"failed\"} 0"));
  EXPECT_THAT(text, HasSubstr("holdfast_resumes_total{result=\"resumed\"} 0"));
  EXPECT_THAT(text, HasSubstr("holdfast_stage_seconds_count{stage=\"emit\"} 0"));
}

TEST(PrometheusMetricsTest, EveryEventIsCounted) {
  PrometheusMetrics metrics(Silent());
  metrics.SessionOpened();
  metrics.SessionOpened();
  metrics.SessionClosed(SessionOutcome::kFailed);
  metrics.SessionClosed(SessionOutcome::kSuspended);
  metrics.SessionOpened();
  metrics.AdmissionRejected(RejectReason::kMemory);
  metrics.StreamRefused(RefusalReason::kDraining);
  metrics.SessionResumed(ResumeResult::kRefused);
  metrics.CheckpointSent(5000);
  metrics.PointsActive(5);
  metrics.PointsActive(-2);
  metrics.FrameDone(FrameResult::kRejected);
  metrics.StageTook(Stage::kRefine, absl::Milliseconds(250));
  metrics.FirstEstimate(absl::Seconds(1));
  metrics.FinalEstimate(absl::Seconds(2));
  metrics.SessionLag(3);
  metrics.BatchRefined({1, 1, 4});
  metrics.CacheBytes(1000);
  metrics.AdmissionRejected(RejectReason::kWork);
  metrics.WorkBudget(1500);
  metrics.WorkPromised(250);
  metrics.PrecisionFellBack({320, 608}, "features differ by 1.2");
  const std::string text = metrics.Text();
  for (const char* line : {"holdfast_sessions_active 1\n",
                           "holdfast_sessions_total{outcome=\"failed\"} 1\n",
                           "holdfast_sessions_total{outcome=\"suspended\"} 1\n",
                           "holdfast_sessions_total{outcome=\"client_error\"} 0\n",
                           "holdfast_admission_rejected_total{reason=\"memory\"} 1\n",
                           "holdfast_admission_rejected_total{reason=\"draining\"} 1\n",
                           "holdfast_points_active 3\n",
                           "holdfast_frames_total{result=\"rejected\"} 1\n",
                           "holdfast_stage_seconds_sum{stage=\"refine\"} 0.25\n",
                           "holdfast_stage_seconds_bucket{stage=\"refine\",le=\"0.1\"} 0\n",
                           "holdfast_frame_latency_seconds_sum 1\n",
                           "holdfast_final_latency_seconds_sum 2\n",
                           "holdfast_session_lag_frames_sum 3\n",
                           "holdfast_batch_rows_sum 3\n",
                           "holdfast_refine_iterations_sum 6\n",
                           "holdfast_refine_iterations_count 3\n",
                           "holdfast_cache_bytes 1000\n",
                           "holdfast_resumes_total{result=\"refused\"} 1\n",
                           "holdfast_checkpoints_total 1\n",
                           "holdfast_checkpoint_bytes_sum 5000\n",
                           "holdfast_checkpoint_bytes_bucket{le=\"4000\"} 0\n",
                           "holdfast_admission_rejected_total{reason=\"work\"} 1\n",
                           "holdfast_work_budget 1500\n",
                           "holdfast_work_promised 250\n",
                           "holdfast_precision_fallbacks_total 1\n"}) {
    EXPECT_THAT(text, HasSubstr(line));
  }
}

TEST(PrometheusMetricsTest, AFallbackToFloat32IsLoggedForTheOperator) {
  std::ostringstream lines;
  const auto log = std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::ostream_sink_mt>(lines));
  PrometheusMetrics metrics(log);
  EXPECT_THAT(metrics.Text(), HasSubstr("holdfast_precision_fallbacks_total 0\n"));
  metrics.PrecisionFellBack({320, 608}, "features differ by 1.2");
  EXPECT_THAT(lines.str(), HasSubstr("warning"));
  EXPECT_THAT(lines.str(), HasSubstr("320x608 are computed in float32"));
  EXPECT_THAT(lines.str(), HasSubstr("features differ by 1.2"));
}

TEST(PrometheusMetricsTest, SaysWhatIsLoaded) {
  PrometheusMetrics metrics(Silent());
  TrackerInfo info;
  info.model_name = "pips";
  info.precision = "float32";
  metrics.ModelLoaded(info);
  EXPECT_THAT(metrics.Text(), ::testing::ContainsRegex("holdfast_model_info\\{.*name=\"pips\".*\\} 1\n"));
}

TEST(PrometheusMetricsTest, MayBeReadWhileEventsCome) {
  PrometheusMetrics metrics(Silent());
  std::vector<std::thread> threads;
  for (int i = 0; i < 2; ++i) {
    threads.emplace_back([&] {
      for (int n = 0; n < 500; ++n) metrics.FrameDone(FrameResult::kTracked);
    });
  }
  for (int n = 0; n < 20; ++n) EXPECT_THAT(metrics.Text(), HasSubstr("holdfast_frames_total"));
  for (std::thread& thread : threads) thread.join();
  EXPECT_THAT(metrics.Text(), HasSubstr("holdfast_frames_total{result=\"tracked\"} 1000\n"));
}

TEST(ProcessStatsTest, AreThoseOfThisProcess) {
  const ProcessStats stats = ReadProcessStats();
  EXPECT_GT(stats.resident_bytes, 1 << 20);
  EXPECT_GT(stats.virtual_bytes, stats.resident_bytes);
  EXPECT_GE(stats.open_fds, 3);
  EXPECT_GE(stats.max_fds, stats.open_fds);
  EXPECT_GE(stats.cpu_seconds, 0);
  EXPECT_GT(stats.start_time_seconds, 1e9);
}

}  // namespace
}  // namespace holdfast
