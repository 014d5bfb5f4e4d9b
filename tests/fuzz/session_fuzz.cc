// SPDX-License-Identifier: Apache-2.0
// Streams of requests, as a client may send them: the messages' bytes go through the codec and the conversions into
// sessions of an engine, whose network is known. The first byte says how streams end whose messages were all taken.
// Then come pieces, each a request. Behind an empty piece a stream is suspended, and another one begins, which may
// resume it: the tokens are "0", "1"...
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "proto/convert.h"
#include "server/engine/engine_with_model.h"
#include "server/streams/message_codec.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/fake_tracker_model.h"
#include "tests/support/memory_sealer.h"
#include "tests/support/recorders.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

enum class End { kFinish, kSuspend, kCancel };

// Small enough that an input of a few hundred bytes has several windows.
EngineOptions Options(const CheckpointSealer& sealer) {
  EngineOptions options;
  options.decode_threads = 1;
  options.processing_size = {32, 32};
  options.max_processing_pixels = int64_t{64} * 64;
  options.hop_frames = 2;
  options.iterations = 1;
  options.max_iterations = 4;
  options.max_sessions = 1;
  options.max_pending_frames = 3;
  options.limits = {/*max_points=*/16, /*max_frame_bytes=*/4096, /*max_frame_pixels=*/int64_t{64} * 64, 0};
  options.sealer = &sealer;
  return options;
}

absl::Status Apply(v1::TrackRequest request, EngineSession& session, RecordingListener& listener) {
  switch (request.request_case()) {
    case v1::TrackRequest::kFrame: {
      auto frame = FromProto(std::move(*request.mutable_frame()));
      return frame.ok() ? listener.Push(session, *std::move(frame)).status() : frame.status();
    }
    case v1::TrackRequest::kAddPoints: {
      const auto points = FromProto(request.add_points());
      return points.ok() ? session.AddPoints(*points) : points.status();
    }
    case v1::TrackRequest::kRemovePoints: {
      const auto ids = FromProto(request.remove_points());
      return ids.ok() ? session.RemovePoints(*ids) : ids.status();
    }
    default:
      return absl::InvalidArgumentError("not for a session that is open");
  }
}

void EndSession(EngineSession& session, End end) {
  switch (end) {
    case End::kFinish:
      return session.Finish();
    case End::kSuspend:
      return session.Suspend(absl::UnavailableError("the server is shutting down"));
    case End::kCancel:
      return session.Cancel();
  }
}

// What ServedStream does with the messages of a stream, without gRPC around it.
class Stream {
 public:
  explicit Stream(Engine& engine) : engine_(engine) {}

  absl::Status Take(const std::string& bytes) {
    const grpc::Slice slice(bytes);
    grpc::ByteBuffer buffer(&slice, 1);
    v1::TrackRequest request;
    if (absl::Status status = ParseRequest(buffer, engine_.limits().max_points, request); !status.ok()) {
      return status;
    }
    return session_ == nullptr ? Open(request) : Apply(std::move(request), *session_, listener_);
  }

  void Close(const absl::Status& status, End end) {
    if (session_ == nullptr) return;
    if (status.ok()) {
      EndSession(*session_, end);
    } else {
      session_->Fail(status);
    }
    (void)listener_.AwaitDone();
    session_ = nullptr;
    for (const TrackUpdate& update : listener_.updates()) EXPECT_THAT(FromProto(ToProto(update)), IsOk());
  }

 private:
  absl::Status Open(const v1::TrackRequest& request) {
    if (!request.has_config()) return absl::InvalidArgumentError("the config is missing");
    const absl::StatusOr<SessionConfig> config = FromProto(request.config());
    if (!config.ok()) return config.status();
    auto opened = engine_.OpenSession(*config, listener_);
    if (!opened.ok()) return opened.status();
    session_ = *std::move(opened);
    EXPECT_THAT(FromProto(ToProto(session_->accepted())), IsOk());
    return absl::OkStatus();
  }

  Engine& engine_;
  RecordingListener listener_;
  std::unique_ptr<EngineSession> session_;  // before the listener goes
};

// Whether another stream follows.
bool RunStream(Engine& engine, FuzzInput& input, End end) {
  Stream stream(engine);
  absl::Status status;
  while (const std::optional<std::string> piece = input.TakePiece()) {
    if (piece->empty()) {
      stream.Close(status, End::kSuspend);
      return true;
    }
    if (status.ok()) status = stream.Take(*piece);
  }
  stream.Close(status, end);
  return false;
}

}  // namespace
}  // namespace holdfast

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using holdfast::End;
  constexpr End kEnds[] = {End::kFinish, End::kSuspend, End::kCancel};
  holdfast::FuzzInput input(data, size);
  const End end = kEnds[input.TakeByte() % 3];
  const holdfast::MemorySealer sealer;
  holdfast::SimulatedClock clock;
  holdfast::NullEngineMetrics metrics;
  auto model = std::make_unique<holdfast::FakeTrackerModel>(/*window_frames=*/6);
  const auto engine = holdfast::CreateEngineWithModel(holdfast::Options(sealer), std::move(model), clock, metrics);
  EXPECT_THAT(engine, holdfast::IsOk());
  while (holdfast::RunStream(**engine, input, end)) {
  }
  return 0;
}
