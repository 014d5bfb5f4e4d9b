// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>

#include "holdfast/v1/point_tracking.pb.h"

namespace holdfast {

// The messages of one session that are still to be sent, and those that were sent and may have to be sent again, in the
// order of the stream. Bounded while it keeps: who appends asks for room first. Not thread-safe.
class ReplayBuffer {
 public:
  using Message = std::shared_ptr<const v1::TrackRequest>;
  enum class Space {
    kHere,
    kLater,  // once a checkpoint lets older messages go
    kNever,  // all that is here may have to be sent again: no checkpoint lets anything go
  };

  // 'keep': messages stay when they have been sent.
  ReplayBuffer(int64_t max_bytes, bool keep) : max_bytes_(max_bytes), keeps_(keep) {}

  // The newest checkpoint may lie so many frames behind what was sent.
  void SetFramesNeeded(int64_t frames) { frames_needed_ = frames; }
  static int64_t BytesOf(const v1::TrackRequest& request);
  Space SpaceFor(int64_t bytes) const;
  void Append(Message message);

  // The oldest message that was not sent yet, which counts as sent from now on; null when there is none.
  Message TakeUnsent();
  // All that is here is to be sent again, for a session that begins at 'first_frame'. False: older frames would be
  // needed. Those that are here beside are ignored by a server.
  bool Rewind(int64_t first_frame);
  // A session can be resumed with the frames from 'frame' on, and lets go what was sent before. The newest frame stays
  // though the session goes on after it: what follows it in the stream belongs to it. False: they are not all here.
  bool DropBefore(int64_t frame);
  // From now on messages go when they are sent.
  void KeepNothing();

  bool keeps() const { return keeps_; }
  size_t unsent() const { return messages_.size() - sent_; }
  int64_t frames() const { return frames_; }
  int64_t bytes() const { return bytes_; }
  int64_t frames_needed() const { return frames_needed_; }

 private:
  void PopFront();

  const int64_t max_bytes_;
  bool keeps_;
  int64_t frames_needed_ = 0;
  std::deque<Message> messages_;
  size_t sent_ = 0;     // of them, at the front
  int64_t frames_ = 0;  // of them
  int64_t bytes_ = 0;   // of all
};

}  // namespace holdfast
