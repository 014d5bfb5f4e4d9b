// SPDX-License-Identifier: Apache-2.0
#include "tests/support/golden.h"

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>
#include <limits>
#include <sstream>

#include "model/checkpoint/safetensors.h"
#include "tests/support/source_tree.h"

namespace holdfast {
namespace {

uint64_t Fnv1a64(const std::string& text) {
  uint64_t hash = 0xcbf29ce484222325u;
  for (const char c : text) hash = (hash ^ static_cast<uint8_t>(c)) * 0x100000001b3u;
  return hash;
}

// Uniform in [-1, 1).
double Uniform(uint64_t seed, int64_t index) {
  uint64_t z = seed + static_cast<uint64_t>(index + 1) * 0x9E3779B97F4A7C15u;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
  z ^= z >> 31;
  return static_cast<double>(z >> 40) / 16777216.0 * 2 - 1;
}

bool StartsWith(const std::string& text, const std::string& prefix) { return text.rfind(prefix, 0) == 0; }

// Whether 'name' ends in ".weight" and the component before begins with "norm".
bool IsNormWeight(const std::string& name) {
  const std::string suffix = ".weight";
  if (name.size() < suffix.size() || name.substr(name.size() - suffix.size()) != suffix) return false;
  const std::string path = name.substr(0, name.size() - suffix.size());
  const size_t dot = path.rfind('.');
  return StartsWith(dot == std::string::npos ? path : path.substr(dot + 1), "norm");
}

torch::Tensor FormulaValue(const std::string& name, torch::IntArrayRef shape) {
  const torch::Tensor result = torch::empty(shape, torch::kFloat32);
  double scale = 0.05;
  if (shape.size() > 1) {
    const double gain = StartsWith(name, "delta_block.dense") ? 0.05 : 6.0;
    scale = std::sqrt(gain / static_cast<double>(result.numel() / shape[0]));
  }
  const double offset = shape.size() == 1 && IsNormWeight(name) ? 1 : 0;
  const uint64_t seed = Fnv1a64(name);
  auto* data = result.data_ptr<float>();
  for (int64_t i = 0; i < result.numel(); ++i) data[i] = static_cast<float>(offset + scale * Uniform(seed, i));
  return result;
}

}  // namespace

TensorMap ReadGolden(const std::string& name) {
  auto file = ReadSafetensors(InSourceTree(absl::StrCat("tests/data/", name)));
  EXPECT_TRUE(file.ok()) << file.status();
  return file.ok() ? std::move(file->tensors) : TensorMap();
}

void FillByFormula(torch::nn::Module& module, const std::string& prefix) {
  const torch::NoGradGuard no_grad;
  for (auto& parameter : module.named_parameters()) {
    parameter.value().copy_(FormulaValue(prefix + parameter.key(), parameter.value().sizes()));
  }
}

PointModel FormulaModel(const ModelOptions& options) {
  PointModel model(options);
  FillByFormula(*model);
  model->eval();
  return model;
}

ModelOptions PublishedOptions() {
  ModelOptions options;
  options.context_blocks = 0;
  return options;
}

Difference Measure(const std::string& name, const torch::Tensor& got, const torch::Tensor& want) {
  Difference result{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  if (got.sizes() == want.sizes()) {
    const torch::Tensor difference = (got.to(torch::kDouble) - want.to(torch::kDouble)).abs();
    result = {difference.max().item<double>(), difference.mean().item<double>()};
  }
  std::ostringstream text;
  text << "max " << result.max << " mean " << result.mean;
  std::cout << "[ golden   ] " << name << ": " << text.str() << std::endl;
  testing::Test::RecordProperty(name, text.str());
  return result;
}

}  // namespace holdfast
