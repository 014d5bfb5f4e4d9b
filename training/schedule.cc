// SPDX-License-Identifier: Apache-2.0
#include "training/schedule.h"

#include <algorithm>

namespace holdfast {

double LearningRate(const ScheduleOptions& options, double progress) {
  const double p = std::clamp(progress, 0.0, 1.0);
  const double start = options.peak_rate / options.start_divisor;
  const double end = options.peak_rate / options.end_divisor;
  if (p < options.warm_up) return start + (options.peak_rate - start) * (p / options.warm_up);
  return options.peak_rate + (end - options.peak_rate) * ((p - options.warm_up) / (1 - options.warm_up));
}

}  // namespace holdfast
