// SPDX-License-Identifier: Apache-2.0
#include "client/remote_tracker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <functional>
#include <memory>
#include <numeric>
#include <thread>

#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "api/errors.h"
#include "api/steady_event.h"
#include "proto/grpc_status.h"
#include "tests/client/connect_to.h"
#include "tests/client/fake_service.h"
#include "tests/support/tcp_proxy.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class Recorder final : public TrackObserver {
 public:
  void OnAccepted(const SessionAccepted& value) override { accepted = value; }
  void OnTracks(TrackUpdate update) override {
    updates.push_back(std::move(update));
    if (updates.size() == 1) first_update.Notify();
  }
  void OnWarning(const absl::Status& status) override { warnings.push_back(status); }
  void OnDone(const absl::Status& status, const SessionSummary& value) override {
    ++done_calls;
    done = status;
    summary = value;
    over.Notify();
  }

  SessionAccepted accepted;
  std::vector<TrackUpdate> updates;
  std::vector<absl::Status> warnings;
  absl::Status done;
  SessionSummary summary;
  int done_calls = 0;
  absl::Notification first_update;
  SteadyEvent over;  // OnDone came
};

Frame FrameOf(int64_t index, size_t bytes = 3) {
  Frame frame;
  frame.index = index;
  frame.bytes.assign(bytes, 'f');
  return frame;
}

// Answers each frame with a sample whose x is the frame's index.
grpc::Status EchoFrames(grpc::ServerContext&, FakeService::Stream& stream) {
  v1::TrackRequest request;
  int64_t frames = 0;
  stream.Read(&request);
  stream.Write(Accepted());
  while (stream.Read(&request)) {
    if (request.has_frame()) stream.Write(Sample(1, request.frame().index(), static_cast<float>(frames++), 0));
  }
  stream.Write(Summary(frames));
  return grpc::Status::OK;
}

TEST(RemoteTrackerTest, DeliversWhatTheServerSendsInOrderAndFinishesWithItsSummary) {
  FakeService service(EchoFrames);
  auto tracker = ConnectTo(service.address());
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  Recorder recorder;
  auto stream = (*tracker)->Open({}, recorder);
  ASSERT_TRUE(stream.ok()) << stream.status();
  for (int i = 0; i < 5; ++i) ASSERT_TRUE((*stream)->PushFrame(FrameOf(i)).ok());
  EXPECT_TRUE((*stream)->Finish().ok());
  EXPECT_EQ(recorder.accepted.session_id, "s1");
  ASSERT_EQ(recorder.updates.size(), 5u);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(recorder.updates[i].runs[0].x[0], i);
  EXPECT_EQ(recorder.summary.frames, 5);
  EXPECT_EQ(recorder.done_calls, 1);
  EXPECT_FALSE((*stream)->PushFrame(FrameOf(5)).ok());
}

TEST(RemoteTrackerTest, SendsConfigFramesAndPointsAsTheProtocolSays) {
  absl::Mutex mutex;  // gRPC orders the two sides, where ThreadSanitizer cannot see it
  std::vector<std::string> seen;
  FakeService service([&mutex, &seen](grpc::ServerContext&, FakeService::Stream& stream) {
    v1::TrackRequest request;
    while (stream.Read(&request)) {
      {
        absl::MutexLock lock(&mutex);
        seen.push_back(request.ShortDebugString());
      }
      if (request.has_config()) stream.Write(Accepted());
    }
    stream.Write(Summary(1));
    return grpc::Status::OK;
  });
  auto tracker = ConnectTo(service.address());
  ASSERT_TRUE(tracker.ok());
  Recorder recorder;
  SessionConfig config;
  config.hop_frames = 4;
  config.points = {{7, 1, 2}};
  auto stream = (*tracker)->Open(config, recorder);
  ASSERT_TRUE(stream.ok());
  Frame frame = FrameOf(0);
  frame.points = {{8, 3, 4}};
  EXPECT_TRUE((*stream)->PushFrame(frame).ok());
  EXPECT_TRUE((*stream)->AddPoints({{9, 5, 6}}).ok());
  EXPECT_TRUE((*stream)->RemovePoints({7, 8}).ok());
  EXPECT_TRUE((*stream)->Finish().ok());
  absl::MutexLock lock(&mutex);
  EXPECT_THAT(seen, ElementsAre("config { encoding: FRAME_ENCODING_JPEG hop_frames: 4 points { id: 7 x: 1 y: 2 } "
                                "checkpoint_interval_frames: 24 }",
                                "frame { data: \"fff\" points { id: 8 x: 3 y: 4 } }",
                                "add_points { points { id: 9 x: 5 y: 6 } }", "remove_points { ids: 7 ids: 8 }"));
}

TEST(RemoteTrackerTest, ARefusedSessionKeepsTheDetailsOfItsStatus) {
  FakeService service([](grpc::ServerContext&, FakeService::Stream& stream) {
    v1::TrackRequest request;
    stream.Read(&request);
    return ToGrpcStatus(InvalidFieldError("config.hop_frames", "is 99, expected 1..23"));
  });
  auto tracker = ConnectTo(service.address());
  ASSERT_TRUE(tracker.ok());
  Recorder recorder;
  const auto stream = (*tracker)->Open({}, recorder);
  EXPECT_EQ(stream.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(stream.status().message()), HasSubstr(service.address()));
  ASSERT_EQ(FieldViolations(stream.status()).size(), 1u);
  EXPECT_EQ(FieldViolations(stream.status())[0].field, "config.hop_frames");
  EXPECT_EQ(recorder.done, stream.status());
  EXPECT_EQ(recorder.done_calls, 1);
}

TEST(RemoteTrackerTest, AnErrorInTheMiddleComesAfterTheEarlierResultsAndStaysWithTheStream) {
  FakeService service([](grpc::ServerContext&, FakeService::Stream& stream) {
    v1::TrackRequest request;
    stream.Read(&request);
    stream.Write(Accepted());
    stream.Read(&request);
    stream.Write(Sample(1, 0, 5, 6));
    v1::TrackResponse warning;
    warning.mutable_warning()->set_code(3);
    warning.mutable_warning()->set_message("careful");
    stream.Write(warning);
    return ToGrpcStatus(OverloadError("memory", "all used", absl::Seconds(2)));
  });
  auto tracker = ConnectTo(service.address());
  ASSERT_TRUE(tracker.ok());
  Recorder recorder;
  auto stream = (*tracker)->Open({}, recorder);
  ASSERT_TRUE(stream.ok());
  EXPECT_TRUE((*stream)->PushFrame(FrameOf(0)).ok());
  const absl::Status status = (*stream)->Finish();
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  ASSERT_TRUE(OverloadDetails(status).has_value());
  EXPECT_EQ(OverloadDetails(status)->retry_after, absl::Seconds(2));
  EXPECT_EQ(recorder.updates.size(), 1u);
  ASSERT_EQ(recorder.warnings.size(), 1u);
  EXPECT_EQ(recorder.warnings[0].message(), "careful");
  EXPECT_EQ((*stream)->Finish(), status);
}

TEST(RemoteTrackerTest, AMalformedAnswerEndsTheSession) {
  FakeService service([](grpc::ServerContext& context, FakeService::Stream& stream) {
    v1::TrackRequest request;
    stream.Read(&request);
    stream.Write(Accepted());
    v1::TrackResponse bad = Sample(1, 0, 5, 6);
    bad.mutable_tracks()->mutable_runs(0)->add_x(7);  // one x more than y
    stream.Write(bad);
    while (stream.Read(&request)) {
    }
    EXPECT_TRUE(context.IsCancelled());
    return grpc::Status::OK;
  });
  auto tracker = ConnectTo(service.address());
  ASSERT_TRUE(tracker.ok());
  Recorder recorder;
  auto stream = (*tracker)->Open({}, recorder);
  ASSERT_TRUE(stream.ok());
  absl::Status status;
  for (int i = 0; status.ok(); ++i) status = (*stream)->PushFrame(FrameOf(i));
  EXPECT_EQ(status.code(), absl::StatusCode::kInternal);
  EXPECT_TRUE(recorder.updates.empty());
}

TEST(RemoteTrackerTest, AnEndWithoutASummaryIsAnError) {
  FakeService service([](grpc::ServerContext&, FakeService::Stream& stream) {
    stream.Write(Accepted());
    return grpc::Status::OK;
  });
  auto tracker = ConnectTo(service.address());
  ASSERT_TRUE(tracker.ok());
  Recorder recorder;
  auto stream = (*tracker)->Open({}, recorder);
  const absl::Status status = stream.ok() ? (*stream)->Finish() : stream.status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInternal);
}

TEST(RemoteTrackerTest, AServerThatDiesMakesTheStreamUnavailable) {
  FakeService service([](grpc::ServerContext&, FakeService::Stream& stream) {
    v1::TrackRequest request;
    stream.Read(&request);
    stream.Write(Accepted());
    while (stream.Read(&request)) stream.Write(Sample(1, 0, 5, 6));
    return grpc::Status::OK;
  });
  auto tracker = ConnectTo(service.address());
  ASSERT_TRUE(tracker.ok());
  Recorder recorder;
  auto stream = (*tracker)->Open({}, recorder);
  ASSERT_TRUE(stream.ok());
  ASSERT_TRUE((*stream)->PushFrame(FrameOf(0)).ok());
  recorder.first_update.WaitForNotification();
  service.Kill();
  absl::Status status;
  for (int i = 1; status.ok(); ++i) status = (*stream)->PushFrame(FrameOf(i));
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("server at " + service.address() + " is unavailable"));
  EXPECT_THAT(std::string(status.message()), HasSubstr("(the last frame sent is "));
  EXPECT_EQ((*stream)->Finish(), status);
  EXPECT_EQ(recorder.updates.size(), 1u);
}

TEST(RemoteTrackerTest, ResultsThatWaitWhenTheServerGivesUpAreDeliveredBeforeTheEnd) {
  constexpr int kUpdates = 50;
  absl::Notification over;
  FakeService service([&over](grpc::ServerContext&, FakeService::Stream& stream) {
    v1::TrackRequest request;
    stream.Read(&request);
    stream.Write(Accepted());
    stream.Read(&request);
    for (int i = 0; i < kUpdates; ++i) stream.Write(Sample(1, 0, static_cast<float>(i), 0));
    over.Notify();
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "shutting down");
  });
  // Takes the first result only when the server has sent the last one.
  class Slow final : public TrackObserver {
   public:
    explicit Slow(absl::Notification& over) : over_(over) {}
    void OnTracks(TrackUpdate update) override {
      over_.WaitForNotification();
      events.push_back(update.runs[0].x[0]);
    }
    void OnDone(const absl::Status&, const SessionSummary&) override { events.push_back(-1); }
    std::vector<float> events;

   private:
    absl::Notification& over_;
  };
  auto tracker = ConnectTo(service.address());
  ASSERT_TRUE(tracker.ok());
  Slow observer(over);
  auto stream = (*tracker)->Open({}, observer);
  ASSERT_TRUE(stream.ok());
  EXPECT_TRUE((*stream)->PushFrame(FrameOf(0)).ok());
  const absl::Status status = (*stream)->Finish();
  EXPECT_EQ(status.message(),
            "holdfast: server at " + service.address() + " is unavailable: shutting down (the last frame sent is 0)");
  std::vector<float> expected(kUpdates);
  std::iota(expected.begin(), expected.end(), 0.0f);
  expected.push_back(-1);
  EXPECT_EQ(observer.events, expected);
}

TEST(RemoteTrackerTest, ALostPathIsNoticedHoweverLongItWasSilent) {
  FakeService service(EchoFrames);
  TcpProxy path(service.port());
  RemoteTracker::Options options;
  options.addresses = {path.address()};
  options.resume = false;
  options.keepalive_time = absl::Milliseconds(100);  // gRPC lets a second pass from one ping to the next
  options.keepalive_timeout = absl::Milliseconds(500);
  const auto tracker = RemoteTracker::Connect(options);
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  Recorder recorder;
  auto stream = (*tracker)->Open({}, recorder);
  ASSERT_TRUE(stream.ok()) << stream.status();
  path.LoseAfter(5);  // pings, but for the first one or two
  EXPECT_TRUE(recorder.over.WaitFor(absl::Seconds(20)));
  EXPECT_EQ(recorder.done.code(), absl::StatusCode::kUnavailable) << recorder.done;
}

TEST(RemoteTrackerTest, OptionsThatMakeNoSenseAreNamed) {
  const auto field = [](const std::function<void(RemoteTracker::Options&)>& spoil) {
    RemoteTracker::Options options;
    options.addresses = {"a:1", "b:2"};
    EXPECT_TRUE(options.Validate().ok());
    spoil(options);
    const auto violations = FieldViolations(options.Validate());
    return violations.empty() ? "" : violations[0].field;
  };
  EXPECT_EQ(field([](auto& o) { o.addresses = {}; }), "addresses");
  EXPECT_EQ(field([](auto& o) { o.addresses[1] = "nowhere"; }), "addresses");
  EXPECT_EQ(field([](auto& o) { o.addresses[1] = " b:2"; }), "addresses");
  EXPECT_EQ(field([](auto& o) { o.addresses[1] = "dns:///b:70000"; }), "addresses");
  EXPECT_EQ(field([](auto& o) { o.buffer_bytes = 0; }), "buffer_bytes");
  EXPECT_EQ(field([](auto& o) { o.checkpoint_interval_frames = 0; }), "checkpoint_interval_frames");
  EXPECT_EQ(field([](auto& o) { o.reconnect_timeout = -absl::Seconds(1); }), "reconnect_timeout");
}

TEST(RemoteTrackerTest, AServerThatNeverAnswersIsGivenUp) {
  FakeService service([](grpc::ServerContext&, FakeService::Stream& stream) {
    v1::TrackRequest request;
    while (stream.Read(&request)) {
    }
    return grpc::Status::OK;
  });
  RemoteTracker::Options options;
  options.addresses = {service.address()};
  options.answer_timeout = absl::Milliseconds(20);
  auto tracker = RemoteTracker::Connect(options);
  ASSERT_TRUE(tracker.ok());
  Recorder recorder;
  EXPECT_EQ((*tracker)->Open({}, recorder).status().code(), absl::StatusCode::kDeadlineExceeded);
  EXPECT_EQ(recorder.done.code(), absl::StatusCode::kDeadlineExceeded);
}

TEST(RemoteTrackerTest, ASlowServerSlowsTheWriterInsteadOfFillingItsMemory) {
  constexpr int kFrames = 64;
  std::atomic<int> pushed{0};
  int most_ahead = 0;
  FakeService service([&](grpc::ServerContext&, FakeService::Stream& stream) {
    v1::TrackRequest request;
    stream.Read(&request);
    stream.Write(Accepted());
    for (int read = 0; stream.Read(&request); ++read) most_ahead = std::max(most_ahead, pushed.load() - read);
    stream.Write(Summary(kFrames));
    return grpc::Status::OK;
  });
  auto tracker = ConnectTo(service.address());
  ASSERT_TRUE(tracker.ok());
  Recorder recorder;
  auto stream = (*tracker)->Open({}, recorder);
  ASSERT_TRUE(stream.ok());
  for (int i = 0; i < kFrames; ++i, ++pushed) ASSERT_TRUE((*stream)->PushFrame(FrameOf(i, 1 << 20)).ok());
  EXPECT_TRUE((*stream)->Finish().ok());
  EXPECT_LT(most_ahead, kFrames / 2);
}

TEST(RemoteTrackerTest, CancelFreesAWriterThatWaits) {
  absl::Notification over;
  FakeService service([&over](grpc::ServerContext&, FakeService::Stream& stream) {
    v1::TrackRequest request;
    stream.Read(&request);
    stream.Write(Accepted());
    over.WaitForNotification();  // never reads a frame
    return grpc::Status::OK;
  });
  auto tracker = ConnectTo(service.address());
  ASSERT_TRUE(tracker.ok());
  Recorder recorder;
  auto stream = (*tracker)->Open({}, recorder);
  ASSERT_TRUE(stream.ok());
  absl::Notification begun;
  std::thread canceller([&] {
    begun.WaitForNotification();
    (*stream)->Cancel();
  });
  absl::Status status;
  for (int i = 0; status.ok(); ++i) {  // nothing but the cancellation ends it
    status = (*stream)->PushFrame(FrameOf(i, 1 << 20));
    if (i == 0) begun.Notify();
  }
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled) << status;
  canceller.join();
  over.Notify();
  EXPECT_EQ((*stream)->Finish().code(), absl::StatusCode::kCancelled);
}

TEST(RemoteTrackerTest, InfoTellsWhatTheServerRuns) {
  FakeService service(EchoFrames);
  service.info.set_model_name("interim");
  service.info.set_window_frames(24);
  auto tracker = ConnectTo(service.address());
  ASSERT_TRUE(tracker.ok());
  const auto info = (*tracker)->Info();
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_EQ(info->model_name, "interim");
  service.info_status = grpc::Status(grpc::StatusCode::PERMISSION_DENIED, "no");
  EXPECT_EQ((*tracker)->Info().status().code(), absl::StatusCode::kPermissionDenied);
}

// A server that counts its sessions, and what metadata they came with.
class CountingServer {
 public:
  int sessions() const { return sessions_; }
  std::string trace_parent() const {
    absl::MutexLock lock(&mutex_);
    return trace_parent_;
  }
  FakeService& service() { return service_; }

 private:
  grpc::Status Count(grpc::ServerContext& context, FakeService::Stream& stream) {
    ++sessions_;
    if (const auto found = context.client_metadata().find("traceparent"); found != context.client_metadata().end()) {
      absl::MutexLock lock(&mutex_);
      trace_parent_.assign(found->second.data(), found->second.size());
    }
    return EchoFrames(context, stream);
  }

  std::atomic<int> sessions_{0};
  mutable absl::Mutex mutex_;
  std::string trace_parent_;
  FakeService service_{
      [this](grpc::ServerContext& context, FakeService::Stream& stream) { return Count(context, stream); }};
};

void RunSession(RemoteTracker& tracker) {
  Recorder recorder;
  auto stream = tracker.Open({}, recorder);
  ASSERT_TRUE(stream.ok()) << stream.status();
  EXPECT_TRUE((*stream)->Finish().ok());
}

TEST(RemoteTrackerTest, AUriSpreadsSessionsOverTheServersThatTakeThem) {
  CountingServer first, second;
  auto tracker = ConnectTo(absl::StrCat("ipv4:", first.service().address(), ",", second.service().address()));
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  // Both connections stand after a while.
  for (int i = 0; i < 1000 && (first.sessions() < 2 || second.sessions() < 2); ++i) RunSession(**tracker);
  EXPECT_GE(first.sessions(), 2);
  EXPECT_GE(second.sessions(), 2);

  first.service().SetServing(false);
  int in_a_row = 0;  // of the second server's; in turns, there are not two
  for (int i = 0; i < 1000 && in_a_row < 4; ++i) {
    const int before = second.sessions();
    RunSession(**tracker);
    in_a_row = second.sessions() > before ? in_a_row + 1 : 0;
  }
  EXPECT_EQ(in_a_row, 4);
}

TEST(RemoteTrackerTest, SessionsAreInTheCallersTrace) {
  CountingServer server;
  RemoteTracker::Options options;
  options.addresses = {server.service().address()};
  options.trace_parent = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";
  const auto tracker = RemoteTracker::Connect(options);
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  RunSession(**tracker);
  EXPECT_EQ(server.trace_parent(), options.trace_parent);
  options.trace_parent = "two\nlines";
  EXPECT_THAT(std::string(RemoteTracker::Connect(options).status().message()), HasSubstr("trace_parent"));
}

}  // namespace
}  // namespace holdfast
