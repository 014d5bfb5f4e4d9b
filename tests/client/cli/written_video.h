// SPDX-License-Identifier: Apache-2.0
// Videos for tests, and such as no writer here makes.
#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <string>

#include "absl/strings/match.h"

namespace holdfast {

// 'frames' flat pictures of 64x48; 'codec' has four letters, and the container is that of the path's suffix. An .avi is
// MJPEG and by OpenCV's own writer, which takes any rate.
inline void WriteVideo(const std::string& path, const char* codec, double fps, int frames) {
  const int code = cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]);
  const int writer_of = absl::EndsWith(path, ".avi") ? cv::CAP_OPENCV_MJPEG : cv::CAP_FFMPEG;
  cv::VideoWriter writer(path, writer_of, code, fps, {64, 48});
  ASSERT_TRUE(writer.isOpened()) << path;
  for (int i = 0; i < frames; ++i) writer.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(i % 200)));
}

inline std::string BytesOf(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// Replaces the first 'element' of a Matroska file, its id and the byte of its length, by 'other' where that is given,
// and writes 'value' over what follows.
inline void PatchMatroska(const std::string& path, const std::string& element, const std::string& value,
                          const std::string& other = "") {
  std::string bytes = BytesOf(path);
  const size_t at = bytes.find(element);
  ASSERT_NE(at, std::string::npos) << path << " has no such element";
  bytes.replace(at + element.size(), value.size(), value);
  bytes.replace(at, other.size(), other);
  std::ofstream(path, std::ios::binary) << bytes;
}

// An MP4 of a single track with its index before its pictures, whose places it tells ("stco": four bytes that are zero,
// a count, places). REQUIRES: they come one after the other at the end, as writers leave them.
inline std::string WithIndexFirst(const std::string& mp4) {
  const auto number = [](const std::string& bytes, size_t at) {
    uint32_t value = 0;
    for (size_t i = at; i < at + 4; ++i) value = value << 8 | static_cast<uint8_t>(bytes[i]);
    return value;
  };
  const size_t pictures = mp4.find("mdat") - 4, end = pictures + number(mp4, pictures);
  std::string index = mp4.substr(end);
  const size_t places = index.find("stco") + 12;
  for (uint32_t i = 0; i < number(index, places - 4); ++i) {
    const size_t at = places + 4 * size_t{i};
    const auto place = static_cast<uint32_t>(number(index, at) + index.size());
    for (size_t byte = 0; byte < 4; ++byte) index[at + byte] = static_cast<char>(place >> (24 - 8 * byte));
  }
  return mp4.substr(0, pictures) + index + mp4.substr(pictures, end - pictures);
}

}  // namespace holdfast
