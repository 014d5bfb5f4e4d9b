// SPDX-License-Identifier: Apache-2.0
// Grey pictures of a world whose motion is known: smooth random texture, seen at any sub-pixel shift.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "server/engine/motion/flow.h"

namespace holdfast {

inline constexpr ImageSize kPicture{128, 96}, kWidePicture{160, 120};

// Brightness of an endless texture at (x, y): a sum of waves, so that it is defined between pixels too. 'seed' tells
// textures apart.
inline float TextureAt(float x, float y, uint32_t seed = 1) {
  float sum = 0;
  for (uint32_t wave = 0; wave < 12; ++wave) {
    const uint32_t hash = (seed * 12 + wave + 1) * 2654435761u;
    const float angle = static_cast<float>(hash % 6283) / 1000.0f;
    const float period = 8.0f + static_cast<float>((hash >> 13) % 160) / 10.0f;  // 8 .. 24 pixels
    const float phase = static_cast<float>((hash >> 21) % 628) / 100.0f;
    sum += std::sin((x * std::cos(angle) + y * std::sin(angle)) * 6.2831853f / period + phase);
  }
  return std::clamp(128.0f + 22.0f * sum, 0.0f, 255.0f);
}

// What stands at (x, y) of the texture stands at (x + dx, y + dy) of the picture.
inline GrayImage ShiftedTexture(ImageSize size, float dx, float dy, uint32_t seed = 1) {
  GrayImage image{size, std::vector<uint8_t>(static_cast<size_t>(size.width) * size.height)};
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const float value = TextureAt(static_cast<float>(x) - dx, static_cast<float>(y) - dy, seed);
      image.pixels[static_cast<size_t>(y) * size.width + x] = static_cast<uint8_t>(std::lround(value));
    }
  }
  return image;
}

// Lays the texture 'seed' over the columns first .. end - 1: what was there is hidden.
inline void Cover(GrayImage& image, int first, int end, uint32_t seed) {
  for (int y = 0; y < image.size.height; ++y) {
    for (int x = std::max(first, 0); x < std::min(end, image.size.width); ++x) {
      const float value = TextureAt(static_cast<float>(x), static_cast<float>(y), seed);
      image.pixels[static_cast<size_t>(y) * image.size.width + x] = static_cast<uint8_t>(std::lround(value));
    }
  }
}

inline std::string BytesOf(const GrayImage& image) { return {image.pixels.begin(), image.pixels.end()}; }

}  // namespace holdfast
