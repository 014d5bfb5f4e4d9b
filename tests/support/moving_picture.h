// SPDX-License-Identifier: Apache-2.0
// Grey pictures of a world whose motion is known: smooth random texture, seen at any sub-pixel shift.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "server/engine/deformation.h"
#include "server/engine/motion/flow.h"

namespace holdfast {

inline constexpr ImageSize kPicture{128, 96}, kWidePicture{160, 120};

// An endless texture is a sum of waves, so that it is defined between pixels too; seeds tell textures apart.
struct TextureWave {
  float along_x, along_y;  // radians a pixel
  float phase;
};

inline std::array<TextureWave, 12> TextureWaves(uint32_t seed) {
  std::array<TextureWave, 12> waves;
  for (uint32_t i = 0; i < waves.size(); ++i) {
    const uint32_t hash = (seed * 12 + i + 1) * 2654435761u;
    const float angle = static_cast<float>(hash % 6283) / 1000.0f;
    const float period = 8.0f + static_cast<float>((hash >> 13) % 160) / 10.0f;  // 8 .. 24 pixels
    const float turn = 6.2831853f / period;
    waves[i] = {std::cos(angle) * turn, std::sin(angle) * turn, static_cast<float>((hash >> 21) % 628) / 100.0f};
  }
  return waves;
}

// Lays the texture 'seed' over the columns first .. end - 1: what stands at (x, y) of it stands at (x + dx, y + dy) of
// the picture.
inline void LayTexture(GrayImage& image, int first, int end, float dx, float dy, uint32_t seed) {
  const auto waves = TextureWaves(seed);
  first = std::max(first, 0);
  end = std::min(end, image.size.width);
  if (first >= end) return;
  const auto columns = static_cast<size_t>(end - first);
  // sin(a + b) of a column's part and a row's part: tests make thousands of pictures.
  std::vector<float> sines(waves.size() * columns), cosines(sines.size());
  for (size_t i = 0; i < sines.size(); ++i) {
    const float at = static_cast<float>(first) + static_cast<float>(i % columns) - dx;
    sines[i] = std::sin(at * waves[i / columns].along_x);
    cosines[i] = std::cos(at * waves[i / columns].along_x);
  }
  for (int y = 0; y < image.size.height; ++y) {
    std::vector<float> sums(columns, 0.0f);
    for (size_t wave = 0; wave < waves.size(); ++wave) {
      const float at = (static_cast<float>(y) - dy) * waves[wave].along_y + waves[wave].phase;
      const float sine = std::sin(at), cosine = std::cos(at);
      const float *column_sine = &sines[wave * columns], *column_cosine = &cosines[wave * columns];
      for (size_t x = 0; x < columns; ++x) sums[x] += column_sine[x] * cosine + column_cosine[x] * sine;
    }
    uint8_t* row = &image.pixels[static_cast<size_t>(y) * image.size.width + static_cast<size_t>(first)];
    for (size_t x = 0; x < columns; ++x) {
      row[x] = static_cast<uint8_t>(std::lround(std::clamp(128.0f + 22.0f * sums[x], 0.0f, 255.0f)));
    }
  }
}

inline GrayImage ShiftedTexture(ImageSize size, float dx, float dy, uint32_t seed = 1) {
  GrayImage image{size, std::vector<uint8_t>(static_cast<size_t>(size.width) * size.height)};
  LayTexture(image, 0, size.width, dx, dy, seed);
  return image;
}

// Richer than one texture, which may well look alike in two places.
inline GrayImage RichTexture(ImageSize size, float dx, float dy, uint32_t seed = 1) {
  const GrayImage parts[] = {ShiftedTexture(size, dx, dy, seed), ShiftedTexture(size, dx, dy, seed + 100),
                             ShiftedTexture(size, dx, dy, seed + 200)};
  GrayImage rich = parts[0];
  for (size_t i = 0; i < rich.pixels.size(); ++i) {
    const int sum = parts[0].pixels[i] + parts[1].pixels[i] + parts[2].pixels[i] - 3 * 128;
    rich.pixels[i] = static_cast<uint8_t>(std::clamp(128 + sum / 2, 0, 255));
  }
  return rich;
}

// A rotation, in radians; from x towards y.
inline Deformation Turned(float angle) { return {std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle)}; }

// What lies around 'query' in the texture lies around 'at', deformed.
inline GrayImage DeformedTexture(ImageSize size, FlowPoint query, FlowPoint at, const Deformation& shape,
                                 uint32_t seed = 1) {
  const auto waves = TextureWaves(seed);
  const float determinant = shape.xx * shape.yy - shape.xy * shape.yx;
  GrayImage image{size, {}};
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const float dx = static_cast<float>(x) - at.x, dy = static_cast<float>(y) - at.y;
      const float from_x = query.x + (shape.yy * dx - shape.xy * dy) / determinant;
      const float from_y = query.y + (shape.xx * dy - shape.yx * dx) / determinant;
      float sum = 0;
      for (const TextureWave& wave : waves) sum += std::sin(from_x * wave.along_x + from_y * wave.along_y + wave.phase);
      image.pixels.push_back(static_cast<uint8_t>(std::lround(std::clamp(128.0f + 22.0f * sum, 0.0f, 255.0f))));
    }
  }
  return image;
}

// What was in the columns first .. end - 1 is hidden.
inline void Cover(GrayImage& image, int first, int end, uint32_t seed) { LayTexture(image, first, end, 0, 0, seed); }

inline std::string BytesOf(const GrayImage& image) { return {image.pixels.begin(), image.pixels.end()}; }

}  // namespace holdfast
