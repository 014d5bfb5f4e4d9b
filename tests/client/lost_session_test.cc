// SPDX-License-Identifier: Apache-2.0
// Sessions of RemoteTracker that end when their server is lost, and how.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/synchronization/notification.h"
#include "api/errors.h"
#include "client/resuming_stream.h"
#include "tests/client/resume_observer.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

TEST(LostSessionTest, ARefusedTokenIsShownToTheOtherServersOnce) {
  const ScriptedCall refused = Refused(absl::FailedPreconditionError("the token is of other weights"));
  auto calls = CutAfter({10});
  calls.push_back(refused);
  ScriptedService first(calls), second({refused}), third({refused});
  ResumeObserver observer;
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

TEST(LostSessionTest, OtherErrorsEndTheSessionWhereverTheyCome) {
  auto calls = CutAfter({10});
  calls.push_back(Refused(InvalidFieldError("config.hop_frames", "is 2, expected 8")));
  ScriptedService reopened(calls);
  calls = CutAfter({10});
  calls[0].end = ToGrpcStatus(InvalidFieldError("frame.data", "is no picture"));
  ScriptedService running(calls);
  for (ScriptedService* server : {&reopened, &running}) {
    ResumeObserver observer;
    auto stream = Open(At({server->address()}), observer);
    ASSERT_NE(stream, nullptr);
    const absl::Status status = PushAndFinish(*stream, 20);
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(server->address())));
    EXPECT_THAT(FieldViolations(status), SizeIs(1));
  }
  EXPECT_THAT(running.seen(), SizeIs(1));
}

TEST(LostSessionTest, AServersOwnInternalErrorEndsTheSession) {
  auto calls = CutAfter({10});
  calls[0].end = ToGrpcStatus(absl::InternalError("an operator threw"));
  ScriptedService server(calls);
  ResumeObserver observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(PushAndFinish(*stream, 20), StatusIs(absl::StatusCode::kInternal));
  EXPECT_THAT(server.seen(), SizeIs(1));
}

TEST(LostSessionTest, ABufferThatCannotDoIsWarnedOfAndTheSessionEndsWithItsServer) {
  ScriptedService server(CutAfter({12}));
  RemoteTracker::Options options = At({server.address()});
  options.buffer_bytes = 1 << 20;
  ResumeObserver observer;
  auto stream = Open(options, observer);
  ASSERT_NE(stream, nullptr);
  Push(*stream, 0, 20, 400 << 10).IgnoreError();
  EXPECT_THAT(stream->Finish(), StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(observer.events, testing::Contains(AllOf(HasSubstr("buffer_mib"), HasSubstr("1 MiB"))).Times(1));
}

TEST(LostSessionTest, ASessionThatOutgrewItsCheckpointsSaysSoOnceAndEndsWithItsServer) {
  auto calls = CutAfter({12});
  calls[0].outgrown = true;
  ScriptedService server(calls);
  ResumeObserver observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  const absl::Status status = PushAndFinish(*stream, 20);
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(observer.events, ElementsAre("accepted", HasSubstr("cannot be resumed"), "done"));
}

TEST(LostSessionTest, WithoutCheckpointsOrResumingALostServerIsTheEnd) {
  for (const bool resume : {true, false}) {
    ScriptedService::Options scripted;
    if (resume) scripted.replay_frames = 0;
    ScriptedService server(scripted, CutAfter({6}));
    RemoteTracker::Options options = At({server.address()});
    options.resume = resume;
    ResumeObserver observer;
    auto stream = Open(options, observer);
    ASSERT_NE(stream, nullptr);
    const absl::Status status = PushAndFinish(*stream, 20);
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kUnavailable, HasSubstr(server.address())));
    EXPECT_THAT(observer.events, ElementsAre("accepted", "done"));
    EXPECT_EQ(server.configs()[0].checkpoint_interval_frames(), resume ? 24u : 0u);
  }
}

TEST(LostSessionTest, CancelEndsTheWaitForTheNextAttempt) {
  ScriptedService server(CutAfter({6}));
  RemoteTracker::Options options = At({server.address()});
  options.backoff.first = options.backoff.longest = absl::Hours(1);
  options.reconnect_timeout = absl::Hours(3);
  absl::Notification lost;
  ResumeObserver observer;
  observer.on_reconnecting = [&lost] { lost.Notify(); };
  auto stream = Open(options, observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(Push(*stream, 0, 6), IsOk());
  lost.WaitForNotification();
  stream->Cancel();
  EXPECT_THAT(stream->Finish(), StatusIs(absl::StatusCode::kCancelled));
  EXPECT_THAT(observer.events, ElementsAre("accepted", "reconnecting", "done"));
}

TEST(LostSessionTest, CancelEndsAnAttemptThatIsNotAnswered) {
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
  ResumeObserver observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  asked.WaitForNotification();
  stream->Cancel();
  EXPECT_THAT(stream->Finish(), StatusIs(absl::StatusCode::kCancelled));
  over.WaitForNotification();
}

TEST(LostSessionTest, ASessionThatNobodyTakesOverEndsWithTheLastErrorInTime) {
  auto server = std::make_unique<ScriptedService>(CutAfter({6}));
  const std::string address = server->address();
  RemoteTracker::Options options = At({address});
  options.reconnect_timeout = absl::Milliseconds(60);
  ResumeObserver observer;
  observer.on_reconnecting = [&server] { server->service().Kill(); };
  auto stream = Open(options, observer);
  ASSERT_NE(stream, nullptr);
  const absl::Status status = PushAndFinish(*stream, 20);
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kUnavailable,
                               AllOf(HasSubstr("holdfast: server at " + address), HasSubstr("last frame sent"),
                                     HasSubstr("no server took the session over within 60ms"))));
  EXPECT_EQ(observer.done, status);
}

TEST(LostSessionTest, ASessionThatEndsEveryServerEnds) {
  std::vector<ScriptedCall> calls(1000);
  for (ScriptedCall& call : calls) call.frames = 3;  // none gets to a checkpoint
  ScriptedService server(calls);
  RemoteTracker::Options options = At({server.address()});
  options.reconnect_timeout = absl::Milliseconds(60);
  ResumeObserver observer;
  auto stream = Open(options, observer);
  ASSERT_NE(stream, nullptr);
  const absl::Status status = PushAndFinish(*stream, 20);
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kUnavailable));
  ExpectEachFrameFinalOnce(observer, 3);
}

TEST(LostSessionTest, AServerThatWantsFramesThatAreGoneEndsTheSession) {
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
  ResumeObserver observer;
  auto stream = Open(At({server.address()}), observer);
  ASSERT_NE(stream, nullptr);
  EXPECT_THAT(Push(*stream, 0, 6), IsOk());
  EXPECT_THAT(stream->Finish(), StatusIs(absl::StatusCode::kInternal, HasSubstr("frame 0, which is not kept")));
}

}  // namespace
}  // namespace holdfast
