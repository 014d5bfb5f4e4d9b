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
  std::unique_ptr<FrameReader> Reader() {
    auto source = FrameSource::Open(dir_.path().string());
    EXPECT_THAT(source, IsOk());
    return std::make_unique<FrameReader>(*std::move(source));
  }

  TempDir dir_;
};

TEST_F(FrameReaderTest, GivesEveryFrameInOrderAndThenTheEnd) {
  for (int i = 0; i < 8; ++i) Picture(std::to_string(i) + ".png", 10 * i);
  const auto reader = Reader();
  for (int i = 0; i < 8; ++i) {
    const auto frame = reader->Next();
    ASSERT_THAT(frame, IsOk());
    ASSERT_FALSE(frame->empty());
    EXPECT_EQ(frame->at<cv::Vec3b>(0, 0)[0], 10 * i);
  }
  EXPECT_TRUE(reader->Next()->empty());
  EXPECT_TRUE(reader->Next()->empty());
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
  ASSERT_EQ(mkfifo(dir_.File("1.png").c_str(), 0600), 0);  // to open it blocks for as long as the test runs
  auto reader = Reader();
  EXPECT_THAT(reader->Next(), IsOk());
  std::thread stopper([&reader] { reader->Stop(); });
  EXPECT_THAT(reader->Next(), StatusIs(absl::StatusCode::kCancelled));
  stopper.join();
  reader.reset();  // gives the read up as well
}

}  // namespace
}  // namespace holdfast
