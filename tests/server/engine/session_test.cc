// SPDX-License-Identifier: Apache-2.0
// What a session lets wait. That it tracks is seen with the whole engine around it: engine_test.cc.
#include "server/engine/session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/recorders.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr ImageSize kSmallFrame{64, 32};

// A session that uses optical flow; nobody computes for it, and its jobs wait until RunJobs.
class SessionTest : public ::testing::Test {
 protected:
  SessionTest() {
    Session::Options options;
    options.accepted.processing_size = kSmallFrame;
    options.accepted.motion_prior = true;
    options.inbox.format = {FrameEncoding::kGray8, kSmallFrame, 1 << 20};
    options.inbox.limits = {/*max_points=*/4, /*max_frame_bytes=*/1 << 20, /*max_frame_pixels=*/1 << 20, 0};
    options.windows.frames = 4;
    options.windows.hop = 2;
    options.max_cached_frames = 16;
    const Session::Threads threads{[this](std::function<void()> job) { jobs_.push_back(std::move(job)); }, [] {}};
    session_ = std::make_shared<Session>(options, listener_, clock_, metrics_, threads, nullptr);
  }

  void PushFrame(int64_t index) {
    const auto pixels = static_cast<size_t>(Pixels(kSmallFrame));
    ASSERT_THAT(session_->PushFrame({index, std::string(pixels, '\x77'), {}, {}}), IsOk());
  }
  void RunJobs() {
    for (const auto& job : std::exchange(jobs_, {})) job();
  }

  SimulatedClock clock_;
  RecordingMetrics metrics_;
  RecordingListener listener_;
  std::vector<std::function<void()>> jobs_;
  std::shared_ptr<Session> session_;
};

TEST_F(SessionTest, OneJobOfFlowWaitsHoweverOftenPointsAreAdded) {
  PushFrame(0);
  ASSERT_THAT(jobs_, SizeIs(1)) << "it decodes";
  for (int i = 0; i < 100; ++i) ASSERT_THAT(session_->AddPoints({{1, static_cast<float>(i % 60), 3}}), IsOk());
  EXPECT_THAT(jobs_, SizeIs(2));
  RunJobs();
  ASSERT_THAT(session_->AddPoints({{2, 5, 5}}), IsOk());
  EXPECT_THAT(jobs_, SizeIs(1)) << "the one before has begun and may have seen all that it will";
}

// Flow takes changes of points over as they come: what the tracks have not seen waits all the same.
TEST_F(SessionTest, ChangesThatTheTracksHaveNotSeenAreBounded) {
  PushFrame(0);
  absl::Status added;
  int changes = 0;
  for (; added.ok() && changes < 10'000; ++changes) {
    added = session_->AddPoints({{1, static_cast<float>(changes % 60), 3}});
    RunJobs();
  }
  EXPECT_THAT(added, StatusIs(kExhausted, HasSubstr("at most 1040 changes of points may wait at one frame")));
  PushFrame(1);
  EXPECT_THAT(session_->AddPoints({{1, 2, 3}}), IsOk()) << "the next frame has room of its own";
}

}  // namespace
}  // namespace holdfast
