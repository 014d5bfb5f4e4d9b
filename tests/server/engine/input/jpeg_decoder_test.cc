// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/jpeg_decoder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <turbojpeg.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "tests/support/check_and_decode.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

// Soft colours, which change by little from one pixel to the next.
cv::Mat SoftPicture(ImageSize size) {
  cv::Mat coarse(8, 8, CV_8UC3), picture;
  cv::RNG(5).fill(coarse, cv::RNG::UNIFORM, 0, 256);
  cv::resize(coarse, picture, {size.width, size.height}, 0, 0, cv::INTER_CUBIC);
  return picture;
}

std::string JpegOf(const cv::Mat& picture) {
  std::vector<uint8_t> bytes;
  cv::imencode(".jpg", picture, bytes);
  return {bytes.begin(), bytes.end()};
}

std::string CmykJpeg(int side) {
  const std::vector<uint8_t> pixels(size_t{4} * side * side, 200);
  unsigned char* data = nullptr;
  unsigned long size = 0;  // NOLINT(google-runtime-int): libturbojpeg's
  const tjhandle encoder = tjInitCompress();
  EXPECT_EQ(tjCompress2(encoder, pixels.data(), side, 0, side, TJPF_CMYK, &data, &size, TJSAMP_444, 90, 0), 0);
  std::string bytes(reinterpret_cast<char*>(data), size);
  tjFree(data);
  tjDestroy(encoder);
  return bytes;
}

TEST(JpegDecoderTest, ReducesAsFarAsSidesAreWholeAndLongEnough) {
  EXPECT_EQ(JpegReduction({1920, 1080}, {886, 498}), 2);
  EXPECT_EQ(JpegReduction({3840, 2160}, {886, 498}), 4);
  EXPECT_EQ(JpegReduction({3840, 2160}, {443, 249}), 8);
  EXPECT_EQ(JpegReduction({1772, 996}, {886, 498}), 2);
  EXPECT_EQ(JpegReduction({1770, 996}, {886, 498}), 1) << "too narrow";
  EXPECT_EQ(JpegReduction({1772, 994}, {886, 498}), 1) << "too low";
  EXPECT_EQ(JpegReduction({1921, 1080}, {886, 498}), 1);
  EXPECT_EQ(JpegReduction({1920, 1081}, {886, 498}), 1);
  EXPECT_EQ(JpegReduction({3844, 2166}, {886, 498}), 2) << "a quarter leaves a remainder";
}

TEST(JpegDecoderTest, DecodesToTheBitWhatOpenCvDoes) {
  const std::string jpeg = JpegOf(SoftPicture({75, 50}));
  const auto image = DecodeJpeg(jpeg, {75, 50}, 1);
  ASSERT_THAT(image, IsOk());
  const cv::Mat want = cv::imdecode(std::vector<char>(jpeg.begin(), jpeg.end()), cv::IMREAD_COLOR);
  EXPECT_EQ(cv::norm(*image, want, cv::NORM_INF), 0);
}

TEST(JpegDecoderTest, AReducedPixelIsTheMeanOfThoseItStandsFor) {
  const cv::Mat picture = SoftPicture({160, 96});
  for (const int reduction : {2, 4, 8}) {
    const auto image = DecodeJpeg(JpegOf(picture), {160, 96}, reduction);
    ASSERT_THAT(image, IsOk());
    cv::Mat means;
    cv::resize(picture, means, {160 / reduction, 96 / reduction}, 0, 0, cv::INTER_AREA);
    ASSERT_EQ(image->size(), means.size());
    EXPECT_LT(cv::norm(*image, means, cv::NORM_L1) / static_cast<double>(3 * means.total()), 2) << reduction;
  }
}

TEST(JpegDecoderTest, FourColoursAreLeftToOpenCv) {
  const std::string jpeg = CmykJpeg(64);
  EXPECT_THAT(DecodeJpeg(jpeg, {64, 64}, 1), StatusIs(absl::StatusCode::kUnimplemented));
  const auto frame = CheckAndDecode(jpeg, {FrameEncoding::kJpeg, {}, 1 << 20}, {32, 32});
  ASSERT_THAT(frame, IsOk());
  EXPECT_EQ(frame->size, (ImageSize{32, 32}));
}

TEST(JpegDecoderTest, WhatIsNoneOrOfAnotherSizeIsRefused) {
  EXPECT_THAT(DecodeJpeg("no picture", {8, 8}, 1), StatusIs(absl::StatusCode::kUnimplemented));
  EXPECT_THAT(DecodeJpeg(JpegOf(SoftPicture({16, 8})), {8, 8}, 1), StatusIs(kInvalid));
}

}  // namespace
}  // namespace holdfast
