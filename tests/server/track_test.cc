// SPDX-License-Identifier: Apache-2.0
// Streams that go as they should.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/fake_engine.h"
#include "tests/support/status_matchers.h"
#include "tests/support/test_server.h"
#include "tests/support/track_call.h"

namespace holdfast {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

class TrackTest : public ::testing::Test {
 protected:
  FakeEngine engine_;
  TestServer server_{&engine_};
  std::shared_ptr<grpc::Channel> channel_ = server_.NewChannel();
};

// Every frame of the point is known, final and where the fake engine puts it.
void ExpectAllFinal(const TrackCall& call, PointId id, int64_t first, int64_t end, float x) {
  ASSERT_EQ(call.tracks.count(id), 1U);
  const auto& track = call.tracks.at(id);
  EXPECT_THAT(track, SizeIs(end - first));
  for (const auto& [frame, sample] : track) {
    EXPECT_TRUE(sample.final) << "frame " << frame;
    EXPECT_EQ(sample.x, x + static_cast<float>(frame));
  }
}

TEST_F(TrackTest, ASessionIsAcceptedTrackedAndSummedUp) {
  TrackCall call(channel_, JpegConfig());
  EXPECT_EQ(call.accepted().window_frames(), 24U);
  EXPECT_EQ(call.accepted().limits().max_points(), 2048U);
  call.SendFrames(30);
  ASSERT_THAT(call.FinishAndReadToEnd(), IsOk());
  ExpectAllFinal(call, 7, 0, 30, 10);
  ASSERT_THAT(call.summaries, SizeIs(1));
  EXPECT_EQ(call.summaries[0].frames, 30);
  EXPECT_EQ(call.summaries[0].final_samples, 30);
  EXPECT_EQ(call.frames_processed, 30);
}

TEST_F(TrackTest, ASessionBelongsToItsCallersTrace) {
  TrackCall call(channel_, "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01");
  ASSERT_TRUE(call.SendConfig(ToProto(JpegConfig())));
  ASSERT_TRUE(call.ReadAccepted());
  EXPECT_EQ(call.accepted().trace_id(), "4bf92f3577b34da6a3ce929d0e0e4736");
  EXPECT_THAT(call.FinishAndReadToEnd(), IsOk());
  const TrackCall other(channel_, JpegConfig());
  EXPECT_THAT(other.accepted().trace_id(), ::testing::MatchesRegex("[0-9a-f]{32}"));
}

TEST_F(TrackTest, ResultsComeWhileFramesAreStillSent) {
  TrackCall call(channel_, JpegConfig());
  call.SendFrame(0);
  ASSERT_TRUE(call.ReadOne());
  EXPECT_FALSE(call.tracks[7][0].final);
  call.SendFrame(1);
  ASSERT_TRUE(call.ReadOne());
  EXPECT_TRUE(call.tracks[7][0].final);
  EXPECT_FALSE(call.tracks[7][1].final);
  EXPECT_THAT(call.FinishAndReadToEnd(), IsOk());
}

TEST_F(TrackTest, ProvisionalEstimatesAreLeftOutOnRequest) {
  SessionConfig config = JpegConfig();
  config.send_provisional = false;
  TrackCall call(channel_, config);
  call.SendFrame(0);
  call.SendFrame(1);
  while (call.tracks.empty()) ASSERT_TRUE(call.ReadOne());
  EXPECT_TRUE(call.tracks[7][0].final);
  EXPECT_EQ(call.tracks[7].count(1), 0U);
  EXPECT_THAT(call.FinishAndReadToEnd(), IsOk());
}

TEST_F(TrackTest, PointsAreAddedOnAFrameOrBetweenFramesAndRemoved) {
  TrackCall call(channel_, JpegConfig({}));
  call.SendFrame(0);
  call.SendFrame(1, "good", {{1, 100, 5}});
  v1::TrackRequest request;
  *request.mutable_add_points() = AddPointsToProto({{2, 200, 5}});
  call.Send(request);
  call.SendFrame(2);
  *request.mutable_remove_points() = RemovePointsToProto({1, 99});
  call.Send(request);
  call.SendFrame(3);
  ASSERT_THAT(call.FinishAndReadToEnd(), IsOk());
  EXPECT_EQ(call.tracks[1].begin()->first, 1);
  EXPECT_EQ(call.tracks[1].count(3), 0U);
  ExpectAllFinal(call, 2, 2, 4, 200);
}

TEST_F(TrackTest, AStreamWithoutFramesEndsWell) {
  TrackCall call(channel_, JpegConfig());
  ASSERT_THAT(call.FinishAndReadToEnd(), IsOk());
  EXPECT_THAT(call.tracks, IsEmpty());
  EXPECT_THAT(call.summaries, SizeIs(1));
}

TEST_F(TrackTest, WarningsArriveAndTheSessionGoesOn) {
  TrackCall call(channel_, JpegConfig());
  call.SendFrame(0, "warn");
  call.SendFrame(1);
  ASSERT_THAT(call.FinishAndReadToEnd(), IsOk());
  ASSERT_THAT(call.warnings, SizeIs(1));
  EXPECT_THAT(call.warnings[0], StatusIs(absl::StatusCode::kUnavailable));
  ExpectAllFinal(call, 7, 0, 2, 10);
}

TEST_F(TrackTest, AFullEngineSlowsTheClientDownAndLosesNothing) {
  engine_.Hold();
  TrackCall call(channel_, JpegConfig());
  call.SendFrames(50);  // small: they wait in the connection
  engine_.AwaitFramesTaken(4);
  EXPECT_EQ(engine_.frames_taken(), 4) << "more than the engine has room for";
  engine_.Release();
  ASSERT_THAT(call.FinishAndReadToEnd(), IsOk());
  ExpectAllFinal(call, 7, 0, 50, 10);
}

TEST_F(TrackTest, SessionsRunSideBySide) {
  std::vector<std::unique_ptr<TrackCall>> calls;
  for (int i = 0; i < 8; ++i) {
    calls.push_back(std::make_unique<TrackCall>(channel_, JpegConfig({{7, 10.0F * static_cast<float>(i), 0}})));
  }
  for (int64_t frame = 0; frame < 20; ++frame) {
    for (auto& call : calls) call->SendFrame(frame);
  }
  for (int i = 0; i < 8; ++i) {
    ASSERT_THAT(calls[i]->FinishAndReadToEnd(), IsOk());
    ExpectAllFinal(*calls[i], 7, 0, 20, 10.0F * static_cast<float>(i));
  }
}

TEST_F(TrackTest, ResultsLargerThanAMessageMayBeAreSplit) {
  FakeEngine::Options options;
  options.padding_samples = 700'000;  // about 9 MB of results
  FakeEngine engine(options);
  TestServer server(&engine);
  TrackCall call(server.NewChannel(), JpegConfig());
  call.SendFrame(0);
  ASSERT_THAT(call.FinishAndReadToEnd(), IsOk());
  EXPECT_THAT(call.tracks[FakeEngine::kPaddingPoint], SizeIs(700'000));
  EXPECT_GT(call.messages_read, 8);
}

}  // namespace
}  // namespace holdfast
