// SPDX-License-Identifier: Apache-2.0
// How a session goes on with the state of another one.
#pragma once

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "api/types.h"
#include "server/engine/input/session_inbox.h"
#include "server/engine/session_state.h"
#include "server/engine/tracker_model.h"
#include "server/engine/tracks/window.h"

namespace holdfast {

// 'config' with what it leaves open filled in from 'state', and without points, which the state holds.
// FAILED_PRECONDITION names what the state was made with and this session cannot have: other weights, another encoding,
// size, hop...
absl::StatusOr<SessionConfig> ResumedConfig(const SessionConfig& config, const SessionState& state,
                                            const ModelInfo& model);

// Whether tracks of these windows, and of templates of so many channels, can go on from the state; FAILED_PRECONDITION
// says what is impossible about it. What a sealer has sealed is always possible: this keeps a leaked key from being a
// way into the process's memory.
absl::Status CheckState(const SessionState& state, const WindowOptions& windows, int channels);

SessionInbox::Options::Resumed ResumedInbox(const SessionState& state);

}  // namespace holdfast
