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

using ::testing::AnyOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
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

TEST(DrainTest, SessionsThatOutlastTheGracePeriodAreToldAndGetACheckpointAndUnavailable) {
  FakeEngine engine;
  TestServer server(&engine);
  const auto channel = server.NewChannel();
  TrackCall running(channel, JpegConfig());
  TrackCall silent(channel);  // has not sent its config
  running.SendFrames(3);
  engine.AwaitFramesTaken(3);
  std::thread drain([&] { server.server().Drain(); });
  while (running.times_left.empty()) ASSERT_TRUE(running.ReadOne());
  EXPECT_THAT(running.times_left, ElementsAre(20));
  EXPECT_THAT(running.checkpoints, IsEmpty());
  server.clock().Advance(absl::Seconds(21));
  EXPECT_THAT(running.ReadToEnd(), StatusIs(absl::StatusCode::kUnavailable, HasSubstr("shutting down")));
  EXPECT_THAT(running.times_left, SizeIs(1));
  EXPECT_THAT(running.tracks[7], SizeIs(3));
  ASSERT_THAT(running.checkpoints, SizeIs(1));
  EXPECT_EQ(running.checkpoints[0].token(), "token-3");
  EXPECT_EQ(running.checkpoints[0].next_frame(), 3);
  EXPECT_EQ(running.kinds.back(), v1::TrackResponse::kCheckpoint);
  EXPECT_FALSE(silent.ReadToEnd().ok());
  EXPECT_THAT(silent.kinds, IsEmpty());
  drain.join();
  EXPECT_EQ(engine.live_sessions(), 0);
}

// A stream begins, then a drain, then the stream's session. False: the drain came first, and the stream was refused.
bool SessionThatBeginsDuringTheDrainIsTold() {
  FakeEngine engine;
  TestServer server(&engine);
  const auto channel = server.NewChannel();
  TrackCall late(channel);
  TrackCall running(channel, JpegConfig());
  std::thread drain([&] { server.server().Drain(); });
  while (running.times_left.empty()) EXPECT_TRUE(running.ReadOne());
  server.clock().Advance(absl::Seconds(8));
  late.SendConfig(ToProto(JpegConfig()));
  while (late.times_left.empty() && late.ReadOne()) {
  }
  const bool admitted = !late.kinds.empty();
  if (admitted) {
    EXPECT_THAT(late.kinds, ElementsAre(v1::TrackResponse::kAccepted, v1::TrackResponse::kGoingAway));
    EXPECT_THAT(late.times_left, ElementsAre(AnyOf(12, 20)));  // as of the housekeeper's last look at the clock
  }
  EXPECT_EQ(late.FinishAndReadToEnd().ok(), admitted);
  EXPECT_THAT(running.FinishAndReadToEnd(), IsOk());
  drain.join();
  return admitted;
}

TEST(DrainTest, SessionsThatBeginDuringTheDrainAreToldToo) {
  while (!SessionThatBeginsDuringTheDrainIsTold()) {
  }
}

TEST(DrainTest, WithoutAGracePeriodSessionsAreSuspendedAtOnce) {
  FakeEngine engine;
  ServerOptions options;
  options.grace_period = absl::ZeroDuration();
  TestServer server(&engine, options);
  TrackCall running(server.NewChannel(), JpegConfig());
  running.SendFrame(0);
  engine.AwaitFramesTaken(1);
  std::thread drain([&] { server.server().Drain(); });
  EXPECT_THAT(running.ReadToEnd(), StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(running.times_left, ElementsAre(0));
  ASSERT_THAT(running.checkpoints, SizeIs(1));
  EXPECT_EQ(running.checkpoints[0].next_frame(), 1);
  drain.join();
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
