// SPDX-License-Identifier: Apache-2.0
#include "training/data/decorators.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/status_matchers.h"
#include "tests/training/data/moving_texture.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// 'count' copies of one clip that are named by their number.
std::unique_ptr<const Dataset> Copies(size_t count, const Sample& clip = TwoObjectClip()) {
  std::vector<absl::StatusOr<Sample>> samples;
  for (size_t i = 0; i < count; ++i) {
    samples.emplace_back(clip);
    samples.back()->source = std::to_string(i);
  }
  return std::make_unique<ListDataset>(std::move(samples));
}

std::unique_ptr<const Dataset> Damaged() {
  return std::make_unique<ListDataset>(std::vector<absl::StatusOr<Sample>>{absl::DataLossError("file 7 is damaged")});
}

std::vector<size_t> Order(const ShuffledDataset& shuffled, size_t begin, size_t count) {
  std::vector<size_t> order;
  Rng rng(1);
  for (size_t i = begin; i < begin + count; ++i) order.push_back(std::stoul(shuffled.Get(i, rng)->source));
  return order;
}

bool SamePictures(const Sample& a, const Sample& b) {
  return std::equal(
      a.frames.begin(), a.frames.end(), b.frames.begin(), b.frames.end(),
      [](const cv::Mat& x, const cv::Mat& y) { return x.size() == y.size() && cv::norm(x, y, cv::NORM_INF) == 0; });
}

TEST(ShuffledDatasetTest, EveryEpochIsAPermutationOfItsOwn) {
  for (const size_t count : {1, 2, 3, 5, 64, 100}) {
    const ShuffledDataset shuffled(Copies(count), 3);
    std::vector<size_t> all(count);
    std::iota(all.begin(), all.end(), 0);
    std::set<std::vector<size_t>> orders = {all};
    for (const size_t epoch : {size_t{0}, size_t{1}, size_t{1} << 40}) {
      std::vector<size_t> order = Order(shuffled, epoch * count, count);
      orders.insert(order);
      std::sort(order.begin(), order.end());
      EXPECT_EQ(order, all) << "epoch " << epoch << " of " << count;
    }
    if (count >= 64) {
      EXPECT_EQ(orders.size(), 4u) << "no two alike, and none is the data set's own";
    }
  }
}

TEST(ShuffledDatasetTest, TheOrderIsTheSeedsAlone) {
  EXPECT_EQ(Order(ShuffledDataset(Copies(50), 3), 20, 100), Order(ShuffledDataset(Copies(50), 3), 20, 100));
  EXPECT_NE(Order(ShuffledDataset(Copies(50), 3), 0, 50), Order(ShuffledDataset(Copies(50), 4), 0, 50));
}

TEST(ShuffledDatasetTest, TheStreamIsEndlessUnlessThereIsNothing) {
  EXPECT_EQ(ShuffledDataset(Copies(0), 3).size(), 0u);
  EXPECT_GE(ShuffledDataset(Copies(2), 3).size(), size_t{1} << 60);
}

TEST(CroppedDatasetTest, ClipsAreCutOrScaledWithEitherChance) {
  const CroppedDataset cropped(Copies(1), {32, 24});
  int scaled = 0, cut = 0;
  for (uint64_t seed = 0; seed < 40; ++seed) {
    Rng rng(seed);
    const auto clip = cropped.Get(0, rng);
    ASSERT_THAT(clip, IsOk());
    EXPECT_THAT(clip->Validate(), IsOk());
    EXPECT_EQ(clip->size(), (ImageSize{32, 24}));
    // A step is 2 pixels of the clip, and 1 of a clip of half the size.
    const float step = clip->Position(1, 0).x - clip->Position(0, 0).x;
    scaled += std::abs(step - 1) < 0.01f;
    cut += std::abs(step - 2) < 0.01f;
  }
  EXPECT_EQ(scaled + cut, 40);
  EXPECT_GT(scaled, 8);
  EXPECT_GT(cut, 8);
}

TEST(SelectedDatasetTest, KeepsGoodTracksAndPadsTheRest) {
  const SelectedDataset selected(Copies(1), 5, 2);
  Rng rng(1);
  const absl::StatusOr<Sample> clip = selected.Get(0, rng);
  ASSERT_THAT(clip, IsOk());
  EXPECT_THAT(clip->Validate(), IsOk());
  ASSERT_EQ(clip->num_points(), 5);
  std::vector<std::pair<float, int32_t>> starts;  // x, and the id read anew from the mask
  for (int64_t n = 0; n < 3; ++n) starts.emplace_back(clip->Position(0, n).x, clip->object_ids[static_cast<size_t>(n)]);
  std::sort(starts.begin(), starts.end());
  EXPECT_THAT(starts, ElementsAre(std::pair(10.0f, 1), std::pair(20.0f, 1), std::pair(40.0f, 2)));
  for (int64_t s = 0; s < 6; ++s) {
    for (const int64_t n : {3, 4}) EXPECT_FALSE(clip->Valid(s, n)) << "padding; the point that leaves at once is gone";
  }
}

TEST(SelectedDatasetTest, WhatIsTooNearTheBorderToBeSeenIsNoGoodTrack) {
  const Sample still = MovingTexture(4, {64, 48}, {0, 0}, {{0.5f, 20}, {20, 20}});
  const SelectedDataset selected(Copies(1, still), 2, 1);
  Rng rng(1);
  const absl::StatusOr<Sample> clip = selected.Get(0, rng);
  ASSERT_THAT(clip, IsOk());
  EXPECT_EQ(clip->Position(0, 0), cv::Point2f(20, 20));
  EXPECT_FALSE(clip->Valid(0, 1)) << "padding";
}

TEST(SelectedDatasetTest, IdsOfClipsWithoutMasksStayWithTheirPoints) {
  Sample clip = TwoObjectClip();
  clip.masks.clear();
  clip.object_ids = {7, 8, 9, 10};
  const SelectedDataset selected(Copies(1, clip), 2, 1);
  Rng rng(1);
  const absl::StatusOr<Sample> got = selected.Get(0, rng);
  ASSERT_THAT(got, IsOk());
  ASSERT_EQ(got->num_points(), 2) << "of three that are good";
  for (int64_t n = 0; n < 2; ++n) {
    const int32_t id = got->object_ids[static_cast<size_t>(n)];
    EXPECT_EQ(got->Position(0, n), clip.Position(0, id - 7));
  }
}

TEST(SelectedDatasetTest, TooFewGoodTracksMakeAClipUnusable) {
  Rng rng(1);
  EXPECT_THAT(SelectedDataset(Copies(3), 5, 3).Get(2, rng), IsOk()) << "three are good";
  EXPECT_THAT(SelectedDataset(Copies(3), 5, 4).Get(2, rng),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("2: only 3 good tracks, wanted 4")));
}

TEST(DecoratorsTest, DamagedClipsAreReportedAsTheyAre) {
  AugmentOptions options;
  options.size = {32, 24};
  const auto told = StatusIs(absl::StatusCode::kDataLoss, HasSubstr("file 7 is damaged"));
  Rng rng(1);
  EXPECT_THAT(ShuffledDataset(Damaged(), 3).Get(5, rng), told);
  EXPECT_THAT(CroppedDataset(Damaged(), {32, 24}).Get(0, rng), told);
  EXPECT_THAT(AugmentedDataset(Damaged(), options).Get(0, rng), told);
  EXPECT_THAT(SelectedDataset(Damaged(), 5, 2).Get(0, rng), told);
  EXPECT_THAT(TrainingStream(Damaged(), options, true, 4, 1)->Get(3, rng), told);
}

TEST(DecoratorsTest, AllButTheStreamHaveTheSizeOfTheirSource) {
  AugmentOptions options;
  options.size = {32, 24};
  EXPECT_EQ(CroppedDataset(Copies(3), {32, 24}).size(), 3u);
  EXPECT_EQ(AugmentedDataset(Copies(3), options).size(), 3u);
  EXPECT_EQ(SelectedDataset(Copies(3), 5, 2).size(), 3u);
}

TEST(TrainingStreamTest, SamplesStackAndAllChanceIsTheRngs) {
  AugmentOptions options;
  options.size = {56, 40};
  options.eraser_share = 0;
  options.drift_share = 0;
  options.photometric_share = 1;
  for (const bool augmented : {false, true}) {
    const auto stream = TrainingStream(Copies(3), options, augmented, 4, 1);
    std::set<std::string> sources;
    for (size_t i = 0; i < 20; ++i) {
      Rng rng(i), again(i);
      const absl::StatusOr<Sample> clip = stream->Get(i, rng);
      if (!clip.ok()) continue;
      sources.insert(clip->source);
      EXPECT_EQ(clip->num_points(), 4);
      EXPECT_EQ(clip->size(), options.size);
      EXPECT_THAT(clip->Validate(), IsOk());
      const absl::StatusOr<Sample> same = stream->Get(i, again);
      ASSERT_THAT(same, IsOk());
      EXPECT_EQ(same->tracks, clip->tracks);
      EXPECT_TRUE(SamePictures(*same, *clip));
    }
    EXPECT_THAT(sources, ElementsAre("0", "1", "2"));
  }
}

TEST(TrainingStreamTest, AQuarterOfThePointsMustBeGood) {
  AugmentOptions options;
  options.size = {64, 48};  // as the clip is: scaling and cutting leave everything where it is
  Rng rng(1);
  EXPECT_THAT(TrainingStream(Copies(1), options, false, 15, 1)->Get(0, rng), IsOk()) << "3 of 15 / 4";
  EXPECT_THAT(TrainingStream(Copies(1), options, false, 16, 1)->Get(0, rng),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("only 3 good tracks, wanted 4")));
}

}  // namespace
}  // namespace holdfast
