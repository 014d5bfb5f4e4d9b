// SPDX-License-Identifier: Apache-2.0
#include "client/send_queue.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

constexpr size_t kMaxUnsent = 2;  // the caller makes the next frame while one is written
constexpr double kMebi = 1 << 20;

}  // namespace

absl::Status SendQueue::Push(v1::TrackRequest request) {
  const auto message = std::make_shared<const v1::TrackRequest>(std::move(request));
  const int64_t bytes = ReplayBuffer::BytesOf(*message);
  absl::MutexLock lock(&mutex_);
  if (closed_) return absl::FailedPreconditionError("the session was finished before");
  const auto decided = [this, bytes]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return end_ || (buffer_.unsent() < kMaxUnsent && buffer_.SpaceFor(bytes) != ReplayBuffer::Space::kLater);
  };
  mutex_.Await(absl::Condition(&decided));
  if (end_) return end_->ok() ? absl::FailedPreconditionError("the server has ended the session") : *end_;
  if (buffer_.SpaceFor(bytes) == ReplayBuffer::Space::kNever) {
    warning_ = TooSmall();
    buffer_.KeepNothing();
  }
  buffer_.Append(message);
  return absl::OkStatus();
}

absl::Status SendQueue::TooSmall() const {
  const int64_t frames = std::max<int64_t>(buffer_.frames(), 1);
  const double needed = static_cast<double>(buffer_.bytes()) / static_cast<double>(frames) *
                        static_cast<double>(buffer_.frames_needed() + 1);
  return absl::ResourceExhaustedError(absl::StrCat(
      "this session cannot be resumed when its server is lost: ", buffer_.frames(), " frames fill buffer_mib, ",
      static_cast<double>(buffer_bytes_) / kMebi, " MiB, and up to ", buffer_.frames_needed() + 1,
      " have to be kept, about ", static_cast<int64_t>(needed / kMebi) + 1, " MiB"));
}

void SendQueue::Close() {
  absl::MutexLock lock(&mutex_);
  closed_ = true;
}

ReplayBuffer::Message SendQueue::Next() {
  absl::MutexLock lock(&mutex_);
  const auto decided = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return interrupted_ || closed_ || buffer_.unsent() > 0;
  };
  mutex_.Await(absl::Condition(&decided));
  if (interrupted_) return nullptr;
  ReplayBuffer::Message message = buffer_.TakeUnsent();
  if (message != nullptr && message->has_frame()) last_frame_ = std::max(last_frame_, message->frame().index());
  return message;
}

bool SendQueue::Restart(const SessionAccepted& accepted) {
  absl::MutexLock lock(&mutex_);
  if (!buffer_.Rewind(accepted.first_frame)) return false;
  if (accepted.replay_frames == 0 || accepted.checkpoint_interval_frames == 0) buffer_.KeepNothing();
  // A checkpoint is made when a window has run: up to a hop later than the interval says, and up to a hop of frames
  // wait for their window.
  buffer_.SetFramesNeeded(accepted.replay_frames + accepted.checkpoint_interval_frames + 2 * accepted.hop_frames);
  interrupted_ = false;
  return true;
}

void SendQueue::Interrupt() {
  absl::MutexLock lock(&mutex_);
  interrupted_ = true;
}

bool SendQueue::DropBefore(int64_t frame) {
  absl::MutexLock lock(&mutex_);
  return buffer_.DropBefore(frame);
}

void SendQueue::KeepNothing() {
  absl::MutexLock lock(&mutex_);
  buffer_.KeepNothing();
}

std::optional<absl::Status> SendQueue::TakeWarning() {
  absl::MutexLock lock(&mutex_);
  return std::exchange(warning_, std::nullopt);
}

bool SendQueue::keeps() const {
  absl::MutexLock lock(&mutex_);
  return buffer_.keeps();
}

void SendQueue::End(const absl::Status& status) {
  absl::MutexLock lock(&mutex_);
  end_ = status;
}

std::string SendQueue::LastFrameSent() const {
  absl::MutexLock lock(&mutex_);
  return last_frame_ < 0 ? "" : absl::StrCat(" (the last frame sent is ", last_frame_, ")");
}

}  // namespace holdfast
