// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>

#include "absl/status/statusor.h"
#include "training/distributed.h"
#include "training/flags.h"
#include "training/trainer.h"

namespace holdfast {

// Builds everything a training needs and runs it, with progress on standard output. 'stop' ends it with a checkpoint,
// given in this process or in another one of the group. Returns why it ended.
absl::StatusOr<StopReason> RunTraining(const TrainRequest& request, const GroupOptions& group,
                                       const std::atomic<bool>& stop);

}  // namespace holdfast
