// SPDX-License-Identifier: Apache-2.0
// What the machine gives at best: the libraries' own convolutions and matrix products in shapes of the network's kind,
// and memory. A ceiling is the best of its kind over all shapes.
#include <ATen/Parallel.h>
#include <torch/types.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "tests/benchmark/bench_case.h"

namespace holdfast {
namespace {

struct ConvolutionCase {
  const char* like;
  int64_t in_channels, out_channels, height, width, batch;
  int64_t kernel_height, kernel_width;
};

constexpr ConvolutionCase kConvolutions[] = {
    {"first_layer", 64, 64, 96, 128, 1, 3, 3},   {"last_layer", 128, 128, 48, 64, 1, 3, 3},
    {"wide_layer", 416, 256, 48, 64, 1, 3, 3},   {"small_layer", 64, 64, 48, 64, 1, 3, 3},
    {"early_update", 256, 256, 1, 24, 64, 1, 3}, {"late_update", 1024, 1024, 1, 24, 16, 1, 3},
};

struct MatmulCase {
  int64_t rows, inner, columns;
};

constexpr MatmulCase kMatmuls[] = {{3072, 128, 512}, {3072, 512, 512}, {1536, 1024, 1024}, {384, 3072, 1024}};

CaseName NameOfCeiling(const char* stage, std::string shape, const NumberType& precision, int threads) {
  CaseName name;
  name.stage = absl::StrCat("ceiling.", stage);
  name.precision = precision.name;
  name.size = std::move(shape);
  name.threads = threads;
  return name;
}

void RegisterConvolution(const ConvolutionCase& c, const NumberType& precision, int threads) {
  const torch::ScalarType type = precision.type;
  const Work work{
      Operations({c.in_channels, c.out_channels, c.kernel_height * c.kernel_width, c.batch * c.height * c.width}), 0};
  RegisterCase(
      {NameOfCeiling("convolution", c.like, precision, threads), work, [c, type] {
         const auto layout = torch::MemoryFormat::ChannelsLast;
         const torch::Tensor x = torch::randn({c.batch, c.in_channels, c.height, c.width}).to(type).contiguous(layout);
         const torch::Tensor weight =
             torch::randn({c.out_channels, c.in_channels, c.kernel_height, c.kernel_width}).to(type).contiguous(layout);
         const std::vector<int64_t> padding = {c.kernel_height / 2, c.kernel_width / 2};
         return [=] { at::mkldnn_convolution(x, weight, {}, padding, {1, 1}, {1, 1}, 1); };
       }});
}

// As oneDNN's inner product and as whatever at::matmul chooses: a BLAS in float32.
void RegisterMatmul(const MatmulCase& c, const NumberType& precision, int threads) {
  const torch::ScalarType type = precision.type;
  const std::string shape = absl::StrCat(c.rows, "x", c.inner, "x", c.columns);
  const Work work{Operations({c.inner, c.columns, 1, c.rows}), 0};
  RegisterCase({NameOfCeiling("matmul", absl::StrCat("onednn.", shape), precision, threads), work, [c, type] {
                  const torch::Tensor x = torch::randn({c.rows, c.inner}).to(type).to_mkldnn();
                  const torch::Tensor weight = torch::randn({c.columns, c.inner}).to(type).to_mkldnn();
                  return [=] { at::mkldnn_linear(x, weight); };
                }});
  RegisterCase({NameOfCeiling("matmul", absl::StrCat("aten.", shape), precision, threads), work, [c, type] {
                  const torch::Tensor x = torch::randn({c.rows, c.inner}).to(type);
                  const torch::Tensor weight = torch::randn({c.inner, c.columns}).to(type);
                  return [=] { at::matmul(x, weight); };
                }});
}

// a = b + s c over arrays far larger than caches; the lines of 'a' that are read before they are written not counted.
void RegisterTriad(int threads) {
  constexpr int64_t kValues = int64_t{1} << 25;  // 128 MiB an array
  const Work work{0, 3.0 * sizeof(float) * kValues};
  RegisterCase({NameOfCeiling("memory", "triad", {"-", torch::kFloat32}, threads), work, [] {
                  const torch::Tensor a = torch::zeros({kValues});
                  const torch::Tensor b = torch::ones({kValues});
                  const torch::Tensor c = torch::ones({kValues});
                  return [=] {
                    float* const to = a.data_ptr<float>();
                    const float* const first = b.data_ptr<float>();
                    const float* const second = c.data_ptr<float>();
                    at::parallel_for(0, kValues, 1 << 16, [=](int64_t begin, int64_t end) {
                      for (int64_t i = begin; i < end; ++i) to[i] = first[i] + 3.0F * second[i];
                    });
                  };
                }});
}

}  // namespace

void RegisterCeilings(const BenchGrid& grid) {
  for (const int threads : grid.threads) {
    for (const NumberType& precision : grid.precisions) {
      for (const ConvolutionCase& c : kConvolutions) RegisterConvolution(c, precision, threads);
      for (const MatmulCase& c : kMatmuls) RegisterMatmul(c, precision, threads);
    }
    RegisterTriad(threads);
  }
}

}  // namespace holdfast
