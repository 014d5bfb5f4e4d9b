// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>

#include "absl/status/status.h"
#include "training/distributed.h"
#include "training/flags.h"

namespace holdfast {

// Builds everything a training needs and runs it, with progress on standard output. 'stop' ends it with a checkpoint.
absl::Status RunTraining(const TrainRequest& request, const GroupOptions& group, const std::atomic<bool>& stop);

}  // namespace holdfast
