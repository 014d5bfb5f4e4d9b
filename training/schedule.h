// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "absl/status/status.h"

namespace holdfast {

// The 1-cycle of the learning rate with straight lines: up to the peak, then down to nearly nothing.
struct ScheduleOptions {
  double peak_rate = 5e-4;
  double warm_up = 0.05;  // share of the training in which the rate rises; (0, 1)
  double start_divisor = 25;
  double end_divisor = 250000;

  absl::Status Validate() const;
};

// progress: share of the training done; what lies outside [0, 1] counts as its end.
double LearningRate(const ScheduleOptions& options, double progress);

}  // namespace holdfast
