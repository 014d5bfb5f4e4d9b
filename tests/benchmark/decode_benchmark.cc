// SPDX-License-Identifier: Apache-2.0
// What a frame takes on its way in: decoding a JPEG, its grey picture for flow, and its pixels for the network.
#include <benchmark/benchmark.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "server/engine/input/frame_decoder.h"

namespace holdfast {
namespace {

constexpr ImageSize kProcessing = {512, 384};

// Shapes and noise, about as many bytes a pixel as cameras make.
std::string Jpeg(ImageSize size) {
  cv::Mat coarse(27, 48, CV_8UC3), picture, noise(size.height, size.width, CV_16SC3), sum;
  cv::RNG random(1);
  random.fill(coarse, cv::RNG::UNIFORM, 0, 256);
  cv::resize(coarse, picture, {size.width, size.height}, 0, 0, cv::INTER_CUBIC);
  random.fill(noise, cv::RNG::NORMAL, 0, 4);
  cv::add(picture, noise, sum, cv::noArray(), CV_8UC3);
  std::vector<uint8_t> bytes;
  cv::imencode(".jpg", sum, bytes, {cv::IMWRITE_JPEG_QUALITY, 90});
  return {bytes.begin(), bytes.end()};
}

void Decode(benchmark::State& state) {
  cv::setNumThreads(1);
  const ImageSize size{static_cast<int>(state.range(0)), static_cast<int>(state.range(1))};
  const std::string jpeg = Jpeg(size);
  const FrameFormat format{FrameEncoding::kJpeg, {}, Pixels(size)};
  GrayImage gray{FlowSize(size, kProcessing), {}};
  while (state.KeepRunning()) benchmark::DoNotOptimize(DecodeFrame(jpeg, format, size, kProcessing, &gray));
  state.counters["kB"] = static_cast<double>(jpeg.size()) / 1000;
}
// 3840x2160 is decoded at a half; odd sides are decoded whole.
BENCHMARK(Decode)
    ->ArgNames({"width", "height"})
    ->Args({640, 480})
    ->Args({1024, 576})
    ->Args({1920, 1080})
    ->Args({1921, 1081})
    ->Args({3840, 2160})
    ->Args({3841, 2161})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace holdfast

BENCHMARK_MAIN();
