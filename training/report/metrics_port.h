// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "training/report/training_report.h"

namespace holdfast {

// Prometheus metrics of a training: steps, skipped steps and samples, clips, loss parts, delta_avg, step and wait
// times.
class TrainingMetrics : public TrainingObserver {
 public:
  // Serves them at http://<address>/metrics. 'address' is host:port; port 0 takes a free one. UNAVAILABLE when the
  // address cannot be had, INVALID_ARGUMENT when it is none.
  static absl::StatusOr<std::unique_ptr<TrainingMetrics>> Listen(const std::string& address);

  // As an HTTP client would get them.
  virtual std::string Text() const = 0;
  virtual int port() const = 0;
};

}  // namespace holdfast
