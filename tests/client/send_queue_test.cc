// SPDX-License-Identifier: Apache-2.0
#include "client/send_queue.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int64_t kMebi = 1 << 20;

v1::TrackRequest FrameRequest(int64_t index, size_t bytes = 100) {
  v1::TrackRequest request;
  request.mutable_frame()->set_index(index);
  request.mutable_frame()->set_data(std::string(bytes, 'f'));
  return request;
}

SessionAccepted WithCheckpoints(int replay_frames = 4, int interval = 2) {
  SessionAccepted accepted;
  accepted.replay_frames = replay_frames;
  accepted.checkpoint_interval_frames = interval;
  accepted.hop_frames = 1;
  return accepted;
}

TEST(SendQueueTest, ThePusherWaitsWhileTwoMessagesAreUnsent) {
  SendQueue queue(kMebi, true);
  ASSERT_TRUE(queue.Restart(WithCheckpoints()));
  std::atomic<int64_t> pushed{0};
  std::thread pusher([&] {
    for (int64_t i = 0; i < 20; ++i, ++pushed) EXPECT_THAT(queue.Push(FrameRequest(i)), IsOk());
  });
  for (int64_t taken = 0; taken < 20; ++taken) {
    EXPECT_LE(pushed.load(), taken + 2);
    const ReplayBuffer::Message message = queue.Next();
    ASSERT_NE(message, nullptr);
    EXPECT_EQ(message->frame().index(), taken);
  }
  pusher.join();
  EXPECT_EQ(queue.LastFrameSent(), " (the last frame sent is 19)");
}

TEST(SendQueueTest, AFullQueueHasRoomAgainAfterACheckpoint) {
  SendQueue queue(12'000, true);  // eleven frames, more than the eight that checkpoints leave
  ASSERT_TRUE(queue.Restart(WithCheckpoints()));
  std::atomic<int64_t> pushed{0};
  std::thread pusher([&] {
    for (int64_t i = 0; i < 40; ++i, ++pushed) EXPECT_THAT(queue.Push(FrameRequest(i, 800)), IsOk());
  });
  int64_t first_kept = 0;
  for (int64_t taken = 0; taken < 40; ++taken) {
    const ReplayBuffer::Message message = queue.Next();
    ASSERT_NE(message, nullptr);
    EXPECT_EQ(message->frame().index(), taken);
    if (taken < 10 || taken % 5 != 0) continue;
    EXPECT_LE(pushed.load(), first_kept + 11);
    first_kept = taken - 4;
    EXPECT_TRUE(queue.DropBefore(first_kept));
  }
  pusher.join();
}

TEST(SendQueueTest, AQueueThatCanNeverHoldEnoughSaysWhatItTakesAndKeepsNothing) {
  SendQueue queue(kMebi, true);
  ASSERT_TRUE(queue.Restart(WithCheckpoints(6, 2)));
  for (int64_t i = 0; i < 3; ++i) {
    EXPECT_THAT(queue.Push(FrameRequest(i, 300 << 10)), IsOk());
    EXPECT_NE(queue.Next(), nullptr);
  }
  EXPECT_TRUE(queue.keeps());
  EXPECT_EQ(queue.TakeWarning(), std::nullopt);
  EXPECT_THAT(queue.Push(FrameRequest(3, 300 << 10)), IsOk());
  EXPECT_FALSE(queue.keeps());
  EXPECT_EQ(queue.Next()->frame().index(), 3);
  const std::optional<absl::Status> warning = queue.TakeWarning();
  ASSERT_TRUE(warning.has_value());
  EXPECT_THAT(*warning, StatusIs(absl::StatusCode::kResourceExhausted,
                                 AllOf(HasSubstr("3 frames fill buffer_mib, 1 MiB"),
                                       HasSubstr("up to 11 have to be kept, about 4 MiB"))));
  EXPECT_EQ(queue.TakeWarning(), std::nullopt);
}

TEST(SendQueueTest, AServerWithoutCheckpointsHasNothingKept) {
  SendQueue queue(10, true);
  ASSERT_TRUE(queue.Restart(WithCheckpoints(0)));
  EXPECT_FALSE(queue.keeps());
  for (int64_t i = 0; i < 5; ++i) {
    EXPECT_THAT(queue.Push(FrameRequest(i)), IsOk());
    EXPECT_NE(queue.Next(), nullptr);
  }
}

TEST(SendQueueTest, ACallThatIsOverFreesItsWriterAndTheNextGetsAllAgain) {
  SendQueue queue(kMebi, true);
  ASSERT_TRUE(queue.Restart(WithCheckpoints()));
  EXPECT_THAT(queue.Push(FrameRequest(0)), IsOk());
  EXPECT_NE(queue.Next(), nullptr);
  std::thread writer([&queue] { EXPECT_EQ(queue.Next(), nullptr); });
  queue.Interrupt();
  writer.join();
  EXPECT_THAT(queue.Push(FrameRequest(1)), IsOk());
  ASSERT_TRUE(queue.Restart(WithCheckpoints()));
  EXPECT_EQ(queue.Next()->frame().index(), 0);
  EXPECT_EQ(queue.Next()->frame().index(), 1);
}

TEST(SendQueueTest, AServerThatBeginsBeforeWhatIsKeptIsNotFollowed) {
  SendQueue queue(kMebi, true);
  ASSERT_TRUE(queue.Restart(WithCheckpoints()));
  for (int64_t i = 0; i < 5; ++i) {
    EXPECT_THAT(queue.Push(FrameRequest(i)), IsOk());
    queue.Next();
  }
  EXPECT_TRUE(queue.DropBefore(3));
  SessionAccepted accepted = WithCheckpoints();
  accepted.first_frame = 2;
  EXPECT_FALSE(queue.Restart(accepted));
  accepted.first_frame = 3;
  EXPECT_TRUE(queue.Restart(accepted));
}

TEST(SendQueueTest, TheEndFreesThePusherAndIsWhatEveryLaterPushReturns) {
  SendQueue queue(kMebi, true);
  ASSERT_TRUE(queue.Restart(WithCheckpoints()));
  const absl::Status why = absl::UnavailableError("gone");
  std::thread pusher([&] {
    absl::Status status;
    for (int64_t i = 0; status.ok(); ++i) status = queue.Push(FrameRequest(i));
    EXPECT_EQ(status, why);
  });
  queue.End(why);
  pusher.join();
  EXPECT_EQ(queue.Push(FrameRequest(9)), why);
  EXPECT_THAT(queue.LastFrameSent(), IsEmpty());
}

TEST(SendQueueTest, AClosedQueueIsSentToItsEndAndTakesNoMore) {
  SendQueue queue(kMebi, true);
  ASSERT_TRUE(queue.Restart(WithCheckpoints()));
  EXPECT_THAT(queue.Push(FrameRequest(0)), IsOk());
  queue.Close();
  EXPECT_NE(queue.Next(), nullptr);
  EXPECT_EQ(queue.Next(), nullptr);
  EXPECT_THAT(queue.Push(FrameRequest(1)), StatusIs(absl::StatusCode::kFailedPrecondition));
}

}  // namespace
}  // namespace holdfast
