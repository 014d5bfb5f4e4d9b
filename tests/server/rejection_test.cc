// SPDX-License-Identifier: Apache-2.0
// Streams that are refused or end early: each for its own reason, none harming the others.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <thread>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "api/errors.h"
#include "tests/support/fake_engine.h"
#include "tests/support/status_matchers.h"
#include "tests/support/test_server.h"
#include "tests/support/track_call.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

class RejectionTest : public ::testing::Test {
 protected:
  FakeEngine engine_{FakeEngine::Options{/*max_sessions=*/2}};
  TestServer server_{&engine_};
  std::shared_ptr<grpc::Channel> channel_ = server_.NewChannel();
};

void ExpectViolation(const absl::Status& status, absl::string_view field) {
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument));
  const auto violations = FieldViolations(status);
  ASSERT_THAT(violations, SizeIs(1)) << status;
  EXPECT_EQ(violations[0].field, field);
  EXPECT_THAT(violations[0].description, Not(IsEmpty()));
}

TEST_F(RejectionTest, AStreamHasToBeginWithItsConfig) {
  TrackCall frame_first(channel_);
  frame_first.SendFrame(0);
  ExpectViolation(frame_first.ReadToEnd(), "config");
  TrackCall nothing(channel_);
  ExpectViolation(nothing.FinishAndReadToEnd(), "config");
  TrackCall empty(channel_);
  empty.Send(v1::TrackRequest());
  ExpectViolation(empty.ReadToEnd(), "config");
}

TEST_F(RejectionTest, ASecondConfigEndsTheStreamAfterItsResults) {
  TrackCall call(channel_, JpegConfig());
  call.SendFrame(0);
  call.SendConfig(ToProto(JpegConfig()));
  ExpectViolation(call.ReadToEnd(), "config");
  EXPECT_TRUE(call.tracks[7][0].final);
  EXPECT_THAT(call.summaries, IsEmpty());
}

TEST_F(RejectionTest, AnEmptyMessageIsAViolation) {
  TrackCall call(channel_, JpegConfig());
  call.Send(v1::TrackRequest());
  ExpectViolation(call.ReadToEnd(), "request");
}

TEST_F(RejectionTest, WrongConfigFieldsAreNamed) {
  const auto answer = [this](auto spoil) {
    v1::SessionConfig config = ToProto(JpegConfig());
    spoil(config);
    TrackCall call(channel_);
    call.SendConfig(config);
    return call.ReadToEnd();
  };
  ExpectViolation(answer([](auto& c) { c.clear_encoding(); }), "config.encoding");
  ExpectViolation(answer([](auto& c) { c.set_encoding(v1::FRAME_ENCODING_GRAY8); }), "config.raw_size");
  ExpectViolation(answer([](auto& c) { c.mutable_processing_size()->set_width(33); }), "config.processing_size");
  ExpectViolation(answer([](auto& c) {
                    c.mutable_processing_size()->set_width(500);
                    c.mutable_processing_size()->set_height(384);
                  }),
                  "config.processing_size");
  ExpectViolation(answer([](auto& c) { c.set_hop_frames(24); }), "config.hop_frames");
  ExpectViolation(answer([](auto& c) { c.set_iterations(1U << 31); }), "config.iterations");
  ExpectViolation(answer([](auto& c) { c.mutable_points(0)->set_x(std::nanf("")); }), "config.points[0].x");
  ExpectViolation(answer([](auto& c) { c.mutable_points(0)->set_y(-1); }), "config.points[0].y");
  ExpectViolation(answer([](auto& c) { *c.add_points() = c.points(0); }), "config.points[1].id");
  ExpectViolation(answer([](auto& c) { c.set_label(std::string(1000, 'x')); }), "config.label");
  EXPECT_THAT(TrackCall(channel_, JpegConfig()).FinishAndReadToEnd(), IsOk());
}

TEST_F(RejectionTest, WrongFrameAndPointFieldsAreNamed) {
  const auto answer = [this](const v1::TrackRequest& request) {
    TrackCall call(channel_, JpegConfig());
    call.SendFrame(0);
    call.Send(request);
    const absl::Status status = call.ReadToEnd();
    EXPECT_TRUE(call.tracks[7][0].final) << "the results before the mistake come first";
    return status;
  };
  v1::TrackRequest request;
  request.mutable_frame()->set_index(1);
  ExpectViolation(answer(request), "frame.data");
  request.mutable_frame()->set_data("good");
  request.mutable_frame()->mutable_capture_time()->set_nanos(-5);
  ExpectViolation(answer(request), "frame.capture_time");
  request.mutable_frame()->clear_capture_time();
  request.mutable_frame()->set_index(2);
  ExpectViolation(answer(request), "frame.index");
  request.mutable_frame()->set_index(1);
  request.mutable_frame()->add_points()->set_x(std::nanf(""));
  ExpectViolation(answer(request), "frame.points[0].x");
  *request.mutable_add_points() = AddPointsToProto({{1, 1, 1}, {2, 1, HUGE_VALF}});
  ExpectViolation(answer(request), "add_points.points[1].y");
}

TEST_F(RejectionTest, AFrameThatDoesNotDecodeEndsItsOwnStreamOnly) {
  TrackCall good(channel_, JpegConfig());
  TrackCall bad(channel_, JpegConfig());
  for (int64_t frame = 0; frame < 3; ++frame) {
    good.SendFrame(frame);
    bad.SendFrame(frame);
  }
  bad.SendFrame(3, "bad");
  const absl::Status status = bad.ReadToEnd();
  ExpectViolation(status, "frame.data");
  EXPECT_THAT(std::string(status.message()), HasSubstr("frame 3"));
  EXPECT_TRUE(bad.tracks[7][1].final);
  EXPECT_EQ(bad.tracks[7].count(2), 1U);
  for (int64_t frame = 3; frame < 6; ++frame) good.SendFrame(frame);
  EXPECT_THAT(good.FinishAndReadToEnd(), IsOk());
  EXPECT_THAT(good.tracks[7], SizeIs(6));
}

TEST_F(RejectionTest, ABugInTheEngineTellsTheClientNothingAboutTheServer) {
  TrackCall call(channel_, JpegConfig());
  call.SendFrame(0, "crash");
  EXPECT_THAT(call.ReadToEnd(), StatusIs(absl::StatusCode::kInternal, Not(HasSubstr("/usr/src"))));
}

TEST_F(RejectionTest, TooManySessionsAreRefusedWithATimeToComeBack) {
  TrackCall first(channel_, JpegConfig());
  TrackCall second(channel_, JpegConfig());
  TrackCall third(channel_);
  const absl::Status refused = third.ReadToEnd();  // which waits for no config
  EXPECT_THAT(refused, StatusIs(absl::StatusCode::kResourceExhausted));
  const auto overload = OverloadDetails(refused);
  ASSERT_TRUE(overload.has_value());
  EXPECT_EQ(overload->subject, "sessions");
  EXPECT_EQ(overload->retry_after, absl::Milliseconds(2500));
  first.SendFrame(0);
  EXPECT_THAT(first.FinishAndReadToEnd(), IsOk());
  EXPECT_THAT(second.FinishAndReadToEnd(), IsOk());
}

TEST_F(RejectionTest, StreamsThatNeverSendAConfigCannotPileUpAndGiveWay) {
  constexpr int kStreams = 40;
  constexpr int kAdmitted = 1 + 32;  // a session and those that wait to become one
  ServerOptions options;
  options.engine.max_sessions = 1;
  TestServer server(&engine_, options);
  const auto channel = server.NewChannel();
  absl::Mutex mutex;
  std::vector<absl::Status> refused;
  int late = 0;
  std::vector<std::unique_ptr<TrackCall>> calls;
  std::vector<std::thread> readers;
  for (int i = 0; i < kStreams; ++i) {
    calls.push_back(std::make_unique<TrackCall>(channel));
    readers.emplace_back([&, call = calls.back().get()] {
      const absl::Status status = call->ReadToEnd();  // the admitted ones end below
      absl::MutexLock lock(&mutex);
      if (absl::IsDeadlineExceeded(status)) {
        ++late;
      } else {
        refused.push_back(status);
      }
    });
  }
  {
    const auto all_refused = [&] { return refused.size() == kStreams - kAdmitted; };
    absl::MutexLock lock(&mutex);
    mutex.Await(absl::Condition(&all_refused));
  }
  server.clock().Advance(absl::Seconds(10));
  for (std::thread& reader : readers) reader.join();
  EXPECT_EQ(late, kAdmitted);
  ASSERT_THAT(refused, SizeIs(kStreams - kAdmitted));
  for (const absl::Status& status : refused) {
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted));
    ASSERT_TRUE(OverloadDetails(status).has_value());
    EXPECT_EQ(OverloadDetails(status)->subject, "streams");
  }
}

TEST_F(RejectionTest, AConfigMayBeLongOnItsWay) {
  TrackCall call(channel_);
  EXPECT_THAT(TrackCall(channel_, JpegConfig()).FinishAndReadToEnd(), IsOk());  // so that the first one is there
  for (int i = 0; i < 4; ++i) {
    server_.clock().Advance(absl::Minutes(1));
    server_.clock().AwaitSteadyReads(2);
  }
  call.SendConfig(ToProto(JpegConfig()));
  EXPECT_THAT(call.FinishAndReadToEnd(), IsOk());
}

TEST_F(RejectionTest, AStreamWithoutAConfigIsEndedInTime) {
  TrackCall call(channel_);
  EXPECT_THAT(ReadWhileTimePasses(call, server_.clock(), absl::Seconds(10)),
              StatusIs(absl::StatusCode::kDeadlineExceeded, HasSubstr("config")));
  EXPECT_THAT(TrackCall(channel_, JpegConfig()).FinishAndReadToEnd(), IsOk());
}

TEST_F(RejectionTest, AnIdleSessionIsEndedAfterItsResults) {
  TrackCall call(channel_, JpegConfig());
  call.SendFrame(0);
  EXPECT_THAT(ReadWhileTimePasses(call, server_.clock(), absl::Seconds(10)),
              StatusIs(absl::StatusCode::kDeadlineExceeded, HasSubstr("6m16s")));
  EXPECT_TRUE(call.tracks[7][0].final);
}

TEST_F(RejectionTest, AFrameMayBeLongOnItsWay) {
  TrackCall call(channel_, JpegConfig());
  call.SendFrame(0);
  engine_.AwaitFramesTaken(1);
  for (int i = 0; i < 6; ++i) {
    server_.clock().Advance(absl::Minutes(1));
    server_.clock().AwaitSteadyReads(2);
  }
  call.SendFrame(1);
  EXPECT_THAT(call.FinishAndReadToEnd(), IsOk());
  EXPECT_THAT(call.tracks[7], SizeIs(2));
}

// A token may be as long as kMaxTokenBytes; a smaller limit of frames is the engine's to watch.
TEST_F(RejectionTest, AMessageTooLargeForTheServerEndsTheStream) {
  for (const int64_t frame_bytes : {kMaxTokenBytes / 4, kMaxTokenBytes * 5 / 4}) {
    ServerOptions options;
    options.engine.limits.max_frame_bytes = frame_bytes;
    const int64_t largest = std::max(frame_bytes, kMaxTokenBytes);
    TestServer server(&engine_, options);
    TrackCall call(server.NewChannel(), JpegConfig());
    call.SendFrame(0, std::string(largest + (2 << 20), 'x'));
    EXPECT_THAT(call.ReadToEnd(), StatusIs(absl::StatusCode::kResourceExhausted));
    TrackCall next(server.NewChannel(), JpegConfig());
    next.SendFrame(0, std::string(largest, 'x'));
    EXPECT_THAT(next.FinishAndReadToEnd(), IsOk());
  }
}

}  // namespace
}  // namespace holdfast
