// SPDX-License-Identifier: Apache-2.0
// Somebody sets the wall clock by hours while streams are open: nobody's timeout, and no drain, may notice.
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <thread>

#include "tests/support/fake_engine.h"
#include "tests/support/status_matchers.h"
#include "tests/support/test_server.h"
#include "tests/support/track_call.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

class WallClockTest : public ::testing::TestWithParam<absl::Duration> {
 protected:
  WallClockTest() : server_(&engine_), channel_(server_.NewChannel()) {}

  void SetWallClock() {
    server_.clock().SetWallBy(GetParam());
    AwaitWatch();
  }
  // Until the watch over timeouts, which asks for the time once a round, has seen every stream. A stream's last
  // messages ask too, a few times.
  void AwaitWatch() { server_.clock().AwaitSteadyReads(16); }

  FakeEngine engine_;
  TestServer server_;
  std::shared_ptr<grpc::Channel> channel_;
};

INSTANTIATE_TEST_SUITE_P(Jumps, WallClockTest, ::testing::Values(absl::Hours(7), -absl::Hours(7)),
                         [](const auto& jump) { return jump.param > absl::ZeroDuration() ? "Forward" : "Back"; });

TEST_P(WallClockTest, OpenStreamsGoOn) {
  TrackCall running(channel_, JpegConfig());
  running.SendFrame(0);
  engine_.AwaitFramesTaken(1);
  SetWallClock();
  running.SendFrame(1);
  engine_.AwaitFramesTaken(2);
  SetWallClock();
  EXPECT_THAT(running.FinishAndReadToEnd(), IsOk());
  EXPECT_THAT(running.tracks[7], SizeIs(2));
}

TEST_P(WallClockTest, TimeoutsKeepTheirTime) {
  TrackCall silent(channel_);  // sends no config
  TrackCall idle(channel_, JpegConfig());
  idle.SendFrame(0);
  engine_.AwaitFramesTaken(1);
  SetWallClock();
  server_.clock().Advance(absl::Seconds(9));
  AwaitWatch();
  // Both are still there: neither nine seconds nor seven hours ended them.
  silent.SendConfig(ToProto(JpegConfig()));
  EXPECT_TRUE(silent.ReadAccepted());
  idle.SendFrame(1);
  engine_.AwaitFramesTaken(2);
  EXPECT_THAT(ReadWhileTimePasses(idle, server_.clock(), absl::Seconds(10)),
              StatusIs(absl::StatusCode::kDeadlineExceeded, HasSubstr("6m16s")));
  EXPECT_THAT(idle.tracks[7], SizeIs(2));
  TrackCall late(channel_);
  EXPECT_THAT(ReadWhileTimePasses(late, server_.clock(), absl::Seconds(10)),
              StatusIs(absl::StatusCode::kDeadlineExceeded, HasSubstr("config")));
}

TEST_P(WallClockTest, ADrainKeepsItsGracePeriod) {
  TrackCall finishing(channel_, JpegConfig());
  TrackCall staying(channel_, JpegConfig());
  finishing.SendFrame(0);
  staying.SendFrame(0);
  engine_.AwaitFramesTaken(1);
  std::thread drain([this] { server_.server().Drain(); });
  absl::Status refused;
  while (refused.ok()) refused = TrackCall(channel_, JpegConfig()).FinishAndReadToEnd();
  SetWallClock();
  finishing.SendFrame(1);
  EXPECT_THAT(finishing.FinishAndReadToEnd(), IsOk());
  EXPECT_THAT(finishing.tracks[7], SizeIs(2));
  server_.clock().Advance(absl::Seconds(20));
  EXPECT_THAT(staying.ReadToEnd(), StatusIs(absl::StatusCode::kUnavailable, HasSubstr("shutting down")));
  drain.join();
}

}  // namespace
}  // namespace holdfast
