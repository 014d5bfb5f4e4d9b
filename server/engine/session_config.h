// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "absl/status/statusor.h"
#include "proto/types.h"
#include "server/engine/engine.h"
#include "server/engine/tracker_model.h"

namespace holdfast {

// What a session with this configuration gets: defaults filled in, session_id left empty. INVALID_ARGUMENT names every
// field that is wrong ("config.…").
absl::StatusOr<SessionAccepted> Negotiate(const SessionConfig& config, const EngineOptions& options,
                                          const ModelInfo& model);

}  // namespace holdfast
