// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "server/engine/session_state.h"

namespace holdfast {

// Makes opaque tokens of sessions' states, which clients keep, and takes nothing back that it or one of its kind has
// not made. Thread-safe.
class CheckpointSealer {
 public:
  virtual ~CheckpointSealer() = default;
  // RESOURCE_EXHAUSTED when the token would be longer than a message may be.
  virtual absl::StatusOr<std::string> Seal(const SessionState& state) const = 0;
  // FAILED_PRECONDITION says what is wrong with a token: tampered with, cut off, of an unknown key or version, too old.
  virtual absl::StatusOr<SessionState> Unseal(absl::string_view token) const = 0;
  // Whether tokens are good for other processes, and for this one after a restart.
  virtual bool outlives_process() const = 0;
};

}  // namespace holdfast
