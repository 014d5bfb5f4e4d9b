// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace holdfast {

// The 1-cycle of the learning rate with straight lines: up to the peak, then down to nearly nothing. What each may be
// is a matter of the recipe (training/recipe_fields.inc).
struct ScheduleOptions {
  double peak_rate = 5e-4;
  double warm_up = 0.05;  // share of the training in which the rate rises
  double start_divisor = 25;
  double end_divisor = 250000;
};

// progress: share of the training done; what lies outside [0, 1] counts as its end.
double LearningRate(const ScheduleOptions& options, double progress);

}  // namespace holdfast
