// SPDX-License-Identifier: Apache-2.0
// Sessions of RemoteTracker whose servers are lost.
#include "client/resuming_stream.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <map>

#include "absl/strings/match.h"
#include "absl/synchronization/notification.h"
#include "api/errors.h"
#include "client/remote_tracker.h"
#include "proto/grpc_status.h"
#include "tests/client/scripted_service.h"
#include "tests/support/status_matchers.h"
#include "tests/support/tcp_proxy.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

// What happened, in a word each, and how often each final sample of point 1 came.
class Observer final : public TrackObserver {
 public:
  void OnAccepted(const SessionAccepted&) override { events.push_back("accepted"); }
  void OnTracks(TrackUpdate update) override {
    EXPECT_GE(update.frames_received, frames_received);
    frames_received = update.frames_received;
    for (const PointRun& run : update.runs) {
      ASSERT_FALSE(run.x.empty());
      for (int64_t i = 0; i < run.final_count; ++i) ++finals[run.first_frame + i];
      EXPECT_EQ(run.x[0], run.first_frame);
    }
    if (on_tracks) on_tracks(frames_received);
  }
  void OnWarning(const absl::Status& status) override { events.push_back(std::string(status.message())); }
  void OnGoingAway(absl::Duration left) override { events.push_back(absl::StrCat("going ", FormatDuration(left))); }
  void OnReconnecting(const absl::Status& status) override {
    events.push_back("reconnecting");
    lost.push_back(status);
    if (on_reconnecting) on_reconnecting();
  }
  void OnResumed(const SessionAccepted& accepted) override {
    events.push_back(absl::StrCat("resumed ", accepted.first_frame));
    servers.push_back(accepted.server);
  }
  void OnDone(const absl::Status& status, const SessionSummary& value) override {
    events.push_back("done");
    done = status;
    summary = value;
  }

  std::function<void(int64_t)> on_tracks;
  std::function<void()> on_reconnecting;
  std::vector<std::string> events;
  std::vector<std::string> servers;  // resumed on
  std::map<int64_t, int> finals;     // by frame
  int64_t frames_received = 0;
  std::vector<absl::Status> lost;
  absl::Status done;
  SessionSummary summary;
};

RemoteTracker::Options At(std::vector<std::string> addresses) {
  RemoteTracker::Options options;
  options.addresses = std::move(addresses);
  options.backoff.first = absl::Milliseconds(1);
  options.backoff.longest = absl::Milliseconds(20);
  return options;
}

std::unique_ptr<TrackStream> Open(const RemoteTracker::Options& options, Observer& observer,
                                  const SessionConfig& config = {}) {
  auto tracker = RemoteTracker::Connect(options);
  EXPECT_THAT(tracker, IsOk());
  if (!tracker.ok()) return nullptr;
  auto stream = (*tracker)->Open(config, observer);
  EXPECT_THAT(stream, IsOk());
  return stream.ok() ? *std::move(stream) : nullptr;
}

absl::Status Push(TrackStream& stream, int64_t first, int64_t end, size_t bytes = 3) {
  absl::Status status;
  for (int64_t i = first; i < end && status.ok(); ++i) {
    Frame frame;
    frame.index = i;
    frame.bytes.assign(bytes, 'f');
    status = stream.PushFrame(std::move(frame));
  }
  return status;
}

// For sessions that end early, maybe while frames are pushed.
absl::Status PushAndFinish(TrackStream& stream, int64_t frames) {
  const absl::Status pushed = Push(stream, 0, frames);
  const absl::Status status = stream.Finish();
  EXPECT_TRUE(pushed.ok() || pushed == status) << pushed;
  return status;
}

void ExpectEachFrameFinalOnce(const Observer& observer, int64_t frames) {
  EXPECT_EQ(static_cast<int64_t>(observer.finals.size()), frames);
  for (const auto& [frame, times] : observer.finals) EXPECT_EQ(times, 1) << "frame " << frame;
}

// A server whose session is cut after so many frames of each call.
std::vector<ScriptedCall> CutAfter(const std::vector<int64_t>& frames) {
  std::vector<ScriptedCall> calls;
  for (const int64_t count : frames) {
    calls.emplace_back();
    calls.back().frames = count;
  }
  return calls;
}

ScriptedCall Refused(const absl::Status& status) {
  ScriptedCall call;
  call.refusal = ToGrpcStatus(status);
  return call;
}

TEST(ResumingStreamTest, AfterACutTheSessionGoesOnFromItsNewestCheckpoint) {
  ScriptedService server(CutAfter({10}));
  Observer observer;
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
  Observer observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 60), IsOk());
  ExpectEachFrameFinalOnce(observer, 60);
  EXPECT_THAT(server.seen(), SizeIs(5));
}

TEST(ResumingStreamTest, BeforeTheFirstCheckpointTheSessionBeginsAnew) {
  ScriptedService server(CutAfter({3}));
  Observer observer;
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
  Observer observer;
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
  Observer observer;
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
  Observer observer;
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
  Observer observer;
  auto stream = Open(At({first.address(), second.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 16), IsOk());
  EXPECT_THAT(observer.servers, ElementsAre(first.address()));
  EXPECT_THAT(second.seen(), IsEmpty());
}

TEST(ResumingStreamTest, ATokenOfTheCallersOwnIsWhereTheSessionBegins) {
  ScriptedService server(CutAfter({2}));
  Observer observer;
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
  Observer observer;
  auto stream = Open(options, observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 3), IsOk());
  EXPECT_THAT(full.seen(), SizeIs(1));
  EXPECT_THAT(free.seen(), SizeIs(1));
}

TEST(ResumingStreamTest, ARefusedTokenIsShownToTheOtherServersOnce) {
  const ScriptedCall refused = Refused(absl::FailedPreconditionError("the token is of other weights"));
  auto calls = CutAfter({10});
  calls.push_back(refused);
  ScriptedService first(calls), second({refused}), third({refused});
  Observer observer;
  auto stream = Open(At({first.address(), second.address(), third.address()}), observer);
  ASSERT_NE(stream, nullptr);
  const absl::Status status = PushAndFinish(*stream, 20);
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kFailedPrecondition,
                               AllOf(HasSubstr(first.address()), HasSubstr("other weights"))));
  EXPECT_EQ(observer.done, status);
  EXPECT_THAT(first.seen(), SizeIs(2));
  EXPECT_THAT(second.seen(), SizeIs(1));
  EXPECT_THAT(third.seen(), SizeIs(1));
}

TEST(ResumingStreamTest, AnOverloadedServerIsAskedAgain) {
  auto calls = CutAfter({10});
  calls.push_back(Refused(OverloadError("sessions", "16 of 16", absl::Milliseconds(1))));
  calls.push_back(Refused(absl::UnavailableError("starting")));
  ScriptedService server(calls);
  Observer observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 20), IsOk());
  ExpectEachFrameFinalOnce(observer, 20);
  EXPECT_THAT(observer.events, ElementsAre("accepted", "reconnecting", "resumed 6", "done"));
  EXPECT_THAT(server.seen(), SizeIs(4));
}

TEST(ResumingStreamTest, OtherErrorsEndTheSessionWhereverTheyCome) {
  auto calls = CutAfter({10});
  calls.push_back(Refused(InvalidFieldError("config.hop_frames", "is 2, expected 8")));
  ScriptedService reopened(calls);
  calls = CutAfter({10});
  calls[0].end = ToGrpcStatus(InvalidFieldError("frame.data", "is no picture"));
  ScriptedService running(calls);
  for (ScriptedService* server : {&reopened, &running}) {
    Observer observer;
    auto stream = Open(At({server->address()}), observer);
    ASSERT_NE(stream, nullptr);
    const absl::Status status = PushAndFinish(*stream, 20);
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(server->address())));
    EXPECT_THAT(FieldViolations(status), SizeIs(1));
  }
  EXPECT_THAT(running.seen(), SizeIs(1));
}

TEST(ResumingStreamTest, AProxysWayOfLosingAServerIsALossToo) {
  auto calls = CutAfter({10, 5});
  calls[0].end = grpc::Status(grpc::StatusCode::INTERNAL, "Received RST_STREAM with error code 2");
  calls[1].end = grpc::Status(grpc::StatusCode::CANCELLED, "");
  ScriptedService server(calls);
  Observer observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 20), IsOk());
  ExpectEachFrameFinalOnce(observer, 20);
  EXPECT_THAT(observer.lost, ElementsAre(StatusIs(absl::StatusCode::kUnavailable, HasSubstr("RST_STREAM")),
                                         StatusIs(absl::StatusCode::kUnavailable)));
}

TEST(ResumingStreamTest, AServersOwnInternalErrorEndsTheSession) {
  auto calls = CutAfter({10});
  calls[0].end = ToGrpcStatus(absl::InternalError("an operator threw"));
  ScriptedService server(calls);
  Observer observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 20), StatusIs(absl::StatusCode::kInternal));
  EXPECT_THAT(server.seen(), SizeIs(1));
}

TEST(ResumingStreamTest, ALossAfterTheHalfCloseIsMadeGood) {
  std::vector<ScriptedCall> calls(1);
  calls[0].ends_at_finish = true;
  ScriptedService server(calls);
  Observer observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 10), IsOk());
  ExpectEachFrameFinalOnce(observer, 10);
  const auto seen = server.seen();
  ASSERT_THAT(seen, SizeIs(2));
  EXPECT_THAT(seen[1], ElementsAre("config 6", "frame 6", "frame 7", "frame 8", "frame 9", "end"));
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
  Observer observer;
  auto stream = Open(options, observer);
  ASSERT_NE(stream, nullptr);
  for (int64_t i = 0; i < kFrames; ++i, ++pushed) ASSERT_THAT(Push(*stream, i, i + 1, 10'000), IsOk());
  EXPECT_THAT(stream->Finish(), IsOk());
  EXPECT_LE(most_ahead.load(), 26);
  ExpectEachFrameFinalOnce(observer, kFrames);
}

TEST(ResumingStreamTest, ABufferThatCannotDoIsWarnedOfAndTheSessionEndsWithItsServer) {
  ScriptedService server(CutAfter({12}));
  RemoteTracker::Options options = At({server.address()});
  options.buffer_bytes = 1 << 20;
  Observer observer;
  auto stream = Open(options, observer);
  ASSERT_NE(stream, nullptr);
  Push(*stream, 0, 20, 400 << 10).IgnoreError();
  EXPECT_THAT(stream->Finish(), StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(observer.events, testing::Contains(AllOf(HasSubstr("buffer_mib"), HasSubstr("1 MiB"))).Times(1));
}

TEST(ResumingStreamTest, ASessionThatOutgrewItsCheckpointsSaysSoOnceAndEndsWithItsServer) {
  auto calls = CutAfter({12});
  calls[0].outgrown = true;
  ScriptedService server(calls);
  Observer observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  const absl::Status status = PushAndFinish(*stream, 20);
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(observer.events, ElementsAre("accepted", HasSubstr("cannot be resumed"), "done"));
}

TEST(ResumingStreamTest, WithoutCheckpointsOrResumingALostServerIsTheEnd) {
  for (const bool resume : {true, false}) {
    ScriptedService::Options scripted;
    if (resume) scripted.replay_frames = 0;
    ScriptedService server(scripted, CutAfter({6}));
    RemoteTracker::Options options = At({server.address()});
    options.resume = resume;
    Observer observer;
    auto stream = Open(options, observer);
    ASSERT_NE(stream, nullptr);
    const absl::Status status = PushAndFinish(*stream, 20);
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kUnavailable, HasSubstr(server.address())));
    EXPECT_THAT(observer.events, ElementsAre("accepted", "done"));
    EXPECT_EQ(server.configs()[0].checkpoint_interval_frames(), resume ? 24u : 0u);
  }
}

TEST(ResumingStreamTest, CancelEndsTheWaitForTheNextAttempt) {
  ScriptedService server(CutAfter({6}));
  RemoteTracker::Options options = At({server.address()});
  options.backoff.first = options.backoff.longest = absl::Hours(1);
  options.reconnect_timeout = absl::Hours(3);
  absl::Notification lost;
  Observer observer;
  observer.on_reconnecting = [&lost] { lost.Notify(); };
  auto stream = Open(options, observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(Push(*stream, 0, 6), IsOk());
  lost.WaitForNotification();
  stream->Cancel();
  EXPECT_THAT(stream->Finish(), StatusIs(absl::StatusCode::kCancelled));
  EXPECT_THAT(observer.events, ElementsAre("accepted", "reconnecting", "done"));
}

TEST(ResumingStreamTest, CancelEndsAnAttemptThatIsNotAnswered) {
  absl::Notification asked, over;
  int calls = 0;
  FakeService server([&](grpc::ServerContext& context, FakeService::Stream& stream) {
    v1::TrackRequest request;
    stream.Read(&request);
    if (++calls == 1) {
      v1::TrackResponse accepted = Accepted();
      accepted.mutable_accepted()->set_replay_frames(8);
      accepted.mutable_accepted()->set_checkpoint_interval_frames(4);
      stream.Write(accepted);
      return grpc::Status(grpc::StatusCode::UNAVAILABLE, "cut");
    }
    asked.Notify();
    while (stream.Read(&request)) {
    }
    EXPECT_TRUE(context.IsCancelled());
    over.Notify();
    return grpc::Status::OK;
  });
  Observer observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  asked.WaitForNotification();
  stream->Cancel();
  EXPECT_THAT(stream->Finish(), StatusIs(absl::StatusCode::kCancelled));
  over.WaitForNotification();
}

TEST(ResumingStreamTest, ASessionThatNobodyTakesOverEndsWithTheLastErrorInTime) {
  auto server = std::make_unique<ScriptedService>(CutAfter({6}));
  const std::string address = server->address();
  RemoteTracker::Options options = At({address});
  options.reconnect_timeout = absl::Milliseconds(60);
  Observer observer;
  observer.on_reconnecting = [&server] { server->service().Kill(); };
  auto stream = Open(options, observer);
  ASSERT_NE(stream, nullptr);
  const absl::Status status = PushAndFinish(*stream, 20);
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kUnavailable,
                               AllOf(HasSubstr("holdfast: server at " + address), HasSubstr("last frame sent"),
                                     HasSubstr("no server took the session over within 60ms"))));
  EXPECT_EQ(observer.done, status);
}

TEST(ResumingStreamTest, ASessionThatEndsEveryServerEnds) {
  std::vector<ScriptedCall> calls(1000);
  for (ScriptedCall& call : calls) call.frames = 3;  // none gets to a checkpoint
  ScriptedService server(calls);
  RemoteTracker::Options options = At({server.address()});
  options.reconnect_timeout = absl::Milliseconds(60);
  Observer observer;
  auto stream = Open(options, observer);
  ASSERT_NE(stream, nullptr);
  const absl::Status status = PushAndFinish(*stream, 20);
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kUnavailable));
  ExpectEachFrameFinalOnce(observer, 3);
}

TEST(ResumingStreamTest, AServerThatWantsFramesThatAreGoneEndsTheSession) {
  int calls = 0;
  FakeService server([&calls](grpc::ServerContext&, FakeService::Stream& stream) {
    v1::TrackRequest request;
    stream.Read(&request);
    v1::TrackResponse accepted = Accepted();
    accepted.mutable_accepted()->set_replay_frames(8);
    accepted.mutable_accepted()->set_checkpoint_interval_frames(4);
    stream.Write(accepted);  // from frame 0 on, whatever the token
    if (++calls > 1) return grpc::Status::OK;
    for (int i = 0; i < 6; ++i) stream.Read(&request);
    stream.Write(CheckpointAt(4));
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "cut");
  });
  Observer observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(Push(*stream, 0, 6), IsOk());
  EXPECT_THAT(stream->Finish(), StatusIs(absl::StatusCode::kInternal, HasSubstr("frame 0, which is not kept")));
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
  Observer observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(stream->Finish(), IsOk());
  EXPECT_THAT(observer.events, ElementsAre("accepted", "going 20s", "done"));
}

TEST(ResumingStreamTest, AConnectionThatBreaksIsALossLikeAnyOther) {
  ScriptedService server(std::vector<ScriptedCall>{});
  TcpProxy proxy(server.service().port());
  absl::Notification answered;
  Observer observer;
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

TEST(ResumingStreamTest, CutsAtAnyMomentLoseNothing) {
  ScriptedService server(std::vector<ScriptedCall>{});
  TcpProxy proxy(server.service().port());
  Observer observer;
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
