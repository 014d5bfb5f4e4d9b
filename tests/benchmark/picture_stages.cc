// SPDX-License-Identifier: Apache-2.0
// What happens to a frame beside the network: it is decoded, and optical flow carries points on to it.
#include <cstdint>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "server/engine/input/frame_decoder.h"
#include "server/engine/motion/flow.h"
#include "tests/benchmark/bench_case.h"

namespace holdfast {
namespace {

constexpr int kJpegQuality = 90;
constexpr int kShift = 3;           // pixels between two frames
constexpr float kMaxRoundTrip = 2;  // pixels

// Frames are larger than what is processed, as those of the demo are: 768x576 for 512x384.
ImageSize FrameOf(ImageSize processing) { return {processing.width * 3 / 2, processing.height * 3 / 2}; }

// Blobs with fine grain on them, so that a JPEG has something to code and flow something to follow. Two pictures of
// different 'shift' show the same a little further.
cv::Mat MakePicture(ImageSize size, int shift) {
  cv::RNG random(7);
  cv::Mat coarse(size.height / 16 + 1, size.width / 16 + 1, CV_8UC3);
  random.fill(coarse, cv::RNG::UNIFORM, 0, 256);
  const cv::Size whole(size.width + 2 * kShift, size.height + 2 * kShift);
  cv::Mat picture;
  cv::resize(coarse, picture, whole, 0, 0, cv::INTER_CUBIC);
  cv::Mat grain(whole, CV_8UC3);
  random.fill(grain, cv::RNG::UNIFORM, 0, 24);
  picture += grain;
  return picture(cv::Rect(shift, shift, size.width, size.height)).clone();
}

GrayImage MakeGray(ImageSize size, int shift) {
  cv::Mat gray;
  cv::cvtColor(MakePicture(size, shift), gray, cv::COLOR_BGR2GRAY);
  return {size, std::vector<uint8_t>(gray.data, gray.data + gray.total())};
}

std::vector<FlowPoint> Scatter(ImageSize size, int64_t count) {
  cv::RNG random(11);
  std::vector<FlowPoint> points;
  for (int64_t i = 0; i < count; ++i) {
    points.push_back({random.uniform(0.0F, static_cast<float>(size.width - 1)),
                      random.uniform(0.0F, static_cast<float>(size.height - 1))});
  }
  return points;
}

CaseName NameOfPictureStage(const char* stage, ImageSize processing) {
  CaseName name;
  name.stage = stage;
  name.size = absl::StrCat(processing.height, "x", processing.width);
  return name;
}

// A JPEG to what is processed, and to what flow looks at.
void RegisterDecode(ImageSize processing) {
  RegisterCase({NameOfPictureStage("decode", processing), {}, [processing] {
                  const ImageSize size = FrameOf(processing);
                  std::vector<uint8_t> jpeg;
                  cv::imencode(".jpg", MakePicture(size, 0), jpeg, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality});
                  FrameFormat format;
                  format.max_pixels = Pixels(size);
                  return [=] {
                    const absl::string_view bytes(reinterpret_cast<const char*>(jpeg.data()), jpeg.size());
                    GrayImage gray;
                    gray.size = FlowSize(size, processing);
                    DecodeFrame(bytes, format, size, processing, &gray).value();
                  };
                }});
}

// The pyramid of a new frame, and all points carried on to it and back.
void RegisterFlow(ImageSize processing, int64_t count) {
  CaseName name = NameOfPictureStage("flow", processing);
  name.points = std::to_string(count);
  RegisterCase({name, {}, [processing, count] {
                  const ImageSize size = FlowSize(FrameOf(processing), processing);
                  const auto from = std::make_shared<const FlowPyramid>(MakeGray(size, 0));
                  const GrayImage picture = MakeGray(size, kShift);
                  const std::vector<FlowPoint> points = Scatter(size, count);
                  return [=] { CarryPoints(*from, FlowPyramid(picture), points, kMaxRoundTrip); };
                }});
}

}  // namespace

void RegisterPictureStages(const BenchGrid& grid) {
  cv::setNumThreads(1);  // as in the server
  for (const ImageSize size : grid.sizes) {
    RegisterDecode(size);
    for (const int64_t points : grid.points) RegisterFlow(size, points);
  }
}

}  // namespace holdfast
