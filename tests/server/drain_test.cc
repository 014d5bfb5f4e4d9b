// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <thread>

#include "server/lifecycle.h"
#include "tests/support/fake_engine.h"
#include "tests/support/status_matchers.h"
#include "tests/support/test_server.h"
#include "tests/support/track_call.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

// Refused calls are how a client sees that the drain has begun.
absl::Status AwaitRefusal(const std::shared_ptr<grpc::Channel>& channel) {
  absl::Status status;
  while (status.ok()) status = TrackCall(channel, JpegConfig()).FinishAndReadToEnd();
  return status;
}

TEST(LifecycleTest, GoesForwardOnly) {
  Lifecycle lifecycle;
  EXPECT_EQ(lifecycle.state(), LifecycleState::kLoading);
  EXPECT_TRUE(lifecycle.Advance(LifecycleState::kDraining));
  EXPECT_FALSE(lifecycle.Advance(LifecycleState::kServing));
  EXPECT_FALSE(lifecycle.Advance(LifecycleState::kDraining));
  EXPECT_EQ(lifecycle.state(), LifecycleState::kDraining);
}

TEST(DrainTest, RunningSessionsFinishAndNewOnesAreRefused) {
  FakeEngine engine;
  TestServer server(&engine);
  const auto channel = server.NewChannel();
  TrackCall running(channel, JpegConfig());
  running.SendFrame(0);
  std::thread drain([&] { server.server().Drain(); });
  EXPECT_THAT(AwaitRefusal(channel), StatusIs(absl::StatusCode::kUnavailable, HasSubstr("shutting down")));
  EXPECT_EQ(server.server().state(), LifecycleState::kDraining);
  running.SendFrame(1);
  EXPECT_THAT(running.FinishAndReadToEnd(), IsOk());
  EXPECT_THAT(running.tracks[7], SizeIs(2));
  drain.join();
  EXPECT_EQ(server.server().state(), LifecycleState::kStopped);
}

TEST(DrainTest, SessionsThatOutlastTheGracePeriodGetTheirResultsAndUnavailable) {
  FakeEngine engine;
  TestServer server(&engine);
  const auto channel = server.NewChannel();
  TrackCall running(channel, JpegConfig());
  TrackCall silent(channel);  // has not sent its config
  running.SendFrames(3);
  engine.AwaitFramesTaken(3);
  std::thread drain([&] { server.server().Drain(); });
  EXPECT_THAT(AwaitRefusal(channel), StatusIs(absl::StatusCode::kUnavailable));
  server.clock().Advance(absl::Seconds(21));
  EXPECT_THAT(running.ReadToEnd(), StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(running.tracks[7], SizeIs(3));
  for (const auto& [frame, sample] : running.tracks[7]) EXPECT_TRUE(sample.final) << frame;
  EXPECT_FALSE(silent.ReadToEnd().ok());
  drain.join();
  EXPECT_EQ(engine.live_sessions(), 0);
}

TEST(DrainTest, AClientThatDoesNotReadCannotHoldItUp) {
  FakeEngine::Options options;
  options.padding_samples = 500'000;
  FakeEngine engine(options);
  TestServer server(&engine);
  const auto channel = server.NewChannel();
  TrackCall stuck(channel, JpegConfig());
  stuck.SendFrames(20);
  engine.AwaitFramesTaken(1);
  std::thread drain([&] { server.server().Drain(); });
  EXPECT_THAT(AwaitRefusal(server.NewChannel()), StatusIs(absl::StatusCode::kUnavailable));
  server.clock().Advance(absl::Seconds(31));
  drain.join();
  EXPECT_FALSE(stuck.ReadToEnd().ok());
}

TEST(DrainTest, AServerThatGoesAwayCutsItsStreamsOff) {
  FakeEngine engine;
  auto server = std::make_unique<TestServer>(&engine);
  TrackCall call(server->NewChannel(), JpegConfig());
  call.SendFrame(0);
  server.reset();
  EXPECT_FALSE(call.ReadToEnd().ok());
  EXPECT_EQ(engine.live_sessions(), 0);
}

}  // namespace
}  // namespace holdfast
