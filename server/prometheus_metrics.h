// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/logger.h>

#include <memory>
#include <string>

#include "api/types.h"
#include "server/engine/metrics.h"
#include "server/events.h"

namespace holdfast {

// Counts the events of the engine and the server for Prometheus; the library stays behind this header. Thread-safe.
// Events that an operator has to hear of are logged too.
class PrometheusMetrics final : public EngineMetrics, public ServerEvents {
 public:
  explicit PrometheusMetrics(std::shared_ptr<spdlog::logger> log);
  ~PrometheusMetrics() override;

  // Everything, in Prometheus' text format.
  std::string Text() const;
  // Once, when the model is loaded.
  void ModelLoaded(const TrackerInfo& info);

  void SessionOpened() override;
  void SessionClosed(SessionOutcome outcome) override;
  void AdmissionRejected(RejectReason reason) override;
  void PointsActive(int64_t delta) override;
  void FrameDone(FrameResult result) override;
  void StageTook(Stage stage, absl::Duration duration) override;
  void FirstEstimate(absl::Duration since_arrival) override;
  void FinalEstimate(absl::Duration since_arrival) override;
  void SessionLag(int64_t frames) override;
  void BatchRefined(absl::Span<const int> iterations) override;
  void CacheBytes(int64_t bytes) override;
  void WorkBudget(double work) override;
  void WorkPromised(double work) override;
  void PrecisionFellBack(ImageSize size, absl::string_view why) override;
  void StreamRefused(RefusalReason reason) override;
  void SessionResumed(ResumeResult result) override;
  void CheckpointSent(int64_t token_bytes) override;
  void SpansDone(SpanResult result, int64_t count) override;

 private:
  struct Impl;
  const std::unique_ptr<Impl> impl_;
  const std::shared_ptr<spdlog::logger> log_;
};

}  // namespace holdfast
