// SPDX-License-Identifier: Apache-2.0
#include "client/cli/upright.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <opencv2/core/version.hpp>
#include <optional>

#include "client/cli/container_file.h"

namespace holdfast {
namespace {

// The first box of the type in [begin, end) that is whole.
std::optional<Mp4Box> FindBox(ContainerFile& file, const std::string& type, uint64_t begin, uint64_t end) {
  for (uint64_t at = begin; at < end;) {
    const auto box = Mp4BoxAt(file, at);
    if (!box || !file.Holds(box->content, box->length)) return {};
    if (box->type == type) return box;
    at = box->content + box->length;
  }
  return {};
}

std::optional<Mp4Box> FindIn(ContainerFile& file, const Mp4Box& box, const std::string& type) {
  return FindBox(file, type, box.content, box.content + box.length);
}

bool IsVideo(ContainerFile& file, const Mp4Box& track) {
  const auto media = FindIn(file, track, "mdia");
  const auto handler = media ? FindIn(file, *media, "hdlr") : media;
  return handler && file.Read(handler->content + 8, 4) == "vide";
}

// The track's header.
std::optional<Mp4Box> HeaderOfFirstVideo(ContainerFile& file) {
  const auto index = FindBox(file, "moov", 0, file.size());
  if (!index) return {};
  const uint64_t end = index->content + index->length;
  for (uint64_t at = index->content; at < end;) {
    const auto track = FindBox(file, "trak", at, end);
    if (!track) return {};
    if (IsVideo(file, *track)) return FindIn(file, *track, "tkhd");
    at = track->content + track->length;
  }
  return {};
}

// A header's matrix {a, b, u, c, d, v, x, y, w}, of fixed-point numbers, takes a pixel (x, y) to (a x + c y, b x + d
// y). None that turns by other than right angles is followed.
Turn TurnOfHeader(ContainerFile& file, const Mp4Box& header) {
  const bool long_times = file.Read(header.content, 1) == std::string(1, '\1');
  const std::string matrix = file.Read(header.content + (long_times ? 52 : 40), 36);
  if (matrix.size() < 36) return {};
  const auto entry = [&matrix](size_t at) { return static_cast<int32_t>(BigEndian(matrix.substr(4 * at, 4))); };
  const int32_t a = entry(0), b = entry(1), c = entry(3), d = entry(4);
  if (b == 0 && c == 0) return {false, a < 0, d < 0};
  if (a == 0 && d == 0) return {true, c < 0, b < 0};
  return {};
}

// As OpenCV tells it. Version 4.6 counts the other way around.
Turn TurnOfCapture(cv::VideoCapture& capture) {
  const double said = capture.get(cv::CAP_PROP_ORIENTATION_META);
  const int degrees = static_cast<int>(std::isfinite(said) ? said : 0) % 360;
  const bool reversed = CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR == 6;
  switch (((reversed ? -degrees : degrees) + 360) % 360) {  // clockwise
    case 90:
      return {true, true, false};
    case 180:
      return {false, true, true};
    case 270:
      return {true, false, true};
    default:
      return {};
  }
}

}  // namespace

cv::Mat Turned(const cv::Mat& picture, const Turn& turn) {
  cv::Mat turned = picture;
  if (turn.transpose) cv::transpose(picture, turned);
  if (!turn.flip_x && !turn.flip_y) return turned;
  cv::Mat flipped;
  cv::flip(turned, flipped, turn.flip_x && turn.flip_y ? -1 : turn.flip_x ? 1 : 0);
  return flipped;
}

Turn TakeOverTurn(const std::string& input, cv::VideoCapture& capture) {
  capture.set(cv::CAP_PROP_ORIENTATION_AUTO, 0);
  if (capture.get(cv::CAP_PROP_ORIENTATION_AUTO) != 0) return {};  // OpenCV still turns them
  ContainerFile file(input);
  if (!IsMp4(file)) return TurnOfCapture(capture);
  const auto header = HeaderOfFirstVideo(file);
  return header ? TurnOfHeader(file, *header) : Turn{};
}

}  // namespace holdfast
