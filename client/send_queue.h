// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "api/types.h"
#include "client/replay_buffer.h"
#include "holdfast/v1/point_tracking.pb.h"

namespace holdfast {

// The way of a session's messages from the caller's thread to the one that writes them to the call of the moment: a
// ReplayBuffer that threads wait at. The caller waits while a few messages are unsent, which is how a slow server slows
// its client, and while the buffer is full. Thread-safe.
class SendQueue {
 public:
  SendQueue(int64_t buffer_bytes, bool keep) : buffer_bytes_(buffer_bytes), buffer_(buffer_bytes, keep) {}

  // --- The caller.
  // Blocks until there is room; where there cannot be any, nothing is kept any more (see TakeWarning). After the end,
  // the end's status.
  absl::Status Push(v1::TrackRequest request) ABSL_LOCKS_EXCLUDED(mutex_);
  // Nothing follows.
  void Close() ABSL_LOCKS_EXCLUDED(mutex_);

  // --- The writer of the call.
  // Blocks for the next message; null: none will come, for this call at least.
  ReplayBuffer::Message Next() ABSL_LOCKS_EXCLUDED(mutex_);

  // --- The session. There is a writer between Restart and Interrupt only.
  // A call begins, with all that is kept: what its server has promised decides how much that has to be from now on, and
  // whether anything is. False: the server begins at a frame that is not here any more.
  bool Restart(const SessionAccepted& accepted) ABSL_LOCKS_EXCLUDED(mutex_);
  // The call is over: Next returns null.
  void Interrupt() ABSL_LOCKS_EXCLUDED(mutex_);
  // As those of ReplayBuffer.
  bool DropBefore(int64_t frame) ABSL_LOCKS_EXCLUDED(mutex_);
  void KeepNothing() ABSL_LOCKS_EXCLUDED(mutex_);
  bool keeps() const ABSL_LOCKS_EXCLUDED(mutex_);
  // Once: why nothing is kept any more though it was wanted, and how much it would take.
  std::optional<absl::Status> TakeWarning() ABSL_LOCKS_EXCLUDED(mutex_);
  // Whoever waits, or comes later, gets 'status'.
  void End(const absl::Status& status) ABSL_LOCKS_EXCLUDED(mutex_);
  // For the reader of an error: the newest frame that was given to a call; empty before the first.
  std::string LastFrameSent() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  absl::Status TooSmall() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const int64_t buffer_bytes_;
  mutable absl::Mutex mutex_;
  ReplayBuffer buffer_ ABSL_GUARDED_BY(mutex_);
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
  bool interrupted_ ABSL_GUARDED_BY(mutex_) = true;
  std::optional<absl::Status> warning_ ABSL_GUARDED_BY(mutex_);  // not taken yet
  std::optional<absl::Status> end_ ABSL_GUARDED_BY(mutex_);
  int64_t last_frame_ ABSL_GUARDED_BY(mutex_) = -1;
};

}  // namespace holdfast
