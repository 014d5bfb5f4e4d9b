// SPDX-License-Identifier: Apache-2.0
// How a session goes on with the state of another one.
#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "api/types.h"
#include "server/engine/input/session_inbox.h"
#include "server/engine/session_state.h"
#include "server/engine/tracker_model.h"
#include "server/engine/tracks/window.h"

namespace holdfast {

// 'config' with what it leaves open filled in from 'state', and without points, which the state holds. 'least_step' is
// this server's.
// FAILED_PRECONDITION names what the state was made with and this session cannot have: other weights, another encoding,
// size, hop...
absl::StatusOr<SessionConfig> ResumedConfig(const SessionConfig& config, const SessionState& state,
                                            const ModelInfo& model, double least_step);

// Whether tracks of these windows, and of templates of so many channels, can go on from the state; FAILED_PRECONDITION
// says what is impossible about it. What a sealer has sealed is always possible: this keeps a leaked key from being a
// way into the process's memory.
absl::Status CheckState(const SessionState& state, const WindowOptions& windows, int channels);

// The frames that come again before there is a new one. The session that the state was taken from held as many, which
// may be more than a session of this server holds otherwise. REQUIRES: CheckState is OK.
int64_t FramesToReplay(const SessionState& state);

SessionInbox::Options::Resumed ResumedInbox(const SessionState& state);

}  // namespace holdfast
