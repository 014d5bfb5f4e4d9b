// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/jpeg_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/engine/input/frame_decoder.h"
#include "tests/support/check_and_decode.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

constexpr ImageSize kSize{40, 24};

std::string Jpeg(std::vector<int> options = {}) {
  cv::Mat image(kSize.height, kSize.width, CV_8UC3);
  cv::randu(image, 0, 255);  // the same on every run
  std::vector<uint8_t> bytes;
  cv::imencode(".jpg", image, bytes, options);
  return {bytes.begin(), bytes.end()};
}
std::string Progressive() { return Jpeg({cv::IMWRITE_JPEG_PROGRESSIVE, 1}); }

std::string Segment(char marker, size_t data_bytes) {
  const size_t length = data_bytes + 2;
  return absl::StrCat(std::string{'\xFF', marker, static_cast<char>(length >> 8), static_cast<char>(length & 0xFF)},
                      std::string(data_bytes, 'x'));
}
std::string AfterStart(std::string jpeg, const std::string& inserted) { return jpeg.insert(2, inserted); }

// The last scan once more, 'count' times.
std::string WithMoreScans(const std::string& jpeg, int count) {
  const size_t begin = jpeg.rfind("\xFF\xDA"), end = jpeg.size() - 2;
  std::string result = jpeg.substr(0, end);
  for (int i = 0; i < count; ++i) result += jpeg.substr(begin, end - begin);
  return result + "\xFF\xD9";
}
int Scans(const std::string& jpeg) {
  int scans = 0;
  for (size_t at = 0; (at = jpeg.find("\xFF\xDA", at)) != std::string::npos; ++at) ++scans;
  return scans;
}
// The frame header's byte at 'offset' behind its marker.
std::string WithFrameHeader(std::string jpeg, size_t offset, char value) {
  jpeg[jpeg.find("\xFF\xC0") + offset] = value;
  return jpeg;
}

absl::Status Decodes(const std::string& jpeg) {
  return CheckAndDecode(jpeg, {FrameEncoding::kJpeg, {}, 10000}, {32, 32}).status();
}

TEST(JpegCheckTest, TakesWhatEncodersMake) {
  for (const std::string& jpeg : {Jpeg(), Progressive(), Jpeg({cv::IMWRITE_JPEG_RST_INTERVAL, 1}),
                                  Jpeg({cv::IMWRITE_JPEG_OPTIMIZE, 1, cv::IMWRITE_JPEG_QUALITY, 100})}) {
    EXPECT_THAT(CheckJpeg(jpeg), IsOkAndHolds(kSize));
    EXPECT_THAT(Decodes(jpeg), IsOk());
  }
}

TEST(JpegCheckTest, TakesGreyPictures) {
  std::vector<uint8_t> bytes;
  cv::imencode(".jpg", cv::Mat(24, 40, CV_8UC1, cv::Scalar(7)), bytes, {cv::IMWRITE_JPEG_PROGRESSIVE, 1});
  EXPECT_THAT(CheckJpeg({reinterpret_cast<char*>(bytes.data()), bytes.size()}), IsOkAndHolds(kSize));
}

TEST(JpegCheckTest, TakesMetadataAsCamerasWriteIt) {
  std::string metadata = Segment('\xE1', 65000);                    // Exif with a thumbnail
  for (int i = 0; i < 9; ++i) metadata += Segment('\xE2', 60000);   // a colour profile
  for (int i = 0; i < 20; ++i) metadata += Segment('\xE1', 65533);  // extended XMP
  const std::string jpeg = AfterStart(Jpeg(), metadata + Segment('\xFE', 100));
  EXPECT_THAT(CheckJpeg(jpeg), IsOkAndHolds(kSize));
  EXPECT_THAT(Decodes(jpeg), IsOk());
}

TEST(JpegCheckTest, DoesNotTakeAThumbnailForThePicture) {
  const std::string thumbnail = Progressive();
  std::string segment = Segment('\xE1', thumbnail.size());
  segment.replace(4, thumbnail.size(), thumbnail);
  const std::string jpeg = AfterStart(Jpeg(), segment);
  EXPECT_THAT(CheckJpeg(jpeg), IsOkAndHolds(kSize));
  EXPECT_THAT(CheckJpeg(jpeg.substr(0, jpeg.size() - 2)), StatusIs(kInvalid, HasSubstr("truncated")));
}

TEST(JpegCheckTest, IgnoresWhatFollowsThePicture) {  // phones append a video
  EXPECT_THAT(CheckJpeg(Jpeg() + Jpeg() + std::string(1000, '\xFF')), IsOkAndHolds(kSize));
}

TEST(JpegCheckTest, SkipsFillBytesAndBareMarkers) {
  EXPECT_THAT(CheckJpeg(AfterStart(Jpeg(), "\xFF\xFF\xFF\xD0\xFF\x01")), IsOkAndHolds(kSize));
}

TEST(JpegCheckTest, BoundsScans) {
  const std::string jpeg = Progressive();
  const int scans = Scans(jpeg);
  ASSERT_EQ(scans, 10) << "libjpeg's own script";
  EXPECT_THAT(Decodes(WithMoreScans(jpeg, 32 - scans)), IsOk());
  EXPECT_THAT(CheckJpeg(WithMoreScans(jpeg, 33 - scans)), StatusIs(kInvalid, HasSubstr("JPEG scans: 33, at most 32")));
  EXPECT_THAT(CheckJpeg(WithMoreScans(jpeg, 5000)), StatusIs(kInvalid, HasSubstr("at most 32")));
  EXPECT_THAT(CheckJpeg(WithMoreScans(Jpeg(), 32)), StatusIs(kInvalid, HasSubstr("at most 32"))) << "baseline too";
}

TEST(JpegCheckTest, FindsScansBehindMarkersThatDecodersSkip) {
  // Were the bytes behind the reserved marker taken for a segment, they would hide a scan.
  std::string jpeg = Progressive();
  jpeg.insert(jpeg.size() - 2, absl::StrCat("\xFF\x05", std::string("\x00\x10", 2)));
  EXPECT_THAT(CheckJpeg(WithMoreScans(jpeg, 33)), StatusIs(kInvalid, HasSubstr("at most 32")));
}

TEST(JpegCheckTest, BoundsMetadataAndSegments) {
  std::string metadata;
  for (int i = 0; i < 70; ++i) metadata += Segment('\xE5', 65000);
  EXPECT_THAT(CheckJpeg(AfterStart(Jpeg(), metadata)), StatusIs(kInvalid, HasSubstr("JPEG metadata bytes: 42")));
  std::string segments;
  for (int i = 0; i < 1025; ++i) segments += Segment('\xFE', 0);
  EXPECT_THAT(CheckJpeg(AfterStart(Jpeg(), segments)),
              StatusIs(kInvalid, HasSubstr("JPEG segments: 1025, at most 1024")));
}

TEST(JpegCheckTest, RefusesSeveralPicturesInOne) {
  const std::string jpeg = Jpeg();
  EXPECT_THAT(CheckJpeg(AfterStart(jpeg, "\xFF\xD8")), StatusIs(kInvalid, HasSubstr("expected one picture")));
  const std::string header = jpeg.substr(jpeg.find("\xFF\xC0"), 19);
  std::string twice = jpeg;
  twice.insert(jpeg.find("\xFF\xC0"), header);
  EXPECT_THAT(CheckJpeg(twice), StatusIs(kInvalid, HasSubstr("two frame headers")));
}

TEST(JpegCheckTest, RefusesWhatIsNotAnEightBitHuffmanPicture) {
  EXPECT_THAT(CheckJpeg(WithFrameHeader(Jpeg(), 1, '\xC9')), StatusIs(kInvalid, HasSubstr("JPEG process 9, expected")));
  EXPECT_THAT(CheckJpeg(WithFrameHeader(Jpeg(), 1, '\xC3')), StatusIs(kInvalid, HasSubstr("JPEG process 3, expected")));
  EXPECT_THAT(CheckJpeg(WithFrameHeader(Jpeg(), 4, 12)),
              StatusIs(kInvalid, HasSubstr("bits a sample: 12, expected 8")));
  EXPECT_THAT(CheckJpeg(WithFrameHeader(Jpeg(), 9, 2)), StatusIs(kInvalid, HasSubstr("components: 2")));
  EXPECT_THAT(CheckJpeg(AfterStart(Jpeg(), Segment('\xCC', 2))), StatusIs(kInvalid, HasSubstr("arithmetic")));
}

TEST(JpegCheckTest, RefusesEveryTruncation) {
  for (const std::string& whole : {Jpeg(), Progressive()}) {
    for (size_t size = 0; size < whole.size(); ++size) {
      const std::string part(whole.data(), size);  // exactly its bytes, so that sanitizers see a look beyond
      EXPECT_THAT(CheckJpeg(part), StatusIs(kInvalid)) << size;
    }
  }
}

TEST(JpegCheckTest, ScansBeforeTheFrameHeaderAreNone) {
  EXPECT_THAT(CheckJpeg(AfterStart(Jpeg(), Segment('\xDA', 10))), StatusIs(kInvalid, HasSubstr("no JPEG header")));
  EXPECT_THAT(CheckJpeg("\xFF\xD8\xFF\xD9"), StatusIs(kInvalid));
}

}  // namespace
}  // namespace holdfast
