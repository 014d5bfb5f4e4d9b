// SPDX-License-Identifier: Apache-2.0
#include "client/replay_buffer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using Space = ReplayBuffer::Space;

constexpr int64_t kPlenty = 1 << 20;

ReplayBuffer::Message FrameMessage(int64_t index, size_t bytes = 100) {
  auto message = std::make_shared<v1::TrackRequest>();
  message->mutable_frame()->set_index(index);
  message->mutable_frame()->set_data(std::string(bytes, 'f'));
  return message;
}

ReplayBuffer::Message AddMessage(uint64_t id) {
  auto message = std::make_shared<v1::TrackRequest>();
  message->mutable_add_points()->add_points()->set_id(id);
  return message;
}

ReplayBuffer::Message RemoveMessage(uint64_t id) {
  auto message = std::make_shared<v1::TrackRequest>();
  message->mutable_remove_points()->add_ids(id);
  return message;
}

// Takes all there is to send: "frame 3", "add 7", "remove 7".
std::vector<std::string> Sent(ReplayBuffer& buffer) {
  std::vector<std::string> sent;
  while (const ReplayBuffer::Message message = buffer.TakeUnsent()) {
    if (message->has_frame()) sent.push_back(absl::StrCat("frame ", message->frame().index()));
    if (message->has_add_points()) sent.push_back(absl::StrCat("add ", message->add_points().points(0).id()));
    if (message->has_remove_points()) sent.push_back(absl::StrCat("remove ", message->remove_points().ids(0)));
  }
  return sent;
}

// Frames 0 .. frames - 1, after an "add 1"; after each frame f comes an "add 10 + f".
void Fill(ReplayBuffer& buffer, int64_t frames) {
  buffer.Append(AddMessage(1));
  for (int64_t i = 0; i < frames; ++i) {
    buffer.Append(FrameMessage(i));
    buffer.Append(AddMessage(10 + i));
  }
}

TEST(ReplayBufferTest, SendsInOrderAndAgainAfterRewinding) {
  ReplayBuffer buffer(kPlenty, true);
  Fill(buffer, 2);
  buffer.Append(RemoveMessage(7));
  EXPECT_EQ(buffer.unsent(), 6u);
  const auto all = ElementsAre("add 1", "frame 0", "add 10", "frame 1", "add 11", "remove 7");
  EXPECT_THAT(Sent(buffer), all);
  EXPECT_EQ(buffer.unsent(), 0u);
  EXPECT_TRUE(buffer.Rewind(0));
  EXPECT_THAT(Sent(buffer), all);
  EXPECT_EQ(buffer.frames(), 2);
}

TEST(ReplayBufferTest, ACheckpointLetsGoWhatItCovers) {
  ReplayBuffer buffer(kPlenty, true);
  Fill(buffer, 4);
  Sent(buffer);
  const int64_t before = buffer.bytes();
  EXPECT_TRUE(buffer.DropBefore(2));
  EXPECT_LT(buffer.bytes(), before);
  EXPECT_EQ(buffer.frames(), 2);
  EXPECT_TRUE(buffer.Rewind(2));
  EXPECT_THAT(Sent(buffer), ElementsAre("frame 2", "add 12", "frame 3", "add 13"));
}

TEST(ReplayBufferTest, FramesThatWereNotSentYetStayUnsent) {
  ReplayBuffer buffer(kPlenty, true);
  for (int64_t i = 0; i < 4; ++i) buffer.Append(FrameMessage(i));
  buffer.TakeUnsent();
  buffer.TakeUnsent();
  EXPECT_TRUE(buffer.DropBefore(1));
  EXPECT_EQ(buffer.unsent(), 2u);
  EXPECT_TRUE(buffer.DropBefore(3));  // none that a server can mean
  EXPECT_THAT(Sent(buffer), ElementsAre("frame 2", "frame 3"));
}

TEST(ReplayBufferTest, TheNewestFrameStaysForWhatFollowsIt) {
  ReplayBuffer buffer(kPlenty, true);
  Fill(buffer, 3);
  Sent(buffer);
  EXPECT_TRUE(buffer.DropBefore(3));
  buffer.Append(AddMessage(20));
  buffer.Append(FrameMessage(3));
  EXPECT_TRUE(buffer.Rewind(3));
  EXPECT_THAT(Sent(buffer), ElementsAre("frame 2", "add 12", "add 20", "frame 3"));
}

TEST(ReplayBufferTest, FramesThatAreGoneAreNotPromised) {
  ReplayBuffer buffer(kPlenty, true);
  Fill(buffer, 6);
  Sent(buffer);
  EXPECT_TRUE(buffer.DropBefore(4));
  EXPECT_FALSE(buffer.DropBefore(2));
  EXPECT_FALSE(buffer.Rewind(3));
  EXPECT_TRUE(buffer.Rewind(4));
}

TEST(ReplayBufferTest, BeforeTheFirstFrameThereIsNothingToLetGo) {
  ReplayBuffer buffer(kPlenty, true);
  EXPECT_TRUE(buffer.DropBefore(0));
  EXPECT_TRUE(buffer.Rewind(0));
  buffer.Append(AddMessage(1));
  Sent(buffer);
  EXPECT_TRUE(buffer.DropBefore(0));
  EXPECT_TRUE(buffer.Rewind(0));
  EXPECT_THAT(Sent(buffer), ElementsAre("add 1"));
}

TEST(ReplayBufferTest, WithoutKeepingMessagesGoWhenTheyAreSentAndThereIsAlwaysSpace) {
  ReplayBuffer buffer(10, false);
  Fill(buffer, 2);
  EXPECT_EQ(buffer.SpaceFor(kPlenty), Space::kHere);
  EXPECT_EQ(Sent(buffer).size(), 5u);
  EXPECT_EQ(buffer.bytes(), 0);
  EXPECT_EQ(buffer.frames(), 0);
}

TEST(ReplayBufferTest, ItCanStopKeepingInTheMiddle) {
  ReplayBuffer buffer(kPlenty, true);
  Fill(buffer, 3);
  for (int i = 0; i < 3; ++i) buffer.TakeUnsent();
  buffer.KeepNothing();
  EXPECT_FALSE(buffer.keeps());
  EXPECT_EQ(buffer.frames(), 2);
  EXPECT_THAT(Sent(buffer), ElementsAre("frame 1", "add 11", "frame 2", "add 12"));
  EXPECT_EQ(buffer.bytes(), 0);
}

TEST(ReplayBufferTest, AFullBufferHasSpaceLaterIfItHoldsMoreThanCheckpointsLeave) {
  const int64_t frame_bytes = ReplayBuffer::BytesOf(*FrameMessage(1));
  ReplayBuffer buffer(5 * frame_bytes, true);
  buffer.SetFramesNeeded(4);
  for (int64_t i = 0; i < 4; ++i) {
    EXPECT_EQ(buffer.SpaceFor(frame_bytes), Space::kHere);
    buffer.Append(FrameMessage(i));
  }
  EXPECT_EQ(buffer.SpaceFor(2 * frame_bytes), Space::kNever);
  buffer.Append(FrameMessage(4));
  EXPECT_EQ(buffer.SpaceFor(frame_bytes), Space::kLater);
  Sent(buffer);
  EXPECT_TRUE(buffer.DropBefore(2));
  EXPECT_EQ(buffer.SpaceFor(2 * frame_bytes), Space::kHere);
}

TEST(ReplayBufferTest, ManySmallMessagesFillItToo) {
  ReplayBuffer buffer(10'000, true);
  int messages = 0;
  for (; buffer.SpaceFor(ReplayBuffer::BytesOf(*AddMessage(1))) == Space::kHere; ++messages) {
    buffer.Append(AddMessage(1));
  }
  EXPECT_LT(messages, 50);
  EXPECT_EQ(buffer.SpaceFor(1000), Space::kNever);
}

}  // namespace
}  // namespace holdfast
