// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "proto/types.h"
#include "server/engine/metrics.h"
#include "server/events.h"

namespace holdfast {

// Counts the events of the engine and the server for Prometheus; the library stays behind this header. Thread-safe.
class PrometheusMetrics final : public EngineMetrics, public ServerEvents {
 public:
  PrometheusMetrics();
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
  void BatchRefined(int64_t rows, int64_t iterations) override;
  void CacheBytes(int64_t bytes) override;
  void StreamRefused(RefusalReason reason) override;

 private:
  struct Impl;
  const std::unique_ptr<Impl> impl_;
};

}  // namespace holdfast
