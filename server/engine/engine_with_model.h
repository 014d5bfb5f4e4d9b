// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "server/engine/engine.h"
#include "server/engine/tracker_model.h"

namespace holdfast {

// An engine over any network; Engine::Create is this with the network of a checkpoint. The options' weights, device,
// precision and compute threads are the model's business and not looked at here.
absl::StatusOr<std::unique_ptr<Engine>> CreateEngineWithModel(const EngineOptions& options,
                                                              std::unique_ptr<TrackerModel> model, Clock& clock,
                                                              EngineMetrics& metrics);

}  // namespace holdfast
