// SPDX-License-Identifier: Apache-2.0
// The network in bfloat16 on the CPU, operator by operator and as a whole. LibTorch's kernels for bfloat16 are younger
// than those for float32 and were wrong at some sizes: every operator that the network runs in bfloat16 stands in a
// table here and is compared with double at odd and even sizes, forward and backward; a recording of real runs proves
// that the table leaves none out.
#include <ATen/record_function.h>
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cstdio>
#include <mutex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "model/checkpoint/checkpoint.h"
#include "model/ops/convolution.h"
#include "model/ops/correlation.h"
#include "model/ops/instance_norm.h"
#include "model/ops/patch_attention.h"
#include "model/ops/resize.h"
#include "model/ops/sampling.h"
#include "model/precision_check.h"
#include "tests/support/bfloat16_convolutions.h"
#include "tests/support/golden.h"
#include "tests/support/gradient_check.h"
#include "tests/support/networks.h"
#include "tests/support/source_tree.h"

namespace holdfast {
namespace {

using Tensors = std::vector<torch::Tensor>;

torch::Tensor Map(int64_t maps, int64_t channels, int64_t height, int64_t width) {
  return torch::randn({maps, channels, height, width}).contiguous(torch::MemoryFormat::ChannelsLast);
}

// Dtype of the tensors as in the network: an operator of ours runs as it is, compared with a plain formula in double.
struct Operator {
  std::string name;
  std::set<std::string> aten;  // what LibTorch calls it, forward and backward
  std::function<Tensors(int64_t height, int64_t width)> inputs;
  TensorFunction run;
  TensorFunction plain;         // empty: the same as 'run'
  double tolerance = 1.0 / 64;  // of the largest value: two bits of eight for sums, whose terms were rounded
};

Operator Conv(const std::string& name, int64_t in, int64_t out, int64_t kernel, int64_t stride) {
  const auto run = [kernel, stride](const Tensors& in) {
    return at::conv2d(in[0], in[1], in[2], at::IntArrayRef({stride, stride}),
                      at::IntArrayRef({kernel / 2, kernel / 2}));
  };
  return {name,
          {"aten::conv2d", "aten::convolution", "aten::_convolution", "aten::mkldnn_convolution",
           "aten::convolution_backward", "aten::mkldnn_convolution_backward"},
          [=](int64_t height, int64_t width) {
            return Tensors{Map(2, in, height, width),
                           torch::randn({out, in, kernel, kernel}).contiguous(torch::MemoryFormat::ChannelsLast) /
                               std::sqrt(static_cast<double>(in * kernel * kernel)),
                           torch::randn({out})};
          },
          run,
          {}};
}

// x [N, C, 1, S]: the update block's convolutions along the frames.
Operator ConvolutionOverTime() {
  return {"conv1d of 3 as 1x3",
          {},
          [](int64_t height, int64_t width) {
            return Tensors{Map(height, 12, 1, width),
                           torch::randn({18, 12, 1, 3}).contiguous(torch::MemoryFormat::ChannelsLast) / 6,
                           torch::randn({18})};
          },
          [](const Tensors& in) {
            return at::conv2d(in[0], in[1], in[2], at::IntArrayRef({1, 1}), at::IntArrayRef({0, 1}));
          },
          {}};
}

Operator Elementwise(const std::string& name, std::set<std::string> aten, TensorFunction run) {
  return {name,
          std::move(aten),
          [](int64_t height, int64_t width) {
            return Tensors{Map(2, 19, height, width), Map(2, 19, height, width)};
          },
          std::move(run),
          {}};
}

PyramidCells OneLevel(const torch::Tensor& map) {  // [S, C, H, W]
  return {map.permute({0, 2, 3, 1}).flatten(1, 2), {{map.size(2), map.size(3)}}};
}

torch::Tensor Positions(int64_t rows, int64_t frames, const torch::Tensor& map) {
  const torch::Tensor size = torch::tensor({static_cast<float>(map.size(3)), static_cast<float>(map.size(2))});
  const torch::Tensor phase = torch::arange(rows * frames * 2, torch::kFloat32).view({rows, frames, 2});
  return torch::frac(phase * 0.618034) * size;
}

std::vector<Operator> Operators() {
  std::vector<Operator> all = {
      Conv("conv 7x7 stride 2", 3, 24, 7, 2),
      Conv("conv 3x3", 24, 32, 3, 1),
      Conv("conv 3x3 stride 2", 24, 32, 3, 2),
      Conv("conv 1x1 stride 2", 24, 32, 1, 2),
      Conv("conv 1x1", 48, 24, 1, 1),
      ConvolutionOverTime(),
      Elementwise("relu", {"aten::relu", "aten::clamp_min", "aten::threshold_backward"},
                  [](const Tensors& in) { return torch::relu(in[0]) + 0 * in[1]; }),
      Elementwise("gelu", {"aten::gelu", "aten::gelu_backward"},
                  [](const Tensors& in) { return torch::gelu(in[0]) + 0 * in[1]; }),
      Elementwise("add", {"aten::add", "aten::add_"}, [](const Tensors& in) { return in[0] + in[1]; }),
      Elementwise("cat", {"aten::cat", "aten::_cat"},
                  [](const Tensors& in) {
                    return torch::cat({in[0], in[1]}, 1);
                  }),
      Elementwise("add_ of padded channels", {"aten::constant_pad_nd"},
                  [](const Tensors& in) {
                    const torch::Tensor rows = in[0].narrow(1, 0, 16).permute({0, 2, 3, 1});
                    return (in[1] * 1).add_(torch::constant_pad_nd(rows, {1, 2}).permute({0, 3, 1, 2}));
                  }),
      Elementwise("x * 2 - 1", {"aten::mul", "aten::sub"}, [](const Tensors& in) { return in[0] * 2.0 - in[1]; }),
      Elementwise("resize down", {},
                  [](const Tensors& in) {
                    const int64_t height = (in[0].size(2) + 2) / 3, width = (in[0].size(3) + 1) / 2;
                    return ResizeBilinear(in[0], height, width) + 0 * ResizeBilinear(in[1], height, width);
                  }),
      Elementwise("resize up", {},
                  [](const Tensors& in) {
                    const int64_t height = in[0].size(2) * 2 + 1, width = in[0].size(3) * 3;
                    return ResizeBilinear(in[0], height, width) + 0 * ResizeBilinear(in[1], height, width);
                  }),
      Elementwise("norm, relu, add", {}, [](const Tensors& in) { return InstanceNormReluAdd(in[0], in[1]); }),
      Elementwise("average pool", {"aten::avg_pool2d", "aten::avg_pool2d_backward"},
                  [](const Tensors& in) { return torch::avg_pool2d(in[0], 2) + 0 * torch::avg_pool2d(in[1], 2); }),
  };
  Operator attention = {"patch attention",
                        {},
                        [](int64_t height, int64_t width) {
                          return Tensors{torch::randn({1, height, width, 16}), torch::randn({1, height, width, 16})};
                        },
                        [](const Tensors& in) {
                          return PatchAttention(in[0], in[1], {2, 4});
                        },
                        [](const Tensors& in) {
                          return PatchAttentionPlain(in[0], in[1], {2, 4});
                        }};
  all.push_back(std::move(attention));
  Operator sampling = {"sampling",
                       {},
                       [](int64_t height, int64_t width) { return Tensors{Map(3, 12, height, width)}; },
                       [](const Tensors& in) { return SampleRows(OneLevel(in[0]), Positions(7, 3, in[0])); },
                       [](const Tensors& in) { return SampleRowsPlain(OneLevel(in[0]), Positions(7, 3, in[0])); }};
  all.push_back(std::move(sampling));
  Operator correlation = {"correlation",
                          {},
                          [](int64_t height, int64_t width) { return Tensors{Map(3, 12, height, width)}; },
                          [](const Tensors& in) {
                            const torch::Tensor templates = torch::ones({7, 3, 2, 12});
                            return Correlate(OneLevel(in[0]), templates, Positions(7, 3, in[0]), 3);
                          },
                          [](const Tensors& in) {
                            const torch::Tensor templates = torch::ones({7, 3, 2, 12}, torch::kDouble);
                            return CorrelatePlain(OneLevel(in[0]), templates, Positions(7, 3, in[0]), 3);
                          }};
  all.push_back(std::move(correlation));
  return all;
}

struct Size {
  int64_t height, width;
};
constexpr Size kMapSizes[] = {{4, 4}, {5, 7}, {8, 12}, {13, 9}, {19, 38}, {37, 53}, {40, 72}};

class Bfloat16OperatorTest : public ::testing::Test {
  void SetUp() override { SKIP_WITHOUT_BFLOAT16_CONVOLUTIONS(); }
};

TEST_F(Bfloat16OperatorTest, EveryOperatorAgreesWithDoubleAtOddAndEvenSizes) {
  for (const Operator& op : Operators()) {
    double worst = 0, worst_gradient = 0;
    for (const Size& size : kMapSizes) {
      torch::manual_seed(11);
      Tensors inputs = op.inputs(size.height, size.width);
      for (auto& input : inputs) input = input.to(torch::kBFloat16).to(torch::kFloat32);
      const FunctionResult got = Differentiate(op.run, inputs, torch::kBFloat16);
      const FunctionResult want = Differentiate(op.plain ? op.plain : op.run, inputs, torch::kDouble);
      worst = std::max(worst, RelativeDifference(got.value, want.value));
      for (size_t i = 0; i < inputs.size(); ++i) {
        worst_gradient = std::max(worst_gradient, RelativeDifference(got.gradients[i], want.gradients[i]));
      }
    }
    std::printf("%-26s forward %.2e backward %.2e\n", op.name.c_str(), worst, worst_gradient);
    EXPECT_LE(worst, op.tolerance) << op.name;
    EXPECT_LE(worst_gradient, op.tolerance) << op.name;
  }
}

// --- What the network runs in bfloat16.

std::mutex recorded_mutex;
std::set<std::string>* recorded = nullptr;  // guarded by the mutex

bool HoldsBfloat16(const c10::IValue& value) {
  if (value.isTensor()) return value.toTensor().defined() && value.toTensor().scalar_type() == torch::kBFloat16;
  if (!value.isTensorList()) return false;
  for (const torch::Tensor& tensor : value.toTensorVector()) {
    if (tensor.defined() && tensor.scalar_type() == torch::kBFloat16) return true;
  }
  return false;
}

std::unique_ptr<at::ObserverContext> Record(const at::RecordFunction& function) {
  for (const c10::IValue& input : function.inputs()) {
    if (!HoldsBfloat16(input)) continue;
    const std::lock_guard<std::mutex> lock(recorded_mutex);
    if (recorded != nullptr) recorded->insert(function.name());
    break;
  }
  return nullptr;
}

template <typename Work>
std::set<std::string> OperatorsIn(const Work& work) {
  std::set<std::string> names;
  const auto handle =
      at::addGlobalCallback(at::RecordFunctionCallback(Record).needsInputs(true).scopes({at::RecordScope::FUNCTION}));
  {
    const std::lock_guard<std::mutex> lock(recorded_mutex);
    recorded = &names;
  }
  work();
  at::removeCallback(handle);
  const std::lock_guard<std::mutex> lock(recorded_mutex);
  recorded = nullptr;
  return names;
}

// Views, copies and conversions: no arithmetic.
std::set<std::string> Movements() {
  std::istringstream words(
      "_reshape_alias _reshape_copy _to_copy alias as_strided as_strided_ clone contiguous copy_ detach "
      "detach_ empty_like expand expand_as fill_ flatten index_select narrow new_empty new_empty_strided "
      "new_zeros numel ones_like permute repeat reshape resize_ resolve_conj resolve_neg select "
      "select_backward set_ slice slice_backward split_with_sizes squeeze squeeze_ stack t to transpose "
      "unflatten unsqueeze unsqueeze_ view view_as zero_ zeros_like is_same_size result_type");
  std::set<std::string> names = {"detach", "detach_"};
  for (std::string word; words >> word;) names.insert("aten::" + word);
  return names;
}

torch::Tensor Clip(int64_t frames, int64_t height, int64_t width) {
  const torch::Tensor wide = CheckPicture(height, width + 2 * frames);
  Tensors clip;
  for (int64_t t = 0; t < frames; ++t) clip.push_back(wide.narrow(1, 2 * (frames - t), width));
  return torch::stack(clip);
}

// Of a network with stride 8, feature pixels. -> [2] float32
torch::Tensor LastPlaceOfMaps(int64_t height, int64_t width) {
  const int64_t x = width / 8 - 1, y = height / 8 - 1;
  return torch::tensor({static_cast<float>(x), static_cast<float>(y)});
}

struct Unrolled {
  torch::Tensor positions;  // after the last iteration, feature pixels
  torch::Tensor gradient;   // of all parameters, one after the other
};

// A training step: a loss over positions and visibility, backwards to the encoder's first layer.
Unrolled TrainOnce(PointModel model, int64_t height, int64_t width) {
  model->zero_grad();
  const torch::Tensor maps = model->Encode(Clip(8, height, width));
  const torch::Tensor xy =
      torch::tensor({{0.3, 0.4}, {0.7, 0.2}, {0.5, 0.8}}, torch::kFloat32) * LastPlaceOfMaps(height, width);
  const auto trajectory = model->Unroll(maps, xy.unsqueeze(1).repeat({1, 8, 1}), 2);
  (trajectory.positions[0].abs().sum() + trajectory.positions[1].square().sum() +
   torch::sigmoid(trajectory.visibility_logit).sum())
      .backward();
  Tensors gradients;
  for (const auto& parameter : model->parameters()) {
    if (parameter.grad().defined()) gradients.push_back(parameter.grad().to(torch::kFloat32).flatten());
  }
  return {trajectory.positions.back().detach(), torch::cat(gradients)};
}

TEST_F(Bfloat16OperatorTest, TheTableHoldsEveryOperatorThatTheNetworkRuns) {
  std::set<std::string> known = Movements();
  for (const Operator& op : Operators()) known.insert(op.aten.begin(), op.aten.end());
  const PointModel exact = FormulaModel(TinyOptions());
  const PointModel fast = CopyInPrecision(exact, torch::kBFloat16);
  std::set<std::string> seen = OperatorsIn([&] { ComparePrecisions(exact, fast, CheckPicture(64, 72)); });
  EXPECT_GT(seen.count("aten::conv2d"), 0u) << "the recording sees the network";
  const std::set<std::string> training = OperatorsIn([&] { TrainOnce(fast, 64, 72); });
  EXPECT_GT(training.count("aten::convolution_backward"), 0u) << "and its way back";
  seen.insert(training.begin(), training.end());
  for (const std::string& name : seen) {
    EXPECT_GT(known.count(name), 0u) << name << " runs in bfloat16 and is compared by no test";
  }
}

// --- The network as a whole, trained weights, portrait and landscape.

PointModel Trained() {
  auto loaded = LoadModel(InSourceTree("weights/small.safetensors"));
  EXPECT_TRUE(loaded.ok()) << loaded.status();
  return loaded->model;
}

class Bfloat16NetworkTest : public testing::TestWithParam<Size> {
  void SetUp() override { SKIP_WITHOUT_BFLOAT16_CONVOLUTIONS(); }
};

// Bounds. A value that is written with eight bits is off by 0.11 % (root mean square). Features go through about 25
// writes on their longest way, each followed by a normalisation that keeps relative errors: 25^0.5 x 0.11 % = 0.6 %,
// and twice that is allowed. A correlation is a mean over 64 products, whose errors average out in part. Positions are
// in image pixels: the sum over four iterations of what such errors do to a step of a few pixels.
TEST_P(Bfloat16NetworkTest, FeaturesCorrelationsAndWindowsAgreeWithFloat32) {
#ifdef HOLDFAST_SANITIZED
  if (GetParam().height * GetParam().width > 512 * 384) GTEST_SKIP() << "half a minute; smaller ones read as far";
#endif
  const c10::InferenceMode guard;
  PointModel exact = Trained(), fast = CopyInPrecision(exact, torch::kBFloat16);
  const auto [height, width] = GetParam();
  constexpr int64_t kFrames = 24, kDistinct = 3, kPoints = 32;
  const torch::Tensor clip = Clip(kDistinct, height, width);
  const torch::Tensor map = exact->Encode(clip), rounded = fast->Encode(clip);
  const double rms =
      ((rounded.to(torch::kFloat32) - map).square().mean().sqrt() / map.square().mean().sqrt()).item<double>();

  torch::manual_seed(7);
  const torch::Tensor limit = LastPlaceOfMaps(height, width);
  const torch::Tensor xy = torch::rand({kPoints, 2}) * limit;
  const auto run = [&](PointModel& model, const torch::Tensor& maps) {
    const std::vector<FeaturePyramid> pyramids = BuildPyramids(maps, 4);
    WindowRows rows;
    for (int64_t t = 0; t < kFrames; ++t) rows.frames.push_back(pyramids[static_cast<size_t>(t * kDistinct / kFrames)]);
    rows.start = xy.unsqueeze(1).repeat({1, kFrames, 1});
    rows.feature = SampleFeatures(pyramids.front(), xy);
    return model->Refine({rows}, {4, false}).front();
  };
  const auto correlate = [&](const torch::Tensor& maps) {
    const PyramidCells cells = BuildCells(maps, 4);
    const torch::Tensor start = xy.unsqueeze(1).repeat({1, kDistinct, 1});
    return Correlate(cells, SampleRows(cells, start).unsqueeze(2), start, 3);
  };
  const torch::Tensor want = correlate(map), got = correlate(rounded);
  const double correlation = ((got - want).square().mean().sqrt() / want.square().mean().sqrt()).item<double>();
  const torch::Tensor apart = (run(fast, rounded).positions - run(exact, map).positions).norm(2, {2}) * 8;
  const double mean = apart.mean().item<double>();
  const double most = apart.flatten().quantile(0.95).item<double>();
  std::printf("%4ldx%-4ld features %.4f correlations %.4f positions mean %.3f px, 95 %% %.3f px\n", width, height, rms,
              correlation, mean, most);
  EXPECT_LE(rms, 0.012);
  EXPECT_LE(correlation, 0.012);
  EXPECT_LE(mean, 0.1);
  EXPECT_LE(most, 0.25);
}

INSTANTIATE_TEST_SUITE_P(Sizes, Bfloat16NetworkTest,
                         testing::Values(Size{32, 32}, Size{32, 96}, Size{64, 32}, Size{160, 96}, Size{192, 256},
                                         Size{320, 256}, Size{320, 576}, Size{576, 320}, Size{608, 320}, Size{320, 608},
                                         Size{384, 512}, Size{512, 384}, Size{768, 1024}, Size{1024, 768}, Size{40, 56},
                                         Size{72, 88}),
                         [](const testing::TestParamInfo<Size>& info) {
                           return std::to_string(info.param.width) + "x" + std::to_string(info.param.height);
                         });

class Bfloat16TrainingTest : public ::testing::Test {
  void SetUp() override { SKIP_WITHOUT_BFLOAT16_CONVOLUTIONS(); }
};

// Sides of maps odd at every scale. With random weights gradients are chaotic and rounding turns them round.
TEST_F(Bfloat16TrainingTest, GradientsPointWhereThoseOfFloat32Do) {
  const PointModel exact = Trained(), fast = CopyInPrecision(exact, torch::kBFloat16);
  for (const Size& size : {Size{40, 56}, Size{72, 104}, Size{96, 64}, Size{192, 256}}) {
    const Unrolled want = TrainOnce(exact, size.height, size.width), got = TrainOnce(fast, size.height, size.width);
    const double cosine = torch::cosine_similarity(got.gradient, want.gradient, 0).item<double>();
    std::printf("%ldx%ld cosine of gradients %.4f\n", size.width, size.height, cosine);
    EXPECT_GE(cosine, 0.98);
  }
}

}  // namespace
}  // namespace holdfast
