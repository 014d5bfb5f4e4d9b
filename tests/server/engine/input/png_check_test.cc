// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/png_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/engine/input/frame_decoder.h"
#include "tests/support/check_and_decode.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

constexpr absl::string_view kSignature("\x89PNG\r\n\x1A\n", 8);

std::string Number(uint32_t value) {
  return {static_cast<char>(value >> 24), static_cast<char>(value >> 16), static_cast<char>(value >> 8),
          static_cast<char>(value)};
}
std::string Chunk(const std::string& type, const std::string& data = "") {
  const std::string body = type + data;
  const auto checksum = crc32(0, reinterpret_cast<const Bytef*>(body.data()), static_cast<uInt>(body.size()));
  return absl::StrCat(Number(static_cast<uint32_t>(data.size())), body, Number(static_cast<uint32_t>(checksum)));
}
std::string Deflated(const std::string& data) {
  std::string result(compressBound(data.size()), '\0');
  uLongf size = result.size();
  compress2(reinterpret_cast<Bytef*>(result.data()), &size, reinterpret_cast<const Bytef*>(data.data()), data.size(),
            9);
  result.resize(size);
  return result;
}

struct Options {
  int width = 9, height = 7;
  int depth = 8, colour = 2, interlace = 0;
  std::string before_data;              // chunks
  std::string after_data;               // chunks
  size_t data_bytes = 7 * (1 + 9 * 3);  // inflated
};
std::string Png(const Options& options) {
  const std::string format = {static_cast<char>(options.depth), static_cast<char>(options.colour), 0, 0,
                              static_cast<char>(options.interlace)};
  return absl::StrCat(kSignature, Chunk("IHDR", Number(options.width) + Number(options.height) + format),
                      options.before_data, Chunk("IDAT", Deflated(std::string(options.data_bytes, '\0'))),
                      options.after_data, Chunk("IEND"));
}
std::string Text(size_t inflated_bytes) {
  return Chunk("zTXt", absl::StrCat("key", std::string(2, '\0'), Deflated(std::string(inflated_bytes, 'x'))));
}
absl::StatusOr<RgbImage> Decode(const std::string& png) {
  return CheckAndDecode(png, {FrameEncoding::kPng, {}, 1000000}, {32, 32});
}

TEST(PngCheckTest, TakesEveryKindOfPixels) {
  struct Kind {
    int depth, colour, interlace;
    size_t data_bytes;
  };
  // Of 9x7 pixels; the passes of interlaced pictures have 2x1, 1x1, 3x1, 2x2, 5x2, 4x4 and 9x3.
  for (const Kind& kind : {Kind{8, 2, 0, 7 * 28}, Kind{16, 2, 0, 7 * 55}, Kind{16, 6, 0, 7 * 73}, Kind{8, 4, 0, 7 * 19},
                           Kind{1, 0, 0, 7 * 3}, Kind{4, 3, 0, 7 * 6}, Kind{8, 0, 1, 3 + 2 + 4 + 6 + 12 + 20 + 30},
                           Kind{1, 0, 1, 2 + 2 + 2 + 4 + 4 + 8 + 9}}) {
    Options options;
    options.depth = kind.depth;
    options.colour = kind.colour;
    options.interlace = kind.interlace;
    options.data_bytes = kind.data_bytes;
    if (kind.colour == 3) options.before_data = Chunk("PLTE", std::string("\x01\x02\x03\x04\x05\x06", 6));
    const std::string png = Png(options);
    EXPECT_THAT(CheckPng(png), IsOkAndHolds(ImageSize{9, 7}));
    EXPECT_THAT(CheckPngData(png), IsOk());
    EXPECT_THAT(Decode(png), IsOk()) << kind.depth << " bits, colour type " << kind.colour;
    // One row less is not the whole picture, so the numbers above are those of the decoder.
    options.data_bytes = kind.data_bytes - 1;
    EXPECT_THAT(Decode(Png(options)), StatusIs(kInvalid)) << kind.depth << " bits, colour type " << kind.colour;
  }
}

TEST(PngCheckTest, ColoursComeFromThePalette) {
  Options options;
  options.colour = 3;
  options.data_bytes = 7 * 10;
  options.before_data = Chunk("PLTE", std::string("\x0A\x14\x1E", 3)) + Chunk("tRNS", std::string(1, '\0'));
  const auto image = Decode(Png(options));
  ASSERT_THAT(image, IsOk());
  EXPECT_EQ(image->pixels[0], 10);
  EXPECT_EQ(image->pixels[1], 20);
  EXPECT_EQ(image->pixels[2], 30);
}

TEST(PngCheckTest, LeavesMetadataOut) {
  Options plain, rich;
  rich.before_data = absl::StrCat(Text(7 << 20), Chunk("iCCP", absl::StrCat("p", std::string(2, '\0'), "profile")),
                                  Chunk("tEXt", std::string(500000, 'x')));
  rich.after_data = Text(7 << 20);
  EXPECT_THAT(CheckPng(Png(rich)), IsOkAndHolds(ImageSize{9, 7}));
  EXPECT_EQ(PngWithoutMetadata(Png(rich)), Png(plain));
  EXPECT_THAT(Decode(Png(rich)), IsOk());
}

TEST(PngCheckTest, AnAnimationIsItsStillPicture) {
  Options animated;
  animated.before_data = Chunk("acTL", Number(2) + Number(0));
  animated.after_data = Chunk("fcTL", std::string(26, '\0')) + Chunk("fdAT", "more");
  EXPECT_EQ(PngWithoutMetadata(Png(animated)), Png({}));
}

TEST(PngCheckTest, BoundsMetadata) {
  Options options;
  for (int i = 0; i < 60; ++i) options.before_data += Chunk("zTXt", std::string(130000, 'x'));
  EXPECT_THAT(CheckPng(Png(options)), StatusIs(kInvalid, HasSubstr("PNG metadata bytes: 4290396, at most 4194304")));
}

TEST(PngCheckTest, RefusesDataThatInflatesToMoreThanThePicture) {
  Options options;
  options.data_bytes += 60000;
  EXPECT_THAT(CheckPngData(Png(options)), IsOk()) << "a little is appended by some encoders";
  options.data_bytes += 6000;
  EXPECT_THAT(Decode(Png(options)), StatusIs(kInvalid, HasSubstr("more than the picture's 196 bytes")));
  options.data_bytes = 64 << 20;
  EXPECT_THAT(Decode(Png(options)), StatusIs(kInvalid, HasSubstr("more than the picture's 196 bytes")));
}

TEST(PngCheckTest, FindsWhatIsInflatedInLaterChunksToo) {
  Options options;
  const std::string data = Deflated(std::string(64 << 20, '\0'));
  const std::string header = Png(options).substr(0, kSignature.size() + 25);
  std::string png = header;
  for (size_t at = 0; at < data.size(); at += 1000) png += Chunk("IDAT", data.substr(at, 1000));
  EXPECT_THAT(CheckPngData(png + Chunk("IEND")), StatusIs(kInvalid, HasSubstr("more than the picture's")));
}

TEST(PngCheckTest, RefusesHeadersThatNameNoPixels) {
  Options options;
  options.colour = 5;
  EXPECT_THAT(CheckPng(Png(options)), StatusIs(kInvalid, HasSubstr("PNG colour type 5, expected")));
  options = {};
  options.depth = 3;
  EXPECT_THAT(CheckPng(Png(options)), StatusIs(kInvalid, HasSubstr("PNG bit depth 3, expected")));
  options = {};
  options.interlace = 2;
  EXPECT_THAT(CheckPng(Png(options)), StatusIs(kInvalid, HasSubstr("PNG interlacing 2, expected")));
}

TEST(PngCheckTest, RefusesEveryTruncation) {
  const std::string whole = Png({});
  for (size_t size = 0; size < whole.size(); ++size) {
    const std::string part(whole.data(), size);  // exactly its bytes, so that sanitizers see a look beyond
    EXPECT_THAT(CheckPng(part), StatusIs(kInvalid)) << size;
  }
  EXPECT_THAT(CheckPng(whole + "and more"), IsOk());
}

}  // namespace
}  // namespace holdfast
