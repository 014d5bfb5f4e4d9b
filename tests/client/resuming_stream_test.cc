// SPDX-License-Identifier: Apache-2.0
// Sessions of RemoteTracker that go on when their server is lost.
#include "client/resuming_stream.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>

#include "absl/synchronization/notification.h"
#include "api/errors.h"
#include "tests/client/resume_observer.h"
#include "tests/support/tcp_proxy.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

TEST(ResumingStreamTest, AfterACutTheSessionGoesOnFromItsNewestCheckpoint) {
  ScriptedService server(CutAfter({10}));
  ResumeObserver observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 20), IsOk());
  ExpectEachFrameFinalOnce(observer, 20);
  EXPECT_EQ(observer.summary.frames, 20);
  EXPECT_THAT(observer.events, ElementsAre("accepted", "reconnecting", "resumed 6", "done"));
  EXPECT_THAT(observer.servers, ElementsAre(server.address()));
  EXPECT_THAT(observer.lost, ElementsAre(StatusIs(absl::StatusCode::kUnavailable,
                                                  AllOf(HasSubstr(server.address()), HasSubstr("last frame sent")))));
  const auto seen = server.seen();
  ASSERT_THAT(seen, SizeIs(2));
  EXPECT_EQ(seen[1][0], "config 6");  // taken after frame 7, two frames behind
  EXPECT_EQ(seen[1][1], "frame 6");
  EXPECT_EQ(seen[1].back(), "end");
}

TEST(ResumingStreamTest, SeveralInterruptionsAreOneSession) {
  ScriptedService server(CutAfter({9, 9, 1, 30}));
  ResumeObserver observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 60), IsOk());
  ExpectEachFrameFinalOnce(observer, 60);
  EXPECT_THAT(server.seen(), SizeIs(5));
}

TEST(ResumingStreamTest, BeforeTheFirstCheckpointTheSessionBeginsAnew) {
  ScriptedService server(CutAfter({3}));
  ResumeObserver observer;
  SessionConfig config;
  config.points = {{1, 5, 6}};
  auto stream = Open(At({server.address()}), observer, config);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(stream->AddPoints({{7, 1, 2}}), IsOk());
  EXPECT_THAT(PushAndFinish(*stream, 6), IsOk());
  ExpectEachFrameFinalOnce(observer, 6);
  EXPECT_THAT(observer.events, ElementsAre("accepted", "reconnecting", "resumed 0", "done"));
  const auto seen = server.seen();
  ASSERT_THAT(seen, SizeIs(2));
  EXPECT_THAT(seen[1],
              ElementsAre("config", "add 7", "frame 0", "frame 1", "frame 2", "frame 3", "frame 4", "frame 5", "end"));
  EXPECT_EQ(server.configs()[1].points_size(), 1);
}

TEST(ResumingStreamTest, PointsAreSaidAgainWhereTheyWereSaid) {
  ScriptedService server(CutAfter({10}));
  ResumeObserver observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  for (int64_t i = 0; i < 12; ++i) {
    EXPECT_THAT(Push(*stream, i, i + 1), IsOk());
    EXPECT_THAT(stream->AddPoints({{static_cast<PointId>(100 + i), 0, 0}}), IsOk());
    EXPECT_TRUE(i != 8 || stream->RemovePoints({3}).ok());
  }
  EXPECT_THAT(stream->Finish(), IsOk());
  const auto seen = server.seen();
  ASSERT_THAT(seen, SizeIs(2));
  EXPECT_THAT(seen[1],
              ElementsAre("config 6", "frame 6", "add 106", "frame 7", "add 107", "frame 8", "add 108", "remove 3",
                          "frame 9", "add 109", "frame 10", "add 110", "frame 11", "add 111", "end"));
}

TEST(ResumingStreamTest, OptionsThatWereLeftOpenStayThoseOfTheFirstServer) {
  ScriptedService server(CutAfter({3}));
  ResumeObserver observer;
  SessionConfig config;
  config.points = {{1, 0, 0}};
  config.max_hop_frames = 16;
  auto stream = Open(At({server.address()}), observer, config);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 6), IsOk());
  EXPECT_EQ(server.configs()[0].hop_frames(), 0u);
  EXPECT_EQ(server.configs()[0].max_hop_frames(), 16u);
  EXPECT_EQ(server.configs()[1].hop_frames(), 2u);
  EXPECT_EQ(server.configs()[1].max_hop_frames(), 0u);
  EXPECT_TRUE(server.configs()[1].has_polish());
}

TEST(ResumingStreamTest, ADrainMovesTheSessionToTheNextAddress) {
  auto calls = CutAfter({7});
  calls[0].last_checkpoint = true;
  ScriptedService first(calls), second(std::vector<ScriptedCall>{});
  ResumeObserver observer;
  auto stream = Open(At({first.address(), second.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 16), IsOk());
  ExpectEachFrameFinalOnce(observer, 16);
  EXPECT_THAT(observer.events, ElementsAre("accepted", "reconnecting", "resumed 5", "done"));
  EXPECT_THAT(observer.servers, ElementsAre(second.address()));
  EXPECT_THAT(first.seen(), SizeIs(1));
}

TEST(ResumingStreamTest, ACheckpointOfUseToItsServerAloneGoesBackThere) {
  auto calls = CutAfter({10});
  calls[0].resumable = false;
  ScriptedService first(calls), second(std::vector<ScriptedCall>{});
  ResumeObserver observer;
  auto stream = Open(At({first.address(), second.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 16), IsOk());
  EXPECT_THAT(observer.servers, ElementsAre(first.address()));
  EXPECT_THAT(second.seen(), IsEmpty());
}

TEST(ResumingStreamTest, ATokenOfTheCallersOwnIsWhereTheSessionBegins) {
  ScriptedService server(CutAfter({2}));
  ResumeObserver observer;
  SessionConfig config;
  config.resume_token = "40";
  auto stream = Open(At({server.address()}), observer, config);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(Push(*stream, 40, 46), IsOk());
  EXPECT_THAT(stream->Finish(), IsOk());
  EXPECT_THAT(observer.events, ElementsAre("accepted", "reconnecting", "resumed 40", "done"));
  ExpectEachFrameFinalOnce(observer, 6);
}

TEST(ResumingStreamTest, TheFirstServerMayBeAbsentOrFull) {
  std::string absent;
  {
    ScriptedService gone(std::vector<ScriptedCall>{});
    absent = gone.address();
  }
  ScriptedService full({Refused(OverloadError("sessions", "16 of 16", absl::Seconds(9)))});
  ScriptedService free(std::vector<ScriptedCall>{});
  RemoteTracker::Options options = At({absent, full.address(), free.address()});
  options.connect_timeout = absl::Milliseconds(50);
  ResumeObserver observer;
  auto stream = Open(options, observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 3), IsOk());
  EXPECT_THAT(full.seen(), SizeIs(1));
  EXPECT_THAT(free.seen(), SizeIs(1));
}

TEST(ResumingStreamTest, AnOverloadedServerIsAskedAgain) {
  auto calls = CutAfter({10});
  calls.push_back(Refused(OverloadError("sessions", "16 of 16", absl::Milliseconds(1))));
  calls.push_back(Refused(absl::UnavailableError("starting")));
  ScriptedService server(calls);
  ResumeObserver observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 20), IsOk());
  ExpectEachFrameFinalOnce(observer, 20);
  EXPECT_THAT(observer.events, ElementsAre("accepted", "reconnecting", "resumed 6", "done"));
  EXPECT_THAT(server.seen(), SizeIs(4));
}

TEST(ResumingStreamTest, AProxysWayOfLosingAServerIsALossToo) {
  auto calls = CutAfter({10, 5});
  calls[0].end = grpc::Status(grpc::StatusCode::INTERNAL, "Received RST_STREAM with error code 2");
  calls[1].end = grpc::Status(grpc::StatusCode::CANCELLED, "");
  ScriptedService server(calls);
  ResumeObserver observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 20), IsOk());
  ExpectEachFrameFinalOnce(observer, 20);
  EXPECT_THAT(observer.lost, ElementsAre(StatusIs(absl::StatusCode::kUnavailable, HasSubstr("RST_STREAM")),
                                         StatusIs(absl::StatusCode::kUnavailable)));
}

TEST(ResumingStreamTest, ALossAfterTheHalfCloseIsMadeGood) {
  std::vector<ScriptedCall> calls(1);
  calls[0].ends_at_finish = true;
  ScriptedService server(calls);
  ResumeObserver observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 10), IsOk());
  ExpectEachFrameFinalOnce(observer, 10);
  const auto seen = server.seen();
  ASSERT_THAT(seen, SizeIs(2));
  EXPECT_THAT(seen[1], ElementsAre("config 6", "frame 6", "frame 7", "frame 8", "frame 9", "end"));
}

TEST(ResumingStreamTest, ALossAfterTheSummaryLosesNothing) {
  ScriptedCall call;
  call.after_summary = grpc::Status(grpc::StatusCode::UNAVAILABLE, "cut");
  ScriptedService server({call});
  ResumeObserver observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 10), IsOk());
  EXPECT_EQ(observer.done, absl::OkStatus());
  EXPECT_THAT(server.seen(), testing::SizeIs(1));
}

TEST(ResumingStreamTest, AFullBufferWaitsForACheckpoint) {
  constexpr int64_t kFrames = 60;
  std::atomic<int64_t> pushed{0}, most_ahead{0};
  std::vector<ScriptedCall> calls(1);
  calls[0].on_frame = [&](int64_t frame) { most_ahead = std::max(most_ahead.load(), pushed.load() - frame); };
  ScriptedService::Options scripted;
  scripted.interval = 16;
  scripted.replay_frames = 2;
  ScriptedService server(scripted, calls);
  RemoteTracker::Options options = At({server.address()});
  options.buffer_bytes = int64_t{24} * 10'500;  // 23 frames; 16 + 2 + 4 may have to be kept
  ResumeObserver observer;
  auto stream = Open(options, observer);
  ASSERT_NE(stream, nullptr);
  for (int64_t i = 0; i < kFrames; ++i, ++pushed) ASSERT_THAT(Push(*stream, i, i + 1, 10'000), IsOk());
  EXPECT_THAT(stream->Finish(), IsOk());
  EXPECT_LE(most_ahead.load(), 26);
  ExpectEachFrameFinalOnce(observer, kFrames);
}

TEST(ResumingStreamTest, AnAnnouncedEndReachesTheObserver) {
  FakeService server([](grpc::ServerContext&, FakeService::Stream& stream) {
    v1::TrackRequest request;
    stream.Read(&request);
    stream.Write(Accepted());
    v1::TrackResponse response;
    response.mutable_going_away()->mutable_time_left()->set_seconds(20);
    stream.Write(response);
    while (stream.Read(&request)) {
    }
    stream.Write(Summary(0));
    return grpc::Status::OK;
  });
  ResumeObserver observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(stream->Finish(), IsOk());
  EXPECT_THAT(observer.events, ElementsAre("accepted", "going 20s", "done"));
}

TEST(ResumingStreamTest, AConnectionThatBreaksIsALossLikeAnyOther) {
  ScriptedService server(std::vector<ScriptedCall>{});
  TcpProxy proxy(server.service().port());
  absl::Notification answered;
  ResumeObserver observer;
  observer.on_tracks = [&answered](int64_t frames) {
    if (frames == 10 && !answered.HasBeenNotified()) answered.Notify();
  };
  auto stream = Open(At({proxy.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(Push(*stream, 0, 10), IsOk());
  answered.WaitForNotification();
  proxy.CutAll();
  EXPECT_THAT(Push(*stream, 10, 200), IsOk());
  EXPECT_THAT(stream->Finish(), IsOk());
  ExpectEachFrameFinalOnce(observer, 200);
  EXPECT_THAT(observer.events, ElementsAre("accepted", "reconnecting", "resumed 6", "done"));
  EXPECT_GE(proxy.connections(), 2);
}

TEST(ResumingStreamTest, ALargeCheckpointHasTimeToGoUp) {
  ScriptedService::Options large;
  large.token_bytes = 640 << 10;
  ScriptedService first(large, CutAfter({10}));
  ScriptedService second(std::vector<ScriptedCall>{});
  TcpProxy slow(second.service().port(), absl::Milliseconds(1100));
  ResumeObserver observer;
  RemoteTracker::Options options = At({first.address(), slow.address()});
  options.answer_timeout = absl::Seconds(1);  // the first server, which is near, has no more either
  auto stream = Open(options, observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 20), IsOk());
  EXPECT_THAT(observer.servers, ElementsAre(slow.address()));
}

TEST(ResumingStreamTest, CutsAtAnyMomentLoseNothing) {
  ScriptedService server(std::vector<ScriptedCall>{});
  TcpProxy proxy(server.service().port());
  ResumeObserver observer;
  auto stream = Open(At({proxy.address()}), observer);
  ASSERT_NE(stream, nullptr);
  for (int64_t i = 0; i < 300; i += 20) {
    EXPECT_THAT(Push(*stream, i, i + 20, 20'000), IsOk());
    proxy.CutAll();
  }
  EXPECT_THAT(stream->Finish(), IsOk());
  ExpectEachFrameFinalOnce(observer, 300);
  EXPECT_EQ(observer.summary.frames, 300);
}

}  // namespace
}  // namespace holdfast
