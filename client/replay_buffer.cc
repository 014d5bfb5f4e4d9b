// SPDX-License-Identifier: Apache-2.0
#include "client/replay_buffer.h"

#include <utility>

namespace holdfast {
namespace {

constexpr int64_t kOverheadBytes = 256;  // of a message's objects: many small ones are bounded too

}  // namespace

int64_t ReplayBuffer::BytesOf(const v1::TrackRequest& request) {
  return static_cast<int64_t>(request.ByteSizeLong()) + kOverheadBytes;
}

ReplayBuffer::Space ReplayBuffer::SpaceFor(int64_t bytes) const {
  if (!keeps_ || bytes_ + bytes <= max_bytes_) return Space::kHere;
  return frames_ <= frames_needed_ ? Space::kNever : Space::kLater;
}

void ReplayBuffer::Append(Message message) {
  bytes_ += BytesOf(*message);
  frames_ += message->has_frame() ? 1 : 0;
  messages_.push_back(std::move(message));
}

ReplayBuffer::Message ReplayBuffer::TakeUnsent() {
  if (unsent() == 0) return nullptr;
  Message message = messages_[sent_++];
  if (!keeps_) PopFront();
  return message;
}

bool ReplayBuffer::Rewind(int64_t first_frame) {
  sent_ = 0;
  for (const Message& message : messages_) {
    if (message->has_frame()) return message->frame().index() <= first_frame;
  }
  return true;
}

bool ReplayBuffer::DropBefore(int64_t frame) {
  size_t begin = messages_.size();  // of what stays
  for (size_t i = 0; i < messages_.size(); ++i) {
    if (!messages_[i]->has_frame()) continue;
    if (messages_[i]->frame().index() > frame) break;
    begin = i;
  }
  if (begin == messages_.size()) return frames_ == 0;
  while (begin-- > 0 && sent_ > 0) PopFront();
  return true;
}

void ReplayBuffer::KeepNothing() {
  keeps_ = false;
  while (sent_ > 0) PopFront();
}

void ReplayBuffer::PopFront() {
  bytes_ -= BytesOf(*messages_.front());
  frames_ -= messages_.front()->has_frame() ? 1 : 0;
  messages_.pop_front();
  --sent_;
}

}  // namespace holdfast
