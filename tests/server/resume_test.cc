// SPDX-License-Identifier: Apache-2.0
// Checkpoints on their way to a client, and streams that begin with a token. What a drain does is in drain_test.cc.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "tests/support/fake_engine.h"
#include "tests/support/status_matchers.h"
#include "tests/support/test_server.h"
#include "tests/support/track_call.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

SessionConfig ResumedConfig(std::string token) {
  SessionConfig config = JpegConfig({});
  config.resume_token = std::move(token);
  return config;
}

TEST(ResumeTest, ACheckpointComesBehindTheResultsThatItCountsOn) {
  FakeEngine engine;
  TestServer server(&engine);
  TrackCall call(server.NewChannel(), JpegConfig());
  call.SendFrame(0);
  call.SendFrame(1, "checkpoint");
  while (call.checkpoints.empty()) ASSERT_TRUE(call.ReadOne());
  EXPECT_EQ(call.checkpoints[0].token(), "token-2");
  EXPECT_EQ(call.checkpoints[0].next_frame(), 2);
  EXPECT_TRUE(call.checkpoints[0].resumable());
  EXPECT_THAT(call.tracks[7], SizeIs(2));
  call.SendFrame(2);
  EXPECT_THAT(call.FinishAndReadToEnd(), IsOk());
  EXPECT_THAT(call.checkpoints, SizeIs(1));
  EXPECT_THAT(server.metrics().Text(), HasSubstr("holdfast_checkpoints_total 1\n"));
  EXPECT_THAT(server.metrics().Text(), HasSubstr("holdfast_checkpoint_bytes_sum 7\n"));
}

// Results never cease, and the reader is behind from beginning to end: checkpoints come all the same, each behind its
// results, and what was not sent in time is dropped for the newest.
TEST(ResumeTest, OneCheckpointWaitsForAClientThatDoesNotRead) {
  constexpr int kFrames = 100;
  FakeEngine::Options options;
  options.padding_samples = 20'000;
  FakeEngine engine(options);
  TestServer server(&engine);
  TrackCall call(server.NewChannel(), JpegConfig());
  for (int64_t i = 0; i < kFrames; ++i) call.SendFrame(i, "checkpoint");
  call.HalfClose();
  engine.AwaitFramesTaken(6);
  size_t seen = 0;
  while (call.ReadOne()) {
    if (call.checkpoints.size() == seen) continue;
    const int64_t next_frame = call.checkpoints[seen++].next_frame();
    EXPECT_THAT(call.tracks[7], SizeIs(testing::Ge(next_frame)));
    EXPECT_THAT(call.tracks[FakeEngine::kPaddingPoint], SizeIs(testing::Ge(next_frame * options.padding_samples)));
  }
  EXPECT_THAT(call.ReadToEnd(), IsOk());
  ASSERT_GE(seen, 1U);
  EXPECT_LT(seen, size_t{kFrames});
  EXPECT_EQ(call.checkpoints.back().next_frame(), kFrames);
}

TEST(ResumeTest, StreamsThatBeginWithATokenAreCounted) {
  FakeEngine engine;
  TestServer server(&engine);
  const auto channel = server.NewChannel();
  EXPECT_THAT(TrackCall(channel, JpegConfig()).FinishAndReadToEnd(), IsOk());
  EXPECT_THAT(server.metrics().Text(), HasSubstr("holdfast_resumes_total{result=\"resumed\"} 0\n"));
  EXPECT_THAT(TrackCall(channel, ResumedConfig("token-3")).FinishAndReadToEnd(), IsOk());
  SessionConfig wrong = ResumedConfig("token-3");
  wrong.hop_frames = 1000;
  EXPECT_THAT(TrackCall(channel, wrong).FinishAndReadToEnd(), StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(server.metrics().Text(), HasSubstr("holdfast_resumes_total{result=\"resumed\"} 1\n"));
  EXPECT_THAT(server.metrics().Text(), HasSubstr("holdfast_resumes_total{result=\"refused\"} 1\n"));
}

TEST(ResumeTest, TheLongestTokenIsTakenWhereFramesAreSmall) {
  FakeEngine engine;
  ServerOptions options;
  options.engine.limits.max_frame_bytes = 1 << 20;
  TestServer server(&engine, options);
  TrackCall call(server.NewChannel(), ResumedConfig(std::string(kMaxTokenBytes, 't')));
  call.SendFrame(0);
  EXPECT_THAT(call.FinishAndReadToEnd(), IsOk());
}

TEST(ResumeTest, AnOverloadIsNoWrongToken) {
  FakeEngine engine(FakeEngine::Options{/*max_sessions=*/1});
  TestServer server(&engine);
  const auto channel = server.NewChannel();
  TrackCall waiting(channel);  // admitted while there is a place
  engine.AwaitPlacesAskedFor(1);
  TrackCall other(channel, JpegConfig());
  waiting.SendConfig(ToProto(ResumedConfig("token-3")));
  EXPECT_THAT(waiting.ReadToEnd(), StatusIs(absl::StatusCode::kResourceExhausted));
  EXPECT_THAT(server.metrics().Text(), HasSubstr("holdfast_resumes_total{result=\"refused\"} 0\n"));
  EXPECT_THAT(server.metrics().Text(), HasSubstr("holdfast_resumes_total{result=\"overloaded\"} 1\n"));
}

TEST(ResumeTest, ASessionThatEndsForAMistakeOrByItselfGetsNoCheckpoint) {
  FakeEngine engine;
  TestServer server(&engine);
  const auto channel = server.NewChannel();
  TrackCall bad(channel, JpegConfig());
  bad.SendFrame(0);
  bad.SendFrame(7);
  EXPECT_THAT(bad.ReadToEnd(), StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(bad.checkpoints, IsEmpty());
  TrackCall idle(channel, JpegConfig());
  EXPECT_THAT(ReadWhileTimePasses(idle, server.clock(), absl::Seconds(30)),
              StatusIs(absl::StatusCode::kDeadlineExceeded));
  EXPECT_THAT(idle.kinds, IsEmpty());
}

}  // namespace
}  // namespace holdfast
