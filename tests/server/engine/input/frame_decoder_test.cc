// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/frame_decoder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/check_and_decode.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

FrameFormat Format(FrameEncoding encoding, ImageSize raw = {}) { return {encoding, raw, 1000 * 1000}; }

// A picture of one colour, with a gradient so that it takes some bytes.
std::string Encoded(const std::string& extension, int width, int height, cv::Scalar bgr,
                    std::vector<int> options = {}) {
  cv::Mat image(height, width, CV_8UC3, bgr);
  std::vector<uint8_t> bytes;
  cv::imencode(extension, image, bytes, options);
  return {bytes.begin(), bytes.end()};
}

std::vector<int> FirstPixel(const RgbImage& image) { return {image.pixels[0], image.pixels[1], image.pixels[2]}; }

TEST(FrameDecoderTest, DecodesJpegAndPngToRgbAtTheProcessingSize) {
  for (const auto& [extension, encoding] : {std::pair(".jpg", FrameEncoding::kJpeg), {".png", FrameEncoding::kPng}}) {
    const auto image = CheckAndDecode(Encoded(extension, 90, 50, {200, 100, 10}), Format(encoding), {64, 32});
    ASSERT_THAT(image, IsOk());
    EXPECT_EQ(image->size, (ImageSize{64, 32}));
    ASSERT_EQ(image->pixels.size(), 64u * 32 * 3);
    const auto rgb = FirstPixel(*image);
    EXPECT_NEAR(rgb[0], 10, 3);
    EXPECT_NEAR(rgb[1], 100, 3);
    EXPECT_NEAR(rgb[2], 200, 3);
  }
}

TEST(FrameDecoderTest, ReadsRawPixelsInTheirChannelOrder) {
  const std::string bytes = "\x01\x02\x03\x04\x05\x06";
  const auto rgb = CheckAndDecode(bytes, Format(FrameEncoding::kRgb24, {2, 1}), {2, 1});
  const auto bgr = CheckAndDecode(bytes, Format(FrameEncoding::kBgr24, {2, 1}), {2, 1});
  const auto gray = CheckAndDecode("\x07\x08", Format(FrameEncoding::kGray8, {2, 1}), {2, 1});
  EXPECT_THAT(rgb->pixels, ElementsAre(1, 2, 3, 4, 5, 6));
  EXPECT_THAT(bgr->pixels, ElementsAre(3, 2, 1, 6, 5, 4));
  EXPECT_THAT(gray->pixels, ElementsAre(7, 7, 7, 8, 8, 8));
}

TEST(FrameDecoderTest, DecodesAGreyPictureToThreeEqualChannels) {
  std::vector<uint8_t> bytes;
  cv::imencode(".png", cv::Mat(8, 8, CV_8UC1, cv::Scalar(77)), bytes);
  const auto image =
      CheckAndDecode({reinterpret_cast<char*>(bytes.data()), bytes.size()}, Format(FrameEncoding::kPng), {8, 8});
  ASSERT_THAT(image, IsOk());
  EXPECT_THAT(FirstPixel(*image), ElementsAre(77, 77, 77));
}

TEST(FrameDecoderTest, RefusesRawBytesOfAnotherSize) {
  EXPECT_THAT(CheckAndDecode("12345", Format(FrameEncoding::kRgb24, {2, 1}), {2, 1}),
              StatusIs(kInvalid, HasSubstr("5 bytes, expected 6")));
}

TEST(FrameDecoderTest, RefusesTooManyPixelsByTheHeaderAlone) {
  // A header that promises 65500 x 65500 pixels, and nothing in its scan.
  const std::string jpeg(
      "\xFF\xD8\xFF\xC0\x00\x0B\x08\xFF\xDC\xFF\xDC\x01\x01\x11\x00\xFF\xDA\x00\x08\x01\x01\x00\x00\x3F\x00\xFF\xD9",
      27);
  EXPECT_THAT(CheckAndDecode(jpeg, Format(FrameEncoding::kJpeg), {32, 32}),
              StatusIs(kInvalid, HasSubstr("65500x65500")));
  std::string png = Encoded(".png", 4, 4, {});
  png.replace(16, 4, std::string("\x7F\xFF\xFF\xFF", 4));
  EXPECT_THAT(CheckAndDecode(png, Format(FrameEncoding::kPng), {32, 32}),
              StatusIs(kInvalid, HasSubstr("2147483647x4")));
}

TEST(FrameDecoderTest, RefusesAPictureOfAnotherEncoding) {
  const std::string png = Encoded(".png", 8, 8, {}), jpeg = Encoded(".jpg", 8, 8, {});
  EXPECT_THAT(CheckAndDecode(png, Format(FrameEncoding::kJpeg), {8, 8}),
              StatusIs(kInvalid, HasSubstr("no JPEG header")));
  EXPECT_THAT(CheckAndDecode(jpeg, Format(FrameEncoding::kPng), {8, 8}),
              StatusIs(kInvalid, HasSubstr("no PNG header")));
  EXPECT_THAT(CheckAndDecode("", Format(FrameEncoding::kJpeg), {8, 8}), StatusIs(kInvalid));
}

TEST(FrameDecoderTest, RefusesEveryTruncationAndNeverCrashes) {
  for (const auto& [extension, encoding] : {std::pair(".jpg", FrameEncoding::kJpeg), {".png", FrameEncoding::kPng}}) {
    const std::string whole = Encoded(extension, 40, 30, {1, 2, 3});
    for (size_t size = 0; size < whole.size(); ++size) {
      EXPECT_THAT(CheckAndDecode(whole.substr(0, size), Format(encoding), {32, 32}), StatusIs(kInvalid)) << size;
    }
  }
}

TEST(FrameDecoderTest, SurvivesEveryBrokenByte) {
  const std::vector<int> progressive = {cv::IMWRITE_JPEG_PROGRESSIVE, 1};
  for (const auto& [whole, encoding] : {std::pair(Encoded(".jpg", 40, 30, {1, 2, 3}), FrameEncoding::kJpeg),
                                        {Encoded(".jpg", 40, 30, {1, 2, 3}, progressive), FrameEncoding::kJpeg},
                                        {Encoded(".png", 40, 30, {1, 2, 3}), FrameEncoding::kPng}}) {
    for (size_t at = 0; at < whole.size(); ++at) {
      for (const char value : {'\x00', '\xFF', '\x7F'}) {
        std::string broken = whole;
        broken[at] = value;
        for (const ImageSize size : {ImageSize{32, 32}, {8, 4}}) {  // of a JPEG as it is, and of a half of it
          const auto image = CheckAndDecode(broken, Format(encoding), size);
          if (image.ok()) {
            EXPECT_EQ(image->pixels.size(), Pixels(size) * 3);
          }
        }
      }
    }
  }
}

std::string GreyJpeg(const cv::Mat& picture) {
  std::vector<uint8_t> bytes;
  cv::imencode(".jpg", picture, bytes, {cv::IMWRITE_JPEG_QUALITY, 100});
  return {bytes.begin(), bytes.end()};
}

// A soft light whose middle is at (x, y).
cv::Mat LightAt(double x, double y, ImageSize size) {
  const auto profile = [](int length, double middle, double width) {
    cv::Mat values(length, 1, CV_64F);
    for (int i = 0; i < length; ++i) values.at<double>(i) = std::exp(-std::pow((i - middle) / width, 2) / 2);
    return values;
  };
  const double width = size.width / 30.0;
  cv::Mat light = 250 * profile(size.height, y, width) * profile(size.width, x, width).t(), picture;
  light.convertTo(picture, CV_8UC1);
  return picture;
}

cv::Point2d MiddleOfLight(const cv::Mat& grey) {
  const cv::Moments moments = cv::moments(grey);
  return {moments.m10 / moments.m00, moments.m01 / moments.m00};
}

TEST(FrameDecoderTest, PlacesAreTheSameWhateverTheSizeAJpegIsDecodedAt) {
  const ImageSize processing{128, 96};
  // At a half, a quarter, and a half where a quarter leaves a remainder; whole.
  for (const ImageSize size : {ImageSize{960, 540}, {1920, 1080}, {1366, 768}, {961, 541}, {962, 543}}) {
    const double x = 0.85 * size.width, y = 0.8 * size.height;
    GrayImage gray{FlowSize(size, processing), {}};
    const FrameFormat format{FrameEncoding::kJpeg, {}, 4'000'000};
    auto image = CheckAndDecode(GreyJpeg(LightAt(x, y, size)), format, processing, &gray);
    ASSERT_THAT(image, IsOk());
    cv::Mat red;
    cv::extractChannel(cv::Mat(processing.height, processing.width, CV_8UC3, image->pixels.data()), red, 0);
    const cv::Mat grey(gray.size.height, gray.size.width, CV_8UC1, gray.pixels.data());
    for (const cv::Mat& small : {red, grey}) {
      const cv::Point2d middle = MiddleOfLight(small);
      EXPECT_NEAR(middle.x, (x + 0.5) * small.cols / size.width - 0.5, 0.05) << ToString(size) << ", " << small.cols;
      EXPECT_NEAR(middle.y, (y + 0.5) * small.rows / size.height - 0.5, 0.05) << ToString(size) << ", " << small.cols;
    }
  }
}

// How far the greatest and the least value are apart, of the picture and of what flow sees, after stripes of one pixel.
std::pair<double, double> ContrastOfStripes(ImageSize size, ImageSize processing) {
  cv::Mat stripes(size.height, size.width, CV_8UC1);
  for (int x = 0; x < size.width; ++x) stripes.col(x).setTo(x % 2 * 255);
  GrayImage gray{FlowSize(size, processing), {}};
  const auto image = CheckAndDecode(GreyJpeg(stripes), Format(FrameEncoding::kJpeg), processing, &gray);
  const auto contrast = [](const std::vector<uint8_t>& values) {
    const auto [least, greatest] = std::minmax_element(values.begin(), values.end());
    return static_cast<double>(*greatest) - *least;
  };
  return {contrast(image->pixels), contrast(gray.pixels)};
}

TEST(FrameDecoderTest, ALargeJpegIsDecodedSmallerButNeverBelowWhatIsLookedAt) {
  const auto [picture, flow] = ContrastOfStripes({960, 540}, {128, 96});
  EXPECT_LT(picture, 10) << "pixels are means, none is left out";
  EXPECT_LT(flow, 10);
  EXPECT_GT(ContrastOfStripes({256, 192}, {128, 96}).second, 50) << "flow looks at 192x144: a half is not enough";
  EXPECT_GT(ContrastOfStripes({961, 540}, {128, 96}).first, 50) << "a half of 961 is none";
}

TEST(FrameDecoderTest, TakesThePixelsAsStoredWhateverTheOrientationTag) {
  std::string jpeg = Encoded(".jpg", 48, 16, {9, 9, 9});
  // An Exif segment with orientation 6 (turn by 90 degrees), right after the start marker.
  const std::string exif(
      "\xFF\xE1\x00\x22"
      "Exif\0\0"
      "MM\0\x2A\0\0\0\x08"
      "\0\x01"
      "\x01\x12\0\x03\0\0\0\x01\0\x06\0\0"
      "\0\0\0\0",
      36);
  jpeg.insert(2, exif);
  EXPECT_THAT(FrameSize(jpeg, Format(FrameEncoding::kJpeg)), IsOkAndHolds(ImageSize{48, 16}));
  EXPECT_THAT(CheckAndDecode(jpeg, Format(FrameEncoding::kJpeg), {48, 16}), IsOk());
}

}  // namespace
}  // namespace holdfast
