// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "absl/status/statusor.h"
#include "api/types.h"
#include "server/engine/engine_options.h"
#include "server/engine/tracker_model.h"

namespace holdfast {

// What a session with this configuration gets: defaults filled in, session_id left empty, the least hop of its bounds.
// RESOURCE_EXHAUSTED at once for too many points; INVALID_ARGUMENT names the fields that are wrong ("config.…").
absl::StatusOr<SessionAccepted> Negotiate(const SessionConfig& config, const EngineOptions& options,
                                          const ModelInfo& model);

// The same with another hop of its bounds.
SessionAccepted WithHop(SessionAccepted accepted, const SessionConfig& config, int hop_frames);

}  // namespace holdfast
