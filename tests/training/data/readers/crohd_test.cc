// SPDX-License-Identifier: Apache-2.0
#include "training/data/readers/crohd.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "absl/strings/str_format.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "training/data/image_files.h"

namespace holdfast {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class CrohdTest : public ::testing::Test {
 protected:
  void SetUp() override {
    sequence_ = root_.path() / "HT21" / "train" / "HT21-01";
    fs::create_directories(sequence_ / "gt");
    fs::create_directories(sequence_ / "img1");
    for (int t = 1; t <= 6; ++t) {
      ASSERT_THAT(WriteFrame((sequence_ / "img1" / absl::StrFormat("%06d.jpg", t)).string(),
                             cv::Mat(120, 200, CV_8UC3, cv::Scalar::all(30 * t))),
                  IsOk());
    }
  }

  // Head 1 walks right by 10 pixels a frame and is hidden in the fourth; head 2 is missing in the third frame; head 3
  // is too near to the border; head 4 stands still; head 5 comes late.
  static std::string Rows() {
    std::string rows;
    for (int t = 1; t <= 6; ++t) {
      rows += absl::StrFormat("%d,1,%d,40,10,20,1,1,%d\n", t, 35 + 10 * t, t == 4 ? 0 : 1);
      if (t != 3) rows += absl::StrFormat("%d,2,%d,60,10,10,1,1,1.0\n", t, 140 - 10 * t);
      rows += absl::StrFormat("%d,3,%d,5,10,10,1,1,1\n", t, 35 + 10 * t);
      rows += absl::StrFormat("%d,4,90,50,10,10,1,1,1\n", t);
      if (t > 1) rows += absl::StrFormat("%d,5,%d,70,10,10,1,1,1\n", t, 35 + 10 * t);
    }
    return rows;
  }
  void WriteLabels(const std::string& rows) { std::ofstream(sequence_ / "gt" / "gt.txt") << rows; }

  CrohdOptions Options() {
    CrohdOptions options;
    options.root = root_.path().string();
    options.clip_frames = 6;
    options.min_frames = 6;
    options.min_path_px = 20;
    return options;
  }
  absl::StatusOr<Sample> Get(const CrohdOptions& options, size_t index = 0) {
    Rng rng(1);
    return (*Crohd::Create(options))->Get(index, rng);
  }

  TempDir root_;
  fs::path sequence_;
};

TEST_F(CrohdTest, TracksAreTheCentresOfTheBoxes) {
  WriteLabels(Rows());
  const absl::StatusOr<Sample> clip = Get(Options());
  ASSERT_THAT(clip, IsOk());
  EXPECT_THAT(clip->Validate(), IsOk());
  ASSERT_EQ(clip->num_points(), 2) << "border, standing and late heads are left out";
  EXPECT_EQ(clip->Position(0, 0), cv::Point2f(50, 50));
  EXPECT_EQ(clip->Position(5, 0), cv::Point2f(100, 50));
  EXPECT_TRUE(clip->Valid(3, 0) && !clip->Visible(3, 0));
  EXPECT_TRUE(!clip->Valid(2, 1) && !clip->Visible(2, 1)) << "no row";
  EXPECT_EQ(clip->Position(0, 1), cv::Point2f(135, 65));
}

TEST_F(CrohdTest, FramesAndLabelsAreScaledTogether) {
  WriteLabels(Rows());
  CrohdOptions options = Options();
  options.size = {100, 30};
  const absl::StatusOr<Sample> clip = Get(options);
  ASSERT_THAT(clip, IsOk());
  EXPECT_EQ(clip->size(), options.size);
  EXPECT_EQ(clip->Position(0, 0), cv::Point2f(25, 12.5));
  EXPECT_NEAR(clip->frames[4].at<cv::Vec3b>(3, 3)[1], 150, 3);
}

TEST_F(CrohdTest, SequencesAreCutIntoClipsThatStartEveryHalf) {
  WriteLabels(Rows());
  CrohdOptions options = Options();
  options.clip_frames = 4;
  options.min_frames = 4;
  options.min_path_px = 0;
  const auto dataset = Crohd::Create(options);
  ASSERT_THAT(dataset, IsOk());
  EXPECT_EQ((*dataset)->size(), 2u);
  const absl::StatusOr<Sample> second = Get(options, 1);
  ASSERT_THAT(second, IsOk());
  ASSERT_EQ(second->num_points(), 2) << "heads 1 and 2 are not seen in its first two frames";
  EXPECT_EQ(second->Position(0, 0), cv::Point2f(95, 55));
}

TEST_F(CrohdTest, DamagedRowsAreErrorsWithFileAndLine) {
  for (const char* row :
       {"1,1,2,3", "a,1,2,3,4,5,6,7,8", "0,1,2,3,4,5,6,7,8", "1,1,nan,3,4,5,6,7,8", "1e30,1,2,3,4,5,6,7,8"}) {
    WriteLabels(Rows() + row + "\n");
    EXPECT_THAT(Get(Options()), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("gt.txt:29"))) << row;
  }
}

TEST_F(CrohdTest, AMissingFrameIsAnError) {
  WriteLabels(Rows());
  fs::rename(sequence_ / "img1" / "000003.jpg", sequence_ / "img1" / "x.jpg");
  EXPECT_THAT(Get(Options()), StatusIs(absl::StatusCode::kNotFound, HasSubstr("000003.jpg")));
}

// As where it may not be read: what there is behind it cannot be told.
TEST_F(CrohdTest, AnEntryThatCannotBeLookedIntoIsNoSequence) {
  WriteLabels(Rows());
  fs::create_symlink("loop", sequence_.parent_path() / "loop");
  EXPECT_THAT(Get(Options()), IsOk());
  CrohdOptions options = Options();
  options.root = std::string(300, 'x');
  EXPECT_THAT(Crohd::Create(options).status(), StatusIs(absl::StatusCode::kNotFound));
}

TEST_F(CrohdTest, ADirectoryWithoutSequencesIsRefused) {
  EXPECT_THAT(Crohd::Create(Options()), StatusIs(absl::StatusCode::kNotFound));
}

}  // namespace
}  // namespace holdfast
