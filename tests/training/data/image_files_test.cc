// SPDX-License-Identifier: Apache-2.0
#include "training/data/image_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <string>

#include "absl/strings/string_view.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

class ImageFilesTest : public ::testing::Test {
 protected:
  // Of a picture with something to see everywhere.
  std::string Jpeg() const {
    cv::Mat noise(96, 128, CV_8UC3);
    cv::RNG(1).fill(noise, cv::RNG::UNIFORM, 0, 256);
    const std::string path = dir_.File("whole.jpg");
    EXPECT_THAT(WriteFrame(path, noise), IsOk());
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  absl::Status Read(absl::string_view bytes) const {
    std::ofstream(dir_.File("frame.jpg"), std::ios::binary) << bytes;
    return ReadFrame(dir_.File("frame.jpg")).status();
  }

  const TempDir dir_;
};

TEST_F(ImageFilesTest, AJpegThatWasCutIsDamaged) {
  const std::string whole = Jpeg();
  EXPECT_THAT(Read(whole), IsOk());
  for (const size_t kept : {whole.size() / 2, whole.size() - 2, whole.size() - 1, size_t{100}, size_t{3}}) {
    EXPECT_THAT(Read(whole.substr(0, kept)), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("frame.jpg"))) << kept;
  }
}

TEST_F(ImageFilesTest, AnEndWithinASegmentIsNotThePictures) {
  std::string whole = Jpeg();
  whole.insert(2, "\xFF\xE1\x00\x06\xFF\xD9\xFF\xD9", 8);
  EXPECT_THAT(Read(whole), IsOk());
  EXPECT_THAT(Read(whole.substr(0, whole.size() / 2)), StatusIs(absl::StatusCode::kDataLoss));
}

TEST_F(ImageFilesTest, WhatFollowsAWholeJpegDoesNoHarm) { EXPECT_THAT(Read(Jpeg() + std::string(64, 0)), IsOk()); }

}  // namespace
}  // namespace holdfast
