// SPDX-License-Identifier: Apache-2.0
#include "training/data/readers/point_odyssey.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "absl/strings/str_format.h"
#include "io/npz_writer.h"
#include "tests/support/npy_bytes.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "training/data/image_files.h"
#include "training/data/loader.h"

namespace holdfast {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr int64_t kFrames = 8, kPoints = 6;
constexpr int kWidth = 96, kHeight = 54;  // a tenth of the published size

// Points that slide right by one pixel a frame; point 0 starts at (10, 10), each next one 8 pixels below and right.
struct Annotations {
  std::vector<float> xy = std::vector<float>(kFrames * kPoints * 2);
  std::vector<uint8_t> visible = std::vector<uint8_t>(kFrames * kPoints, 1);
  std::vector<uint8_t> valid = std::vector<uint8_t>(kFrames * kPoints, 1);

  Annotations() {
    for (int64_t t = 0; t < kFrames; ++t) {
      for (int64_t p = 0; p < kPoints; ++p)
        Set(t, p, 10.f + 8.f * static_cast<float>(p) + static_cast<float>(t), 10.f + 6.f * static_cast<float>(p));
    }
  }
  void Set(int64_t t, int64_t p, float x, float y) {
    xy[static_cast<size_t>(2 * (t * kPoints + p))] = x;
    xy[static_cast<size_t>(2 * (t * kPoints + p) + 1)] = y;
  }
  static size_t At(int64_t t, int64_t p) { return static_cast<size_t>(t * kPoints + p); }
};

class PointOdysseyTest : public ::testing::Test {
 protected:
  fs::path Sequence(const std::string& name) { return root_.path() / "train" / name; }

  // The published layout.
  void WriteSequence(const std::string& name, const Annotations& a, bool masks = true) {
    WritePictures(name, masks);
    EXPECT_THAT(
        WriteNpz((Sequence(name) / "anno.npz").string(), {{"trajs_2d", NpyBytes("<f4", {kFrames, kPoints, 2}, a.xy)},
                                                          {"visibs", NpyBytes("|b1", {kFrames, kPoints}, a.visible)},
                                                          {"valids", NpyBytes("|b1", {kFrames, kPoints}, a.valid)}}),
        IsOk());
  }

  // Left half of the masks is object 50, right half object 200; the frames tell their number by their grey.
  void WritePictures(const std::string& name, bool masks) {
    fs::create_directories(Sequence(name) / "rgbs");
    if (masks) fs::create_directories(Sequence(name) / "masks");
    for (int t = 0; t < kFrames; ++t) {
      const cv::Mat frame(kHeight, kWidth, CV_8UC3, cv::Scalar::all(20 * t));
      ASSERT_THAT(WriteFrame((Sequence(name) / "rgbs" / absl::StrFormat("rgb_%05d.jpg", t)).string(), frame), IsOk());
      if (!masks) continue;
      cv::Mat mask(kHeight, kWidth, CV_32SC1, cv::Scalar(50));
      mask.colRange(kWidth / 2, kWidth).setTo(200);
      ASSERT_THAT(WriteMask((Sequence(name) / "masks" / absl::StrFormat("mask_%05d.png", t)).string(), mask), IsOk());
    }
  }

  PointOdysseyOptions Options() {
    PointOdysseyOptions options;
    options.root = root_.path().string();
    options.frames = 4;
    options.strides = {1, 2};
    return options;
  }

  absl::StatusOr<Sample> Get(const PointOdysseyOptions& options, size_t index) {
    Rng rng(1);
    return (*PointOdyssey::Create(options))->Get(index, rng);
  }

  TempDir root_;
};

TEST_F(PointOdysseyTest, ReadsClipsWithTheirStrides) {
  WriteSequence("ani", Annotations());
  const auto dataset = PointOdyssey::Create(Options());
  ASSERT_THAT(dataset, IsOk());
  ASSERT_EQ((*dataset)->size(), 3u);  // starts 0 and 4 at stride 1, start 0 at stride 2
  const absl::StatusOr<Sample> clip = Get(Options(), 2);
  ASSERT_THAT(clip, IsOk());
  EXPECT_THAT(clip->Validate(), IsOk());
  EXPECT_EQ(clip->num_frames(), 4);
  EXPECT_EQ(clip->num_points(), kPoints);
  EXPECT_EQ(clip->Position(3, 0), cv::Point2f(16, 10));
  EXPECT_NEAR(clip->frames[3].at<cv::Vec3b>(5, 5)[0], 120, 3);
  EXPECT_EQ(clip->object_ids[0], 50);
  EXPECT_EQ(clip->object_ids[5], 200);
  EXPECT_EQ(clip->source, "pointodyssey/train/ani");
}

TEST_F(PointOdysseyTest, ReadsTheOlderLayout) {
  WritePictures("old", true);
  const Annotations a;
  std::vector<double> flags(kFrames * kPoints, 1);
  flags[Annotations::At(2, 1)] = 0;  // hidden
  flags[Annotations::At(2, 2)] = 2;  // invalid
  const std::vector<double> xy(a.xy.begin(), a.xy.end());
  EXPECT_THAT(WriteNpz((Sequence("old") / "annotations.npz").string(),
                       {{"trajs_2d", NpyBytes("<f8", {kFrames, kPoints, 2}, xy)},
                        {"visibilities", NpyBytes("<f8", {kFrames, kPoints}, flags)}}),
              IsOk());
  const absl::StatusOr<Sample> clip = Get(Options(), 0);
  ASSERT_THAT(clip, IsOk());
  EXPECT_TRUE(clip->Valid(2, 1) && !clip->Visible(2, 1));
  EXPECT_TRUE(!clip->Valid(2, 2) && !clip->Visible(2, 2));
}

TEST_F(PointOdysseyTest, PositionsThatAreNoNumbersAreInvalid) {
  Annotations a;
  a.Set(2, 0, std::numeric_limits<float>::quiet_NaN(), 10);
  a.Set(3, 1, 20, -std::numeric_limits<float>::infinity());
  WriteSequence("ani", a);
  const absl::StatusOr<Sample> clip = Get(Options(), 0);
  ASSERT_THAT(clip, IsOk());
  EXPECT_THAT(clip->Validate(), IsOk());
  EXPECT_FALSE(clip->Valid(2, 0));
  EXPECT_FALSE(clip->Valid(3, 1));
  EXPECT_TRUE(clip->Valid(3, 0));
}

TEST_F(PointOdysseyTest, PointsOutsideAreHiddenAndFarOutsideInvalid) {
  Annotations a;
  for (int64_t t = 0; t < kFrames; ++t) a.Set(t, 0, 3 - 0.8f * static_cast<float>(t), 10);  // over the margin at last
  a.Set(3, 1, 60, 40);                                                                      // a jump
  for (int64_t t = 2; t < kFrames; ++t) a.Set(t, 5, -25 - 25.f * static_cast<float>(t), 40);
  WriteSequence("ani", a);
  const absl::StatusOr<Sample> clip = Get(Options(), 0);
  ASSERT_THAT(clip, IsOk());
  ASSERT_EQ(clip->num_points(), kPoints - 1) << "the one that jumps is dropped";
  EXPECT_TRUE(clip->Visible(2, 0));
  EXPECT_TRUE(clip->Valid(3, 0) && !clip->Visible(3, 0));
  EXPECT_TRUE(clip->Valid(1, 4) && !clip->Valid(2, 4));
}

TEST_F(PointOdysseyTest, PointsHiddenAtTheStartOrOnAMaskEdgeAreDropped) {
  Annotations a;
  a.visible[Annotations::At(0, 0)] = 0;
  a.valid[Annotations::At(1, 1)] = 0;
  for (int64_t t = 0; t < kFrames; ++t) a.Set(t, 2, 47.6f, 20);  // between objects 50 and 200
  WriteSequence("ani", a);
  const absl::StatusOr<Sample> clip = Get(Options(), 0);
  ASSERT_THAT(clip, IsOk());
  EXPECT_EQ(clip->num_points(), kPoints - 3);
  EXPECT_EQ(clip->Position(0, 0).y, 28);
}

// As the data set's own exporter writes masks: colours of a palette that may differ from file to file.
TEST_F(PointOdysseyTest, IdsOfMasksWithAPaletteAreItsPlaces) {
  WriteSequence("ani", Annotations());
  std::array<png_byte, 3 * 13> palette{};
  for (size_t i = 3; i < palette.size(); ++i) palette[i] = static_cast<png_byte>(i % 3 == 2 ? 40 : 5 * i);  // one blue
  std::vector<png_byte> places(static_cast<size_t>(kWidth * kHeight));
  for (size_t i = 0; i < places.size(); ++i) places[i] = static_cast<png_byte>(i % kWidth * 13 / kWidth);
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = kWidth;
  image.height = kHeight;
  image.format = PNG_FORMAT_RGB_COLORMAP;
  image.colormap_entries = 13;
  const std::string path = (Sequence("ani") / "masks" / "mask_00001.png").string();
  ASSERT_NE(png_image_write_to_file(&image, path.c_str(), 0, places.data(), kWidth, palette.data()), 0);
  const absl::StatusOr<Sample> clip = Get(Options(), 0);
  ASSERT_THAT(clip, IsOk());
  for (int x = 0; x < kWidth; ++x) EXPECT_EQ(clip->masks[1].at<int32_t>(10, x), x * 13 / kWidth) << x;
}

TEST_F(PointOdysseyTest, AColourOfAMaskIsAnId) {
  WriteSequence("ani", Annotations());
  cv::Mat colours(kHeight, kWidth, CV_8UC3, cv::Scalar(1, 2, 3));
  colours.colRange(0, 10).setTo(0);
  ASSERT_TRUE(cv::imwrite((Sequence("ani") / "masks" / "mask_00001.png").string(), colours));
  const absl::StatusOr<Sample> clip = Get(Options(), 0);
  ASSERT_THAT(clip, IsOk());
  EXPECT_EQ(clip->masks[1].at<int32_t>(10, 30), 1 + 256 * 2 + 65536 * 3);
  EXPECT_EQ(clip->masks[1].at<int32_t>(10, 5), 0);
}

TEST_F(PointOdysseyTest, SeamsOfLargeHolesAreFilledAndSmallOnesStay) {
  WriteSequence("ani", Annotations());
  cv::Mat mask(kHeight, kWidth, CV_32SC1, cv::Scalar(50));
  mask(cv::Rect(20, 20, 60, 3)).setTo(0);  // 180 pixels
  mask(cv::Rect(70, 30, 5, 5)).setTo(0);
  ASSERT_THAT(WriteMask((Sequence("ani") / "masks" / "mask_00001.png").string(), mask), IsOk());
  const absl::StatusOr<Sample> clip = Get(Options(), 0);
  ASSERT_THAT(clip, IsOk());
  EXPECT_EQ(clip->IdAt(1, {27, 21}), 50);
  EXPECT_EQ(clip->IdAt(1, {72, 32}), 0);
}

TEST_F(PointOdysseyTest, ObjectsOnUnlabelledGroundDoNotGrow) {
  WriteSequence("ani", Annotations());
  cv::Mat mask(kHeight, kWidth, CV_32SC1, cv::Scalar(0));
  mask(cv::Rect(20, 20, 15, 15)).setTo(50);
  ASSERT_THAT(WriteMask((Sequence("ani") / "masks" / "mask_00001.png").string(), mask), IsOk());
  const absl::StatusOr<Sample> clip = Get(Options(), 0);
  ASSERT_THAT(clip, IsOk());
  EXPECT_EQ(cv::countNonZero(clip->masks[1] != mask), 0);
}

TEST_F(PointOdysseyTest, ASequenceWithoutMasksHasNone) {
  WriteSequence("cnb_dlab_0225_3rd", Annotations(), /*masks=*/false);
  const absl::StatusOr<Sample> clip = Get(Options(), 0);
  ASSERT_THAT(clip, IsOk());
  EXPECT_FALSE(clip->has_masks());
  EXPECT_EQ(clip->object_ids[0], 0);
}

TEST_F(PointOdysseyTest, KeepsAsManySpreadOutPointsAsAskedFor) {
  WriteSequence("ani", Annotations());
  PointOdysseyOptions options = Options();
  options.points = 2;
  const absl::StatusOr<Sample> clip = Get(options, 0);
  ASSERT_THAT(clip, IsOk());
  ASSERT_EQ(clip->num_points(), 2);
  EXPECT_EQ(clip->Position(0, 0), cv::Point2f(10, 10));
  EXPECT_EQ(clip->Position(0, 1), cv::Point2f(50, 40)) << "the farthest one";
}

TEST_F(PointOdysseyTest, WholeSequencesKeepTheRulesOfEvaluation) {
  Annotations a;
  a.Set(3, 0, 90, 50);                   // a jump is no reason here
  a.visible[Annotations::At(0, 1)] = 0;  // not seen at the start
  a.visible[Annotations::At(5, 2)] = 0;  // seen in 7 of the 8 frames
  a.Set(7, 3, -5, 10);                   // outside: not scored, and seen in 7 frames
  WriteSequence("ani", a);
  PointOdysseyOptions options = Options();
  options.frames = 0;
  const absl::StatusOr<Sample> clip = Get(options, 0);
  ASSERT_THAT(clip, IsOk());
  EXPECT_EQ(clip->num_frames(), kFrames);
  EXPECT_EQ(clip->num_points(), 3);
}

TEST_F(PointOdysseyTest, DamagedSequencesAreSkippedAndCountedWhileTrainingGoesOn) {
  for (const char* name : {"good", "no_npz", "text", "shape", "no_frame", "half_frame"})
    WriteSequence(name, Annotations());
  fs::resize_file(Sequence("no_npz") / "anno.npz", 100);
  std::ofstream(Sequence("text") / "anno.npz") << "not an archive";
  const Annotations a;
  EXPECT_THAT(WriteNpz((Sequence("shape") / "anno.npz").string(),
                       {{"trajs_2d", NpyBytes("<f4", {kFrames, kPoints, 2}, a.xy)},
                        {"visibs", NpyBytes<uint8_t>("|b1", {kFrames, 3}, std::vector<uint8_t>(kFrames * 3))}}),
              IsOk());
  for (int t = 0; t < kFrames; ++t)
    std::ofstream(Sequence("half_frame") / "rgbs" / absl::StrFormat("rgb_%05d.jpg", t)) << "half";
  fs::rename(Sequence("no_frame") / "rgbs" / "rgb_00002.jpg", Sequence("no_frame") / "rgbs" / "else.jpg");
  PointOdysseyOptions options = Options();
  options.strides = {1};
  options.start_step = 100;
  const auto dataset = PointOdyssey::Create(options);
  ASSERT_THAT(dataset, IsOk());
  ASSERT_EQ((*dataset)->size(), 6u);
  Rng rng(1);
  for (size_t i = 1; i < 6; ++i) {
    const absl::StatusOr<Sample> damaged = (*dataset)->Get(i, rng);
    EXPECT_THAT(damaged, ::testing::AnyOf(StatusIs(absl::StatusCode::kDataLoss), StatusIs(absl::StatusCode::kNotFound)))
        << i;
    EXPECT_THAT(std::string(damaged.status().message()), HasSubstr(root_.path().string())) << i;
  }
  LoaderOptions loading;
  loading.batch_size = 6;
  const auto loader = Loader::Create(**dataset, loading).value();
  const auto batch = loader->Next();
  ASSERT_THAT(batch, IsOk());
  for (const Sample& sample : *batch) EXPECT_EQ(sample.source, "pointodyssey/train/good");
  EXPECT_GE(loader->skipped(), 5);
}

// As where it may not be read: what there is behind it cannot be told.
TEST_F(PointOdysseyTest, AnEntryThatCannotBeLookedIntoIsNoSequence) {
  PointOdysseyOptions options;
  options.root = root_.path().string();
  fs::create_directories(root_.path() / options.split);
  fs::create_symlink("loop", root_.path() / options.split / "loop");
  EXPECT_THAT(PointOdyssey::Create(options).status(), StatusIs(absl::StatusCode::kNotFound));
  options.root = std::string(300, 'x');
  EXPECT_THAT(PointOdyssey::Create(options).status(), StatusIs(absl::StatusCode::kNotFound));
}

TEST_F(PointOdysseyTest, AnEmptySplitAndWrongOptionsAreRefused) {
  EXPECT_THAT(PointOdyssey::Create(Options()), StatusIs(absl::StatusCode::kNotFound));
  WriteSequence("ani", Annotations());
  PointOdysseyOptions options = Options();
  options.frames = 1;
  EXPECT_THAT(PointOdyssey::Create(options), StatusIs(absl::StatusCode::kInvalidArgument));
  options = Options();
  options.strides = {0};
  EXPECT_THAT(PointOdyssey::Create(options), StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace holdfast
