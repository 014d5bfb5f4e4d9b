// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "model/checkpoint.h"
#include "server/engine/engine.h"
#include "server/engine/tracker_model.h"

namespace holdfast {

// The network of 'loaded' on the options' device, in their precision and with their compute threads; it has run once
// at the options' processing size. INVALID_ARGUMENT: no such device. INTERNAL: the network does not run there.
absl::StatusOr<std::unique_ptr<TrackerModel>> MakeTorchTrackerModel(LoadedModel loaded, const EngineOptions& options);

}  // namespace holdfast
