// SPDX-License-Identifier: Apache-2.0
#include "client/cli/frame_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <thread>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

class FrameReaderTest : public ::testing::Test {
 protected:
  void Picture(const std::string& name, int value) {
    ASSERT_TRUE(cv::imwrite(dir_.File(name), cv::Mat(6, 8, CV_8UC3, cv::Scalar::all(value))));
  }
  std::unique_ptr<FrameReader> Reader(FrameReader::Options options = {}) {
    auto source = FrameSource::Open(dir_.path().string(), options.choice.first());
    EXPECT_THAT(source, IsOk());
    return std::make_unique<FrameReader>(*std::move(source), std::move(options));
  }
  // Whoever reads it waits for WaitForReader.
  void Stall(const std::string& name) { ASSERT_EQ(mkfifo(dir_.File(name).c_str(), 0600), 0); }
  void WaitForReader(const std::string& name) { std::ofstream(dir_.File(name)) << "no picture"; }

  TempDir dir_;
};

TEST_F(FrameReaderTest, GivesEveryFrameInOrderAndThenTheEnd) {
  for (int i = 0; i < 8; ++i) Picture(std::to_string(i) + ".png", 10 * i);
  const auto reader = Reader();
  for (int i = 0; i < 8; ++i) {
    const auto frame = reader->Next();
    ASSERT_THAT(frame, IsOk());
    ASSERT_FALSE(frame->picture.empty());
    EXPECT_EQ(frame->number, i);
    EXPECT_EQ(frame->picture.at<cv::Vec3b>(0, 0)[0], 10 * i);
    EXPECT_EQ(frame->capture_time, std::nullopt) << "pictures of files were taken at some other time";
  }
  EXPECT_TRUE(reader->Next()->picture.empty());
  EXPECT_TRUE(reader->Next()->picture.empty());
  EXPECT_EQ(reader->dropped(), 0);
}

TEST_F(FrameReaderTest, GivesTheChosenFramesUnderTheirNumbers) {
  for (int i = 0; i < 9; ++i) Picture(std::to_string(i) + ".png", 10 * i);
  const auto reader = Reader({FrameChoice(2, 3, {4}), false});
  for (const int number : {2, 4, 5, 8}) {
    const auto frame = reader->Next();
    ASSERT_THAT(frame, IsOk());
    EXPECT_EQ(frame->number, number);
    EXPECT_EQ(frame->picture.at<cv::Vec3b>(0, 0)[0], 10 * number);
  }
  EXPECT_TRUE(reader->Next()->picture.empty());
}

TEST_F(FrameReaderTest, LeavesOutTheOldestThatNobodyTookButNoneThatPointsStartOn) {
  for (int i = 0; i < 7; ++i) Picture(std::to_string(i) + ".png", i);
  Stall("7.png");
  const auto reader = Reader({FrameChoice(0, 1, {2}), true});
  WaitForReader("7.png");
  EXPECT_EQ(reader->dropped(), 5);
  EXPECT_EQ(reader->Next()->number, 2);
  EXPECT_EQ(reader->Next()->number, 6);
  EXPECT_THAT(reader->Next(), StatusIs(absl::StatusCode::kDataLoss));
}

TEST_F(FrameReaderTest, AnErrorComesAfterTheFramesBeforeIt) {
  Picture("0.png", 0);
  std::ofstream(dir_.File("1.png")) << "broken";
  const auto reader = Reader();
  EXPECT_THAT(reader->Next(), IsOk());
  EXPECT_THAT(reader->Next(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("1.png")));
}

TEST_F(FrameReaderTest, StopFreesWhoWaitsForAFrameThatDoesNotCome) {
  Picture("0.png", 0);
  Stall("1.png");
  auto reader = Reader();
  EXPECT_THAT(reader->Next(), IsOk());
  std::thread stopper([&reader] { reader->Stop(); });
  EXPECT_THAT(reader->Next(), StatusIs(absl::StatusCode::kCancelled));
  stopper.join();
  reader.reset();  // gives the read up as well
}

}  // namespace
}  // namespace holdfast
