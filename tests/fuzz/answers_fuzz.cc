// SPDX-License-Identifier: Apache-2.0
// What a server answers to a client that has sent a few frames, and keeps them. The input is pieces, each an answer;
// one that accepts the session begins another call of it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "client/send_queue.h"
#include "client/session_answers.h"
#include "proto/convert.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

constexpr int64_t kFramesSent = 12;

// Checks what every observer may count on.
class CheckingObserver final : public TrackObserver {
 public:
  void OnTracks(TrackUpdate update) override {
    for (const PointRun& run : update.runs) {
      EXPECT_FALSE(run.x.empty());
      EXPECT_EQ(run.x.size(), run.y.size());
      EXPECT_EQ(run.x.size(), run.visible.size());
      EXPECT_EQ(run.x.size(), run.confidence.size());
      EXPECT_GE(run.first_frame, 0);
      EXPECT_GE(run.final_count, 0);
      EXPECT_LE(run.final_count, static_cast<int64_t>(run.x.size()));
    }
    EXPECT_GE(update.frames_processed, processed_);
    processed_ = update.frames_processed;
  }
  void OnDone(const absl::Status&, const SessionSummary&) override {}

 private:
  int64_t processed_ = 0;
};

// False: the client would end the session here.
bool Take(const std::string& bytes, SendQueue& queue, SessionAnswers& answers) {
  v1::TrackResponse response;
  if (!response.ParseFromString(bytes)) return false;
  if (!response.has_accepted()) return answers.Deliver(response).ok();
  const absl::StatusOr<SessionAccepted> accepted = FromProto(response.accepted());
  queue.Interrupt();
  if (!accepted.ok() || !queue.Restart(*accepted)) return false;
  answers.Begin(*accepted);
  return true;
}

}  // namespace
}  // namespace holdfast

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  holdfast::FuzzInput input(data, size);
  holdfast::SendQueue queue(/*buffer_bytes=*/1 << 20, /*keep=*/true);
  holdfast::CheckingObserver observer;
  holdfast::SessionAnswers answers(observer, queue);
  holdfast::SessionAccepted accepted;
  accepted.window_frames = 6;
  accepted.replay_frames = 8;
  accepted.checkpoint_interval_frames = 2;
  EXPECT_TRUE(queue.Restart(accepted));
  answers.Begin(accepted);
  for (int64_t i = 0; i < holdfast::kFramesSent; ++i) {
    holdfast::v1::TrackRequest request;
    request.mutable_frame()->set_index(i);
    EXPECT_THAT(queue.Push(std::move(request)), holdfast::IsOk());
    EXPECT_NE(queue.Next(), nullptr);
  }
  while (const std::optional<std::string> piece = input.TakePiece()) {
    if (!holdfast::Take(*piece, queue, answers)) break;
  }
  return 0;
}
