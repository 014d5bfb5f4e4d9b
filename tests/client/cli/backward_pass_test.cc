// SPDX-License-Identifier: Apache-2.0
#include "client/cli/backward_pass.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <string>

#include "absl/strings/str_cat.h"
#include "tests/support/fake_tracker.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

PointRun SessionRun(int64_t first_frame, std::vector<float> x, int64_t final_count) {
  const size_t n = x.size();
  return {1,
          first_frame,
          std::move(x),
          std::vector<float>(n, 2),
          std::vector<uint8_t>(n, 1),
          std::vector<float>(n, 1),
          final_count};
}

TEST(ReversedRunsTest, FinalAndProvisionalEstimatesComeOutAscending) {
  // The session over frames 9, 8, ... 0 speaks of its frames 2..5, which are the video's 7..4.
  const std::vector<PointRun> runs = ReversedRuns(SessionRun(2, {70, 60, 50, 40}, 1), 9, 9);
  ASSERT_EQ(runs.size(), 2u);
  EXPECT_EQ(runs[0].first_frame, 7);
  EXPECT_THAT(runs[0].x, ElementsAre(70));
  EXPECT_EQ(runs[0].final_count, 1);
  EXPECT_EQ(runs[1].first_frame, 4);
  EXPECT_THAT(runs[1].x, ElementsAre(40, 50, 60));
  EXPECT_EQ(runs[1].final_count, 0);
}

TEST(ReversedRunsTest, TheQueryItselfIsNoPast) {
  const std::vector<PointRun> runs = ReversedRuns(SessionRun(4, {50, 40, 30}, 3), 9, 5);
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0].first_frame, 3);
  EXPECT_THAT(runs[0].x, ElementsAre(30, 40));
  EXPECT_EQ(runs[0].final_count, 2);
  EXPECT_TRUE(ReversedRuns(SessionRun(4, {50}, 1), 9, 5).empty());
}

class Events final : public TrackObserver {
 public:
  void OnTracks(TrackUpdate) override {}
  void OnDone(const absl::Status&, const SessionSummary&) override {}
};

class BackwardPassTest : public ::testing::Test {
 protected:
  BackwardPassTest() {
    auto spool = FrameSpool::Create();
    EXPECT_THAT(spool, IsOk());
    spool_ = std::make_unique<FrameSpool>(*std::move(spool));
    for (int i = 0; i < 6; ++i) EXPECT_THAT(spool_->Append(absl::StrCat("frame ", i)), IsOk());
    behaviour_.path = [](const PointQuery& query, int64_t query_frame, int64_t frame) {
      return FakeEstimate{query.x - static_cast<float>(frame - query_frame), query.y, true};
    };
  }

  absl::Status Run(FakeTracker& tracker) {
    BackwardPass pass({}, {{{7, 10, 20}, 2}, {{8, 30, 40}, 4}}, *spool_, events_, [this](const TrackUpdate& update) {
      for (const PointRun& run : update.runs) {
        for (int64_t i = 0; i < run.final_count; ++i) finals_[run.id][run.first_frame + i] = run.x[i];
      }
      return refusal_;
    });
    return pass.Run(tracker, stop_);
  }

  std::unique_ptr<FrameSpool> spool_;
  FakeTracker::Behaviour behaviour_;
  Events events_;
  StopSignal stop_;
  absl::Status refusal_;
  std::map<PointId, std::map<int64_t, float>> finals_;
};

TEST_F(BackwardPassTest, FramesGoBackFromTheLastQueryAndEstimatesComeOutUnderTheirOwnNumbers) {
  FakeTracker tracker(behaviour_);
  ASSERT_THAT(Run(tracker), IsOk());
  ASSERT_EQ(tracker.frames().size(), 5u);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(tracker.frames()[i].bytes, absl::StrCat("frame ", 4 - i));
  ASSERT_EQ(tracker.configs()[0].points.size(), 1u);
  EXPECT_EQ(tracker.configs()[0].points[0].id, 8u);
  ASSERT_EQ(tracker.frames()[2].points.size(), 1u);
  EXPECT_EQ(tracker.frames()[2].points[0].id, 7u);
  // Points of this tracker move to the left on the way back, as they move to the right in the video.
  EXPECT_EQ(finals_[7], (std::map<int64_t, float>{{0, 8}, {1, 9}}));
  EXPECT_EQ(finals_[8], (std::map<int64_t, float>{{0, 26}, {1, 27}, {2, 28}, {3, 29}}));
}

TEST_F(BackwardPassTest, EndsWithWhatWentWrong) {
  behaviour_.fail_at_frame = 3;
  FakeTracker lost(behaviour_);
  EXPECT_THAT(Run(lost), StatusIs(absl::StatusCode::kUnavailable));
  behaviour_.fail_at_frame = -1;
  FakeTracker tracker(behaviour_);
  refusal_ = absl::DataLossError("nobody reads");
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("nobody reads")));
  EXPECT_LT(tracker.frames().size(), 5u);
}

TEST_F(BackwardPassTest, AStopThatCameBeforeCancelsIt) {
  stop_.Stop();
  behaviour_.fail_at_frame = 0;  // as a cancelled session takes no frame
  FakeTracker cancelled(behaviour_);
  EXPECT_THAT(Run(cancelled), StatusIs(absl::StatusCode::kCancelled, HasSubstr("interrupted")));
}

}  // namespace
}  // namespace holdfast
