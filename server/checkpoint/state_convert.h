// SPDX-License-Identifier: Apache-2.0
// A session's state <-> the message that tokens hold. Every value survives bit by bit, NaN included.
#pragma once

#include "absl/status/statusor.h"
#include "holdfast/checkpoint/v1/session_state.pb.h"
#include "server/engine/session_state.h"

namespace holdfast {

checkpoint::v1::SessionState ToProto(const SessionState& state);

// FAILED_PRECONDITION names the first thing that no session could have said: lengths that do not fit each other, frames
// out of order, positions that are nowhere. Whether the state suits this server is for the engine to say.
absl::StatusOr<SessionState> FromProto(const checkpoint::v1::SessionState& message);

}  // namespace holdfast
