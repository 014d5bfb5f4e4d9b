// SPDX-License-Identifier: Apache-2.0
// The tracking engine: many sessions, one model, one batch queue. No gRPC, no protobuf; torch stays behind this header.
#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "api/clock.h"
#include "api/types.h"
#include "server/engine/engine_options.h"
#include "server/engine/engine_session.h"
#include "server/engine/metrics.h"

namespace holdfast {

// Thread-safe. Sessions must be destroyed before their engine.
class Engine {
 public:
  // Loads the weights, warms the model up and starts the threads. 'clock' and 'metrics' must outlive the engine.
  static absl::StatusOr<std::unique_ptr<Engine>> Create(const EngineOptions& options, Clock& clock,
                                                        EngineMetrics& metrics);
  virtual ~Engine() = default;
  // An overload error where every place for a session is taken, so that OpenSession would refuse any: it says so at no
  // cost, before a stranger's configuration is read. Counts as a session refused.
  virtual absl::Status CheckPlaces() = 0;
  // INVALID_ARGUMENT with field violations ("config.…"), or an overload error (RESOURCE_EXHAUSTED) at once.
  // 'listener' must outlive the session.
  virtual absl::StatusOr<std::unique_ptr<EngineSession>> OpenSession(const SessionConfig& config,
                                                                     SessionListener& listener) = 0;
  // With the load of now.
  virtual TrackerInfo info() const = 0;
  virtual const SessionLimits& limits() const = 0;
};

}  // namespace holdfast
