// SPDX-License-Identifier: Apache-2.0
// Streams of requests, as a client may send them: the messages' bytes go through the codec into streams of an engine,
// whose network is known. The first byte says how streams end whose messages were all taken. Then come pieces, each a
// request. Behind an empty piece a stream is suspended, and another one begins, which may resume it: the tokens are
// "0", "1"...
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "proto/convert.h"
#include "server/engine/engine_with_model.h"
#include "server/events.h"
#include "server/logging.h"
#include "server/streams/message_codec.h"
#include "server/streams/served_stream.h"
#include "server/tracing/trace_context.h"
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

// Both carriers' ways of reading a message judge it alike.
absl::StatusOr<v1::TrackRequest> Parse(const std::string& bytes, int max_points) {
  const grpc::Slice slice(bytes);
  grpc::ByteBuffer buffer(&slice, 1);
  v1::TrackRequest request;
  const absl::Status status = ParseRequest(buffer, max_points, request);
  EXPECT_EQ(ParseRequest(bytes, max_points).status(), status);
  if (!status.ok()) return status;
  return request;
}

// Carries a stream on the fuzzer's thread: events are what the stream asked for last. What the stream sends has to be
// well-formed.
class Carrier final : public StreamCarrier {
 public:
  enum class Event { kWritten, kRead, kFinished };

  // Blocks until the stream wants something; writes come first.
  Event Await() ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    while (!writing_ && !reading_ && !finished_) changed_.Wait(&mutex_);
    if (std::exchange(writing_, false)) return Event::kWritten;
    if (finished_) return Event::kFinished;
    reading_ = false;
    return Event::kRead;
  }

  void StartRead() override { Note(&Carrier::reading_); }
  void StartWrite(const v1::TrackResponse& response) override {
    if (response.has_accepted()) {
      EXPECT_THAT(FromProto(response.accepted()), IsOk());
    }
    if (response.has_tracks()) {
      auto update = FromProto(response.tracks());
      EXPECT_THAT(update, IsOk());
      if (update.ok()) updates_.Add(*std::move(update));
    }
    Note(&Carrier::writing_);
  }
  void Finish(const absl::Status& status) override {
    updates_.Done(status, {});
    Note(&Carrier::finished_);
  }
  void Cancel() override { ADD_FAILURE() << "no time goes by"; }

 private:
  void Note(bool Carrier::*what) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    EXPECT_FALSE(this->*what) << "asked twice";
    this->*what = true;
    changed_.SignalAll();
  }

  UpdateRecorder updates_;
  absl::Mutex mutex_;
  absl::CondVar changed_;
  bool reading_ ABSL_GUARDED_BY(mutex_) = false;
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
};

class NullEvents final : public ServerEvents {
 public:
  void StreamRefused(RefusalReason) override {}
  void SessionResumed(ResumeResult) override {}
  void CheckpointSent(int64_t) override {}
  void SpansDone(SpanResult, int64_t) override {}
};

void EndStream(ServedStream& stream, End end) {
  switch (end) {
    case End::kFinish:
      return stream.OnInputEnd();
    case End::kSuspend:
      return stream.Suspend(absl::UnavailableError("the server is shutting down"));
    case End::kCancel:
      return stream.OnCancel();
  }
}

// The pieces of one stream.
class Pieces {
 public:
  explicit Pieces(FuzzInput& input) : input_(input) {}

  // None at the end of the stream.
  std::optional<std::string> Take() {
    if (ended_) return std::nullopt;
    std::optional<std::string> piece = input_.TakePiece();
    another_ = piece && piece->empty();
    ended_ = !piece || another_;
    return ended_ ? std::nullopt : piece;
  }
  // Whether another stream follows. Leaves out what this one did not take.
  bool Skip() {
    while (Take()) {
    }
    return another_;
  }
  bool another() const { return another_; }

 private:
  FuzzInput& input_;
  bool ended_ = false;
  bool another_ = false;
};

// Whether another stream follows.
bool RunStream(Engine& engine, Clock& clock, FuzzInput& input, End end) {
  static const auto* const log = new auto(MakeLogger(LogFormat::kText, "off"));
  NullEvents events;
  Carrier carrier;
  ServedStream stream({engine, clock, events, *log, {}, /*spans=*/nullptr, "fuzz"}, {}, TraceOf(""), carrier);
  stream.Begin();
  Pieces pieces(input);
  for (auto event = carrier.Await(); event != Carrier::Event::kFinished; event = carrier.Await()) {
    if (event == Carrier::Event::kWritten) {
      stream.OnWritten(true);
    } else if (const std::optional<std::string> piece = pieces.Take()) {
      stream.OnRequest(Parse(*piece, engine.limits().max_points));
    } else {
      EndStream(stream, pieces.another() ? End::kSuspend : end);
    }
  }
  return pieces.Skip();
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
  while (holdfast::RunStream(**engine, clock, input, end)) {
  }
  return 0;
}
