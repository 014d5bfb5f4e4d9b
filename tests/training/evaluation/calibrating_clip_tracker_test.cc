// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/calibrating_clip_tracker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/status_matchers.h"
#include "tests/training/data/moving_texture.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr ImageSize kCalibratedSize = {256, 256};  // so that a pixel is a scored pixel

// Evidence that can be told from any other.
Evidence EvidenceOf(PointId id, int64_t frame) {
  Evidence evidence;
  evidence.age = static_cast<int64_t>(id) * 100 + frame;
  return evidence;
}

// Follows every point exactly, and tells a sink of each estimate after its query.
class ExactMethod final : public ClipTracker {
 public:
  struct Behaviour {
    std::function<void(ClipEstimate&)> change = [](ClipEstimate&) {};
    int64_t untold_frame = -1;  // of point 0: the sink does not hear of it
    bool confident = true;      // says how much
    bool fails = false;         // half way
  };

  ExactMethod(EvidenceSink sink, Behaviour behaviour) : sink_(std::move(sink)), behaviour_(std::move(behaviour)) {}

  std::string name() const override { return "exact"; }
  absl::StatusOr<ClipEstimate> Track(const Sample& clip, const std::vector<int64_t>& query_frames) override {
    ClipEstimate estimate;
    estimate.positions = clip.tracks;
    estimate.visible.assign(clip.visible.size(), 1);
    if (behaviour_.confident) estimate.confidence.assign(clip.visible.size(), 0.5f);
    for (int64_t point = 0; point < clip.num_points(); ++point) {
      if (behaviour_.fails && point == 1) return absl::UnavailableError("the tracker went away");
      for (int64_t frame = query_frames[point] + 1; frame < clip.num_frames(); ++frame) {
        const auto id = static_cast<PointId>(point);
        if (point != 0 || frame != behaviour_.untold_frame) sink_(id, frame, EvidenceOf(id, frame));
      }
    }
    behaviour_.change(estimate);
    return estimate;
  }

 private:
  const EvidenceSink sink_;
  const Behaviour behaviour_;
};

class CalibratingClipTrackerTest : public ::testing::Test {
 protected:
  absl::StatusOr<ClipEstimate> Track(const Sample& clip, const std::vector<int64_t>& query_frames,
                                     ExactMethod::Behaviour behaviour = {}) {
    CalibratingClipTracker tracker(std::make_unique<ExactMethod>(log_.Sink(), std::move(behaviour)), log_, judged_);
    return tracker.Track(clip, query_frames);
  }
  // What marks the evidence of EvidenceOf.
  std::vector<int64_t> JudgedAges() const {
    std::vector<int64_t> ages;
    for (const Judged& judged : judged_) ages.push_back(judged.evidence.age);
    return ages;
  }

  EvidenceLog log_;
  std::vector<Judged> judged_;
};

Sample Still(int64_t frames, int64_t points) {
  return MovingTexture(frames, kCalibratedSize, {0, 0}, std::vector<cv::Point2f>(points, cv::Point2f(100, 100)));
}

TEST(EvidenceLogTest, GivesWhatWasReportedOnce) {
  EvidenceLog log;
  const EvidenceSink sink = log.Sink();
  sink(7, 3, EvidenceOf(7, 3));
  sink(7, 4, EvidenceOf(7, 4));
  sink(8, 3, EvidenceOf(8, 3));
  const auto evidence = log.Take();
  ASSERT_THAT(evidence, SizeIs(3));
  EXPECT_EQ(evidence.at({7, 4}).age, 704);
  EXPECT_EQ(evidence.at({8, 3}).age, 803);
  EXPECT_THAT(log.Take(), IsEmpty());
  sink(1, 1, EvidenceOf(1, 1));
  EXPECT_THAT(log.Take(), SizeIs(1));
}

TEST_F(CalibratingClipTrackerTest, GivesWhatTheMethodGives) {
  const Sample clip = Still(4, 2);
  CalibratingClipTracker tracker(std::make_unique<ExactMethod>(log_.Sink(), ExactMethod::Behaviour()), log_, judged_);
  EXPECT_EQ(tracker.name(), "exact");
  const auto estimate = tracker.Track(clip, {0, 0});
  ASSERT_THAT(estimate, IsOk());
  EXPECT_EQ(estimate->positions, clip.tracks);
  EXPECT_EQ(estimate->confidence, std::vector<float>(8, 0.5f));
}

TEST_F(CalibratingClipTrackerTest, JudgesEveryEstimateByItsOwnEvidence) {
  Sample clip = Still(4, 2);
  clip.visible[clip.At(2, 0)] = 0;  // an estimate of a hidden point is wrong
  clip.valid[clip.At(3, 1)] = 0;    // nobody knows
  clip.visible[clip.At(3, 1)] = 0;
  ExactMethod::Behaviour behaviour;
  behaviour.change = [&clip](ClipEstimate& estimate) { estimate.positions[2 * clip.At(3, 0)] += 8; };
  ASSERT_THAT(Track(clip, {0, 1}, behaviour), IsOk());
  EXPECT_THAT(JudgedAges(), ElementsAre(1, 2, 3, 102));
  EXPECT_TRUE(judged_[0].right);
  EXPECT_FALSE(judged_[1].right);
  EXPECT_FALSE(judged_[2].right);
  EXPECT_TRUE(judged_[3].right);
}

TEST_F(CalibratingClipTrackerTest, ClipsAddUp) {
  ASSERT_THAT(Track(Still(3, 1), {0}), IsOk());
  ASSERT_THAT(Track(Still(2, 2), {0, 0}), IsOk());
  EXPECT_THAT(JudgedAges(), ElementsAre(1, 2, 1, 101));
}

TEST_F(CalibratingClipTrackerTest, MissingEvidenceIsAnError) {
  ExactMethod::Behaviour behaviour;
  behaviour.untold_frame = 2;
  EXPECT_THAT(Track(Still(4, 2), {0, 0}, behaviour),
              StatusIs(absl::StatusCode::kInternal, HasSubstr("no evidence for point 0 in frame 2")));
}

TEST_F(CalibratingClipTrackerTest, AMethodsErrorIsPassedOnAndTheClipForgotten) {
  ExactMethod::Behaviour failing, silent;
  failing.fails = true;
  silent.untold_frame = 1;
  EXPECT_THAT(Track(Still(4, 2), {0, 0}, failing),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("the tracker went away")));
  EXPECT_THAT(judged_, IsEmpty());
  EXPECT_THAT(Track(Still(4, 2), {0, 0}, silent), StatusIs(absl::StatusCode::kInternal))
      << "evidence of the clip before does not stand for this one's";
}

TEST_F(CalibratingClipTrackerTest, AMethodWithoutConfidenceIsNotJudged) {
  ExactMethod::Behaviour behaviour;
  behaviour.confident = false;
  ASSERT_THAT(Track(Still(3, 1), {0}, behaviour), IsOk());
  EXPECT_THAT(judged_, IsEmpty());
}

}  // namespace
}  // namespace holdfast
