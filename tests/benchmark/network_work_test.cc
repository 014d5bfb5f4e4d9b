// SPDX-License-Identifier: Apache-2.0
#include "tests/benchmark/network_work.h"

#include <ATen/record_function.h>
#include <gmock/gmock.h>
#include <torch/types.h>

#include "model/contextual_attention.h"
#include "model/encoder.h"
#include "model/presets.h"
#include "model/update_block.h"

namespace holdfast {
namespace {

// Operations since the last Convolved began. LibTorch's callbacks are plain functions.
double convolved = 0;

std::unique_ptr<at::ObserverContext> CountConvolution(const at::RecordFunction& call) {
  const torch::Tensor& x = call.inputs()[0].toTensor();
  const torch::Tensor& weight = call.inputs()[1].toTensor();
  const std::vector<int64_t> stride = call.inputs()[3].toIntVector();
  const int64_t pixels = (x.size(2) / stride[0]) * (x.size(3) / stride[1]) * x.size(0);
  convolved += 2.0 * static_cast<double>(weight.numel() * pixels);
  return nullptr;
}

// Operations of the convolutions that LibTorch runs: all of them, where there may be a gradient.
template <typename Function>
double Convolved(const Function& run) {
  convolved = 0;
  const at::CallbackHandle handle = at::addThreadLocalCallback(
      at::RecordFunctionCallback([](const at::RecordFunction& call) {
        return call.name() == std::string("aten::convolution") ? CountConvolution(call) : nullptr;
      }).needsInputs(true));
  run();
  at::removeCallback(handle);
  return convolved;
}

WorkShape Shape(const char* preset, int64_t points = 0) {
  WorkShape shape;
  shape.options = PresetByName(preset).value();
  shape.height = 64;
  shape.width = 96;
  shape.points = points;
  return shape;
}

TEST(NetworkWorkTest, CountsWhatTheEncoderConvolves) {
  for (const char* preset : {"small", "pips2"}) {
    const WorkShape shape = Shape(preset);
    Encoder encoder(shape.options);
    EXPECT_EQ(EncoderWork(shape).operations, Convolved([&] {
                encoder->forward(torch::rand({1, 3, 64, 96}));
              }))
        << preset;
  }
}

TEST(NetworkWorkTest, CountsWhatTheUpdateBlockConvolves) {
  for (const char* preset : {"test", "small", "pips2"}) {
    const WorkShape shape = Shape(preset, 3);
    const int64_t frames = shape.options.window;
    UpdateBlock block(shape.options);
    const double run = Convolved([&] {
      block->forward(torch::rand({3, frames, shape.options.CorrelationFeatures()}), torch::rand({3, frames, 2}));
    });
    EXPECT_EQ(UpdateWork(shape).operations, run) << preset;
  }
}

TEST(NetworkWorkTest, CountsLinearLayersAndProductsOfAttention) {
  WorkShape shape = Shape("small");
  const int64_t tokens_of_patch = shape.options.context_patch * shape.options.context_patch;
  shape.height = 8 * shape.options.context_patch;              // one row of patches
  shape.width = int64_t{4} * 8 * shape.options.context_patch;  // two with one neighbour, two with two
  ContextualAttention context(shape.options);
  const double linear = Convolved([&] {
    context->forward(torch::rand({1, shape.options.feature_channels, shape.height / 8, shape.width / 8}));
  });
  const double pairs = 10.0 * static_cast<double>(tokens_of_patch * tokens_of_patch);
  const auto channels = static_cast<double>(shape.options.feature_channels);
  const double products = static_cast<double>(shape.options.context_blocks) * pairs * channels * 4;
  EXPECT_EQ(AttentionWork(shape).operations, linear + products);
  EXPECT_EQ(AttentionWork(Shape("pips2")).operations, 0);
}

TEST(NetworkWorkTest, AWindowIsItsStages) {
  const WorkShape shape = Shape("small", 5);
  const double frames = 24 * (EncoderWork(shape).operations + AttentionWork(shape).operations);
  const double templates = 1 + 3 + 3;  // of three iterations
  const double refined = templates / 3 * CorrelationWork(shape).operations + 3 * UpdateWork(shape).operations;
  EXPECT_DOUBLE_EQ(WindowWork(shape, 3).operations, frames + refined);
}

TEST(NetworkWorkTest, BytesGrowWithWhatIsReadAndWritten) {
  WorkShape shape = Shape("small", 1);
  const int64_t maps = (8 * 12 + 4 * 6 + 2 * 3 + 1) * shape.options.feature_channels;
  EXPECT_EQ(PyramidWork(shape).bytes, 4 * maps);
  const double one = CorrelationWork(shape).bytes;
  shape.points = 1000;  // which look at the same maps
  EXPECT_GT(CorrelationWork(shape).bytes, 100 * one);
  EXPECT_LT(CorrelationWork(shape).bytes, 1000 * one);
  shape.element_bytes = 2;
  EXPECT_EQ(PyramidWork(shape).bytes, 2 * maps);
}

}  // namespace
}  // namespace holdfast
