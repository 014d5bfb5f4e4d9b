// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/evaluator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "api/clock.h"
#include "tests/support/fake_tracker.h"
#include "tests/support/status_matchers.h"
#include "tests/training/data/moving_texture.h"
#include "training/evaluation/stream_clip_tracker.h"

namespace holdfast {
namespace {

using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Optional;
using ::testing::SizeIs;

constexpr ImageSize kScoredSize = {256, 256};  // so that a pixel is a scored pixel

class TickingClock final : public Clock {
 public:
  absl::Time WallNow() const override { return absl::UnixEpoch(); }
  SteadyTime SteadyNow() const override { return now_ += std::chrono::seconds(2); }

 private:
  mutable SteadyTime now_;
};

// Stays where the query was, 'offset' pixels to the right of it.
FakeTracker::Behaviour Standing(float offset, float confidence = 1) {
  return {[=](const PointQuery& query, int64_t, int64_t) {
    return FakeEstimate{query.x + offset, query.y, true, confidence};
  }};
}

// As another method, but silent about confidence.
class Silent final : public ClipTracker {
 public:
  explicit Silent(ClipTracker& method) : method_(method) {}
  std::string name() const override { return "silent"; }
  absl::StatusOr<ClipEstimate> Track(const Sample& clip, const std::vector<int64_t>& query_frames) override {
    absl::StatusOr<ClipEstimate> estimate = method_.Track(clip, query_frames);
    if (estimate.ok()) estimate->confidence.clear();
    return estimate;
  }

 private:
  ClipTracker& method_;
};

// What a method that stands still beside its points says of a clip.
Report StandingOn(const Sample& clip, float offset) {
  FakeTracker tracker(Standing(offset));
  StreamClipTracker method(tracker, {"standing"});
  const auto reports = Evaluate(ListDataset({clip}), {&method}, {}, TickingClock());
  EXPECT_THAT(reports, IsOk());
  return reports.ok() ? reports->at(0) : Report();
}

Sample Still(int64_t points) {
  return MovingTexture(4, kScoredSize, {0, 0}, std::vector<cv::Point2f>(points, cv::Point2f(100, 100)));
}

TEST(EvaluatorTest, ScoresEveryMethodOnTheSameClips) {
  FakeTracker exact_tracker(Standing(0));
  FakeTracker coarse_tracker(Standing(3));
  StreamClipTracker exact(exact_tracker, {"exact"});
  StreamClipTracker coarse(coarse_tracker, {"coarse"});
  const ListDataset data({Still(2), Still(1)});
  const auto reports = Evaluate(data, {&exact, &coarse}, {}, TickingClock());
  ASSERT_THAT(reports, IsOk());
  ASSERT_EQ(reports->size(), 2u);
  EXPECT_EQ((*reports)[0].method, "exact");
  EXPECT_EQ((*reports)[0].mean.delta_avg, 100);
  EXPECT_THAT((*reports)[1].mean.delta_avg, Optional(DoubleNear(60, 1e-9)));
  const SequenceReport& row = (*reports)[1].sequences[0];
  EXPECT_EQ(row.name, "moving texture");
  EXPECT_EQ(row.frames, 4);
  EXPECT_EQ(row.points, 2);
  EXPECT_EQ(row.frame_size, kScoredSize);
  EXPECT_EQ(row.processing_size, (ImageSize{512, 384}));
  EXPECT_EQ(row.seconds, 2);
}

TEST(EvaluatorTest, TheMeanIsOverVideosNotOverPoints) {
  Sample moving = MovingTexture(4, kScoredSize, {40, 0}, std::vector<cv::Point2f>(9, cv::Point2f(100, 100)));
  FakeTracker tracker(Standing(0));
  StreamClipTracker method(tracker, {"standing"});
  const auto reports = Evaluate(ListDataset({Still(1), moving}), {&method}, {}, TickingClock());
  ASSERT_THAT(reports, IsOk());
  EXPECT_EQ((*reports)[0].mean.delta_avg, 50);
}

TEST(EvaluatorTest, TheMeanOfIterationsIsOverVideosOfMethodsThatHaveSome) {
  FakeTracker tracker(Standing(0));
  double asked = 0;
  StreamClipTrackerOptions options{"counting"};
  options.iterations_taken = [&asked] { return ++asked; };  // 2 of the first clip, 4 of the second
  StreamClipTracker counting(tracker, options), other(tracker, {"other"});
  const auto reports = Evaluate(ListDataset({Still(1), Still(2)}), {&counting, &other}, {}, TickingClock());
  ASSERT_THAT(reports, IsOk());
  EXPECT_EQ((*reports)[0].sequences[1].iterations, 4);
  EXPECT_EQ((*reports)[0].iterations, 3);
  EXPECT_EQ((*reports)[1].iterations, std::nullopt);
}

TEST(EvaluatorTest, QueriesAPointInTheFirstFrameThatShowsIt) {
  Sample clip = MovingTexture(5, kScoredSize, {5, 0}, {{100, 100}});
  clip.visible[clip.At(0, 0)] = 0;
  clip.visible[clip.At(1, 0)] = 0;
  FakeTracker tracker(Standing(0));
  StreamClipTracker method(tracker, {"standing"});
  ASSERT_THAT(Evaluate(ListDataset({clip}), {&method}, {}, TickingClock()), IsOk());
  EXPECT_TRUE(tracker.frames()[0].points.empty());
  ASSERT_EQ(tracker.frames()[2].points.size(), 1u);
  EXPECT_EQ(tracker.frames()[2].points[0].x, 110);
}

TEST(EvaluatorTest, PointsThatOnlyTheLastFrameShowsAreLeftOut) {
  Sample clip = Still(3);
  for (int64_t t = 0; t < 4; ++t) clip.visible[clip.At(t, 1)] = t == 3;
  for (int64_t t = 0; t < 4; ++t) clip.visible[clip.At(t, 2)] = 0;
  FakeTracker tracker(Standing(0));
  StreamClipTracker method(tracker, {"standing"});
  const auto reports = Evaluate(ListDataset({clip}), {&method}, {}, TickingClock());
  ASSERT_THAT(reports, IsOk());
  EXPECT_EQ((*reports)[0].sequences[0].points, 1);
}

TEST(EvaluatorTest, ADamagedSequenceIsListedAndTheOthersCount) {
  FakeTracker tracker(Standing(0));
  StreamClipTracker method(tracker, {"standing"});
  const ListDataset data({absl::DataLossError("anno.npz is cut short"), Still(1)});
  const auto reports = Evaluate(data, {&method}, {}, TickingClock());
  ASSERT_THAT(reports, IsOk());
  EXPECT_EQ((*reports)[0].sequences.size(), 1u);
  ASSERT_EQ((*reports)[0].skipped.size(), 1u);
  EXPECT_EQ((*reports)[0].skipped[0].name, "#0");
  EXPECT_EQ((*reports)[0].skipped[0].reason, "anno.npz is cut short");
}

TEST(EvaluatorTest, ASequenceThatFailsOneMethodCountsForNone) {
  FakeTracker good_tracker(Standing(0));
  FakeTracker::Behaviour failing = Standing(0);
  failing.fail_at_frame = 5;
  FakeTracker failing_tracker(failing);
  StreamClipTracker good(good_tracker, {"good"});
  StreamClipTracker bad(failing_tracker, {"bad"});
  const Sample longer = MovingTexture(7, kScoredSize, {0, 0}, {{10, 10}});
  const auto reports = Evaluate(ListDataset({longer, Still(1)}), {&good, &bad}, {}, TickingClock());
  ASSERT_THAT(reports, IsOk());
  EXPECT_EQ((*reports)[0].sequences.size(), 1u);
  ASSERT_EQ((*reports)[0].skipped.size(), 1u);
  EXPECT_THAT((*reports)[0].skipped[0].reason, HasSubstr("bad: the tracker went away"));
  ASSERT_TRUE((*reports)[0].reliability.has_value());
  EXPECT_EQ((*reports)[0].reliability->claims, 3) << "of the other sequence";
}

TEST(EvaluatorTest, ReliabilityIsThatOfTheClaimsOfAllSequences) {
  // 6 estimates of the points that stand are right, 3 of the one that moves are wrong.
  const Sample moving = MovingTexture(4, kScoredSize, {40, 0}, {{10, 10}});
  FakeTracker tracker(Standing(0, /*confidence=*/0.75f));
  StreamClipTracker method(tracker, {"standing"});
  const auto reports = Evaluate(ListDataset({Still(2), moving}), {&method}, {}, TickingClock());
  ASSERT_THAT(reports, IsOk());
  const Report& report = (*reports)[0];
  EXPECT_THAT(report.sequences[0].claims, SizeIs(6));
  EXPECT_THAT(report.sequences[1].claims, SizeIs(3));
  ASSERT_TRUE(report.reliability.has_value());
  EXPECT_EQ(report.reliability->claims, 9);
  EXPECT_NEAR(report.reliability->ece, 0.75 - 6.0 / 9, 1e-9);
  EXPECT_NEAR(report.reliability->brier, (6 * 0.0625 + 3 * 0.5625) / 9, 1e-9);
  EXPECT_THAT(report.reliability->auc, Optional(DoubleNear(0.5, 1e-9)));
}

TEST(EvaluatorTest, AMethodWithoutConfidenceHasNoReliability) {
  FakeTracker tracker(Standing(0));
  StreamClipTracker method(tracker, {"standing"});
  Silent silent(method);
  const auto reports = Evaluate(ListDataset({Still(1)}), {&method, &silent}, {}, TickingClock());
  ASSERT_THAT(reports, IsOk());
  EXPECT_TRUE((*reports)[0].reliability.has_value());
  EXPECT_FALSE((*reports)[1].reliability.has_value());
  EXPECT_THAT((*reports)[1].sequences[0].claims, IsEmpty());
}

TEST(EvaluatorTest, MasksSayWhichEstimatesHaveLeftTheirObject) {
  Sample clip = TwoObjectClip();
  clip.object_ids = {1, 1, 2, 2};
  // The points are visible in 5 + 5 + 5 + 1 frames after their queries. 12 pixels to the right of the second one begins
  // the other object, and of the last one nothing.
  EXPECT_THAT(StandingOn(clip, 0).mean.left_object, Optional(DoubleNear(0, 1e-9)));
  EXPECT_THAT(StandingOn(clip, 12).mean.left_object, Optional(DoubleNear(100 * 6.0 / 16, 1e-9)));
  clip.object_ids = {1, 0, 2, 2};
  EXPECT_THAT(StandingOn(clip, 12).mean.left_object, Optional(DoubleNear(100 * 1.0 / 11, 1e-9)));
  clip.masks.clear();
  EXPECT_FALSE(StandingOn(clip, 12).mean.left_object.has_value());
}

TEST(EvaluatorTest, UnderAnEstimateThatIsNoPlaceLiesNothing) {
  Sample clip = TwoObjectClip();
  clip.SelectPoints({0, 2});
  ClipEstimate estimate;
  estimate.positions.assign(clip.tracks.size(), 40);
  const size_t frame_3 = 2 * clip.At(3, 0);
  estimate.positions[frame_3] = std::numeric_limits<float>::quiet_NaN();
  estimate.positions[frame_3 + 2] = 1e30f;
  const ScoredVideo video = ToScoredVideo(clip, {0, 0}, estimate);
  EXPECT_THAT(video.estimate_ids, ElementsAre(2, 2, 2, 2, 2, 2, 0, 0, 2, 2, 2, 2));
  EXPECT_EQ(video.object_ids, clip.object_ids);
}

TEST(EvaluatorTest, NothingLeftToScoreIsAnErrorThatSaysWhy) {
  FakeTracker tracker(Standing(0));
  StreamClipTracker method(tracker, {"standing"});
  EXPECT_THAT(Evaluate(ListDataset({absl::DataLossError("cut short")}), {&method}, {}, TickingClock()),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("cut short")));
  EXPECT_THAT(Evaluate(ListDataset({}), {&method}, {}, TickingClock()),
              StatusIs(absl::StatusCode::kFailedPrecondition));
}

TEST(EvaluatorTest, ReportsProgressBeforeEachSequence) {
  FakeTracker tracker(Standing(0));
  StreamClipTracker method(tracker, {"standing"});
  std::vector<std::pair<size_t, size_t>> seen;
  EvaluationOptions options;
  options.progress = [&](size_t index, size_t size) { seen.push_back({index, size}); };
  ASSERT_THAT(Evaluate(ListDataset({Still(1), Still(1)}), {&method}, options, TickingClock()), IsOk());
  EXPECT_EQ(seen, (std::vector<std::pair<size_t, size_t>>{{0, 2}, {1, 2}}));
}

}  // namespace
}  // namespace holdfast
