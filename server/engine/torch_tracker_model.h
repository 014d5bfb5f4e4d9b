// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "model/checkpoint/checkpoint.h"
#include "server/engine/engine.h"
#include "server/engine/tracker_model.h"

namespace holdfast {

// The network of 'loaded' on the options' device, in their precision and with their compute threads; it has run once
// at the options' processing size. Where Precision::kAuto means bfloat16, each size of frames is tried in both
// precisions before its first frame, and left in float32 (which 'metrics' hears of) when they disagree. 'clock' tells
// what the network costs. 'metrics' must outlive the model. INVALID_ARGUMENT: no such device. INTERNAL: the network
// does not run there.
absl::StatusOr<std::unique_ptr<TrackerModel>> MakeTorchTrackerModel(LoadedModel loaded, const EngineOptions& options,
                                                                    const Clock& clock, EngineMetrics& metrics);

}  // namespace holdfast
