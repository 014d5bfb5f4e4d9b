// SPDX-License-Identifier: Apache-2.0
#include "server/engine/engine.h"

#include <utility>

#include "model/checkpoint/checkpoint.h"
#include "server/engine/engine_with_model.h"
#include "server/engine/torch_tracker_model.h"

namespace holdfast {

absl::StatusOr<std::unique_ptr<Engine>> Engine::Create(const EngineOptions& options, Clock& clock,
                                                       EngineMetrics& metrics) {
  if (absl::Status status = options.Validate(); !status.ok()) return status;
  absl::StatusOr<LoadedModel> loaded = LoadModel(options.weights_path);
  if (!loaded.ok()) return loaded.status();
  auto model = MakeTorchTrackerModel(*std::move(loaded), options, clock, metrics);
  if (!model.ok()) return model.status();
  return CreateEngineWithModel(options, *std::move(model), clock, metrics);
}

}  // namespace holdfast
