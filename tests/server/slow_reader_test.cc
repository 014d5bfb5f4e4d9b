// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>

#include "tests/support/fake_engine.h"
#include "tests/support/status_matchers.h"
#include "tests/support/test_server.h"
#include "tests/support/track_call.h"

namespace holdfast {
namespace {

using ::testing::SizeIs;

constexpr int64_t kSamples = 20'000;  // a frame gives 260 kB of results
constexpr int64_t kSampleBytes = 13;
constexpr int64_t kFrames = 240;  // 62 MB in all
// What the server holds and what the connection buffers, in the socket and in gRPC on both sides, which grows to some
// 30 MB where the reader's threads get little time.
constexpr int64_t kMostUnread = 40 << 20;

FakeEngine::Options Padded() {
  FakeEngine::Options options;
  options.padding_samples = kSamples;
  return options;
}

TEST(SlowReaderTest, IsNotReadFromWhileItsResultsWaitAndThenGetsThemAll) {
  FakeEngine engine(Padded());
  std::atomic<int64_t> read{0};
  std::atomic<int64_t> most_unread{0};
  engine.on_frame = [&, produced = int64_t{0}](const Frame&) mutable {
    most_unread = std::max(most_unread.load(), produced - read.load());
    produced += kSamples * kSampleBytes;
  };
  TestServer server(&engine);
  TrackCall call(server.NewChannel(), JpegConfig());
  call.SendFrames(kFrames);  // small: all of them fit into the connection's buffers
  call.HalfClose();
  engine.AwaitFramesTaken(6);
  while (call.ReadOne()) read = call.bytes_read;
  EXPECT_THAT(call.ReadToEnd(), IsOk());
  EXPECT_THAT(call.tracks[FakeEngine::kPaddingPoint], SizeIs(kFrames * kSamples));
  EXPECT_THAT(call.tracks[7], SizeIs(kFrames));
  EXPECT_LT(most_unread, kMostUnread);
}

TEST(SlowReaderTest, IsCutOffWhenItReadsNothingForTooLong) {
  FakeEngine engine(Padded());
  TestServer server(&engine);
  TrackCall stuck(server.NewChannel(), JpegConfig());
  stuck.SendFrames(kFrames);
  engine.AwaitFramesTaken(6);
  std::vector<std::unique_ptr<TrackCall>> watchers;
  // Time passes until the server has seen that nothing was read; each watcher shows that it lives.
  while (engine.live_sessions() > 0) {
    server.clock().Advance(absl::Minutes(1));
    EXPECT_THAT(TrackCall(server.NewChannel()).FinishAndReadToEnd(), StatusIs(absl::StatusCode::kInvalidArgument));
  }
  EXPECT_LT(engine.frames_taken() * kSamples * kSampleBytes, kMostUnread);
  EXPECT_THAT(stuck.ReadToEnd(), StatusIs(absl::StatusCode::kCancelled));
}

}  // namespace
}  // namespace holdfast
