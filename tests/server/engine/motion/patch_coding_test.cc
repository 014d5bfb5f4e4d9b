// SPDX-License-Identifier: Apache-2.0
#include "server/engine/motion/patch_coding.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <random>

#include "server/engine/motion/flow.h"
#include "tests/support/moving_picture.h"

namespace holdfast {
namespace {

constexpr int kSide = FlowPatch::kSide;
constexpr size_t kPixels = size_t{kSide} * kSide;

std::vector<uint8_t> Texture() { return ShiftedTexture({kSide, kSide}, 0, 0).pixels; }

double MeanDifference(const std::vector<uint8_t>& a, const std::vector<uint8_t>& b) {
  double sum = 0;
  for (size_t i = 0; i < kPixels; ++i) sum += std::abs(a[i] - b[i]);
  return sum / kPixels;
}

TEST(PatchCodingTest, APictureComesBackAlmostAsItWasInAFractionOfItsBytes) {
  const std::vector<uint8_t> texture = Texture();
  const std::string code = EncodePatch(texture);
  EXPECT_LT(code.size(), kPixels / 3);
  const auto decoded = DecodePatch(code);
  ASSERT_TRUE(decoded.has_value());
  ASSERT_EQ(decoded->size(), kPixels);
  EXPECT_LT(MeanDifference(texture, *decoded), 4);
}

TEST(PatchCodingTest, AFlatPictureTakesNextToNothing) {
  const std::vector<uint8_t> flat(kPixels, 200);
  const std::string code = EncodePatch(flat);
  EXPECT_LT(code.size(), 60);
  EXPECT_LT(MeanDifference(flat, DecodePatch(code).value()), 1);
}

TEST(PatchCodingTest, TheWorstPictureIsNotLargerThanTheMost) {
  std::vector<uint8_t> noise(kPixels);
  std::mt19937 random(3);
  for (uint8_t& pixel : noise) pixel = random() % 2 == 0 ? 0 : 255;
  EXPECT_LE(EncodePatch(noise).size(), FlowPatch::kMaxCodeBytes);
}

TEST(PatchCodingTest, OtherBytesAreAPictureOfTheSizeOrNone) {
  const std::string code = EncodePatch(Texture());
  EXPECT_FALSE(DecodePatch("").has_value());
  EXPECT_FALSE(DecodePatch(std::string(FlowPatch::kMaxCodeBytes + 1, 'x')).has_value());
  std::mt19937 random(5);
  for (int round = 0; round < 200; ++round) {
    std::string bytes = code.substr(0, 1 + random() % code.size());
    for (int i = 0; i < round % 20; ++i) bytes[random() % bytes.size()] = static_cast<char>(random());
    const auto decoded = DecodePatch(bytes);
    EXPECT_TRUE(!decoded || decoded->size() == kPixels);
  }
  // Another picture's header, with a size of its own, is data like any other.
  const std::string huge("\xFF\xD8\xFF\xC0\x00\x0B\x08\xFF\xFF\xFF\xFF\x01\x01\x11\x00", 15);
  const auto decoded = DecodePatch(huge);
  EXPECT_TRUE(!decoded || decoded->size() == kPixels);
}

TEST(PatchCodingTest, APatchThatWasKeptIsTheOneThatWasCut) {
  const FlowPyramid picture(ShiftedTexture({160, 120}, 0, 0));
  const FlowPatch cut = CutPatch(picture, {70.25f, 50.5f});
  const auto read = ReadPatch(cut.at, cut.code);
  ASSERT_TRUE(read.has_value());
  EXPECT_EQ(read->pixels, cut.pixels);
  EXPECT_FALSE(ReadPatch(cut.at, "").has_value());
}

}  // namespace
}  // namespace holdfast
