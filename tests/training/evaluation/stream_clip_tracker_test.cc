// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/stream_clip_tracker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/fake_tracker.h"
#include "tests/support/status_matchers.h"
#include "tests/training/data/moving_texture.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr ImageSize kStreamSize = {48, 32};

// Two frames' worth of movement a frame, hidden on odd frames and less confident on later ones.
FakeEstimate Slide(const PointQuery& query, int64_t query_frame, int64_t frame) {
  return {query.x + 2.0f * (frame - query_frame), query.y, frame % 2 == 0, 1 - 0.125f * (frame - query_frame)};
}

FakeTracker::Behaviour Sliding() { return {Slide}; }
Sample Clip() { return MovingTexture(5, kStreamSize, {2, 0}, {{10, 20}, {12, 8}}); }

TEST(StreamClipTrackerTest, TakesTheFinalEstimatesOnly) {
  FakeTracker tracker(Sliding());
  const Sample clip = Clip();
  const auto estimate = StreamClipTracker(tracker, {"fake"}).Track(clip, {0, 3});
  ASSERT_THAT(estimate, IsOk());
  EXPECT_EQ(estimate->positions[2 * clip.At(4, 0)], 18);
  EXPECT_EQ(estimate->positions[2 * clip.At(4, 0) + 1], 20);
  EXPECT_EQ(estimate->positions[2 * clip.At(4, 1)], clip.Position(3, 1).x + 2);
  EXPECT_EQ(estimate->visible[clip.At(3, 0)], 0);
  EXPECT_EQ(estimate->visible[clip.At(4, 0)], 1);
  EXPECT_TRUE(std::isnan(estimate->positions[2 * clip.At(2, 1)])) << "before the query there is no estimate";
}

TEST(StreamClipTrackerTest, TakesTheConfidenceOfFinalEstimatesOver) {
  FakeTracker tracker(Sliding());
  const Sample clip = Clip();
  const auto estimate = StreamClipTracker(tracker, {"fake"}).Track(clip, {0, 3});
  ASSERT_THAT(estimate, IsOk());
  // By frame, of both points in turn; before the query there is no estimate to trust.
  EXPECT_THAT(estimate->confidence, ElementsAre(1, 0, 0.875f, 0, 0.75f, 0, 0.625f, 1, 0.5f, 0.875f));
}

TEST(StreamClipTrackerTest, GivesEachPointInTheFrameOfItsQuery) {
  FakeTracker tracker(Sliding());
  const Sample clip = Clip();
  ASSERT_THAT(StreamClipTracker(tracker, {"fake"}).Track(clip, {0, 3}), IsOk());
  ASSERT_EQ(tracker.frames().size(), 5u);
  ASSERT_EQ(tracker.frames()[0].points.size(), 1u);
  EXPECT_EQ(tracker.frames()[0].points[0].x, 10);
  EXPECT_TRUE(tracker.frames()[1].points.empty());
  ASSERT_EQ(tracker.frames()[3].points.size(), 1u);
  EXPECT_EQ(tracker.frames()[3].points[0].id, 1u);
  EXPECT_EQ(tracker.frames()[3].points[0].x, clip.Position(3, 1).x);
}

TEST(StreamClipTrackerTest, SendsRawRgbFramesOfTheClipsOwnSize) {
  FakeTracker tracker(Sliding());
  Sample clip = Clip();
  const cv::Mat wide(kStreamSize.height, kStreamSize.width + 5, CV_8UC3, cv::Scalar(1, 2, 3));
  clip.frames[1] = wide(cv::Rect(0, 0, kStreamSize.width, kStreamSize.height));  // rows with a gap in memory
  ASSERT_THAT(StreamClipTracker(tracker, {"fake"}).Track(clip, {0, 0}), IsOk());
  EXPECT_EQ(tracker.configs()[0].encoding, FrameEncoding::kRgb24);
  EXPECT_EQ(tracker.configs()[0].raw_size, kStreamSize);
  EXPECT_FALSE(tracker.configs()[0].send_provisional);
  const std::string& bytes = tracker.frames()[1].bytes;
  ASSERT_EQ(bytes.size(), 3u * kStreamSize.width * kStreamSize.height);
  EXPECT_EQ(bytes.substr(bytes.size() - 3), "\x1\x2\x3");
  EXPECT_EQ(static_cast<uchar>(tracker.frames()[0].bytes[2]), TextureAt(0, 0)[2]);
}

TEST(StreamClipTrackerTest, PassesTheSettingsAndReportsTheSizeAgreed) {
  FakeTracker tracker(Sliding());
  StreamClipTracker chosen(tracker, {"fake", {96, 64}, 23, 16});
  const auto at_chosen = chosen.Track(Clip(), {0, 0});
  ASSERT_THAT(at_chosen, IsOk());
  EXPECT_EQ(at_chosen->processing_size, (ImageSize{96, 64}));
  EXPECT_EQ(tracker.configs()[0].hop_frames, 23);
  EXPECT_EQ(tracker.configs()[0].iterations, 16);
  const auto at_default = StreamClipTracker(tracker, {"fake"}).Track(Clip(), {0, 0});
  ASSERT_THAT(at_default, IsOk());
  EXPECT_EQ(at_default->processing_size, (ImageSize{512, 384}));
}

TEST(StreamClipTrackerTest, SaysHowManyIterationsTheClipItselfTook) {
  FakeTracker tracker(Sliding());
  StreamClipTrackerOptions options{"fake"};
  double asked = 0;
  options.iterations_taken = [&asked] { return ++asked; };
  const auto estimate = StreamClipTracker(tracker, options).Track(Clip(), {0, 0});
  ASSERT_THAT(estimate, IsOk());
  EXPECT_EQ(estimate->iterations, 2) << "what was before the clip is not of it";
  EXPECT_EQ(StreamClipTracker(tracker, {"fake"}).Track(Clip(), {0, 0})->iterations, std::nullopt);
}

TEST(StreamClipTrackerTest, ASessionThatEndsEarlyIsAnError) {
  FakeTracker::Behaviour behaviour = Sliding();
  behaviour.fail_at_frame = 2;
  FakeTracker tracker(behaviour);
  EXPECT_THAT(StreamClipTracker(tracker, {"fake"}).Track(Clip(), {0, 0}), StatusIs(absl::StatusCode::kUnavailable));
}

TEST(StreamClipTrackerTest, AnEstimateThatNeverBecameFinalIsAnError) {
  FakeTracker::Behaviour behaviour = Sliding();
  behaviour.final_frames_missing = 1;
  FakeTracker tracker(behaviour);
  EXPECT_THAT(StreamClipTracker(tracker, {"fake"}).Track(Clip(), {0, 0}),
              StatusIs(absl::StatusCode::kInternal, HasSubstr("point 0 in frame 4")));
}

}  // namespace
}  // namespace holdfast
