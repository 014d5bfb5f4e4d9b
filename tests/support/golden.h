// SPDX-License-Identifier: Apache-2.0
// Golden vectors of tests/data and the weights they were made with, which are a formula of the parameter's name.
#pragma once

#include <torch/nn/module.h>
#include <torch/types.h>

#include <map>
#include <string>

#include "model/point_model.h"

namespace holdfast {

using TensorMap = std::map<std::string, torch::Tensor>;

// A file of tests/data; fails the test when it cannot be read.
TensorMap ReadGolden(const std::string& name);

// Gives every parameter the value that the formula has for its name.
void FillByFormula(torch::nn::Module& module, const std::string& prefix = "");

// A model in eval mode with formula weights.
PointModel FormulaModel(const ModelOptions& options);

// Options of the published network: no attention, no visibility head.
ModelOptions PublishedOptions();

struct Difference {
  double max = 0;
  double mean = 0;
};
// Of absolute differences; infinite when shapes differ. Printed and recorded as the property 'name' of the test.
Difference Measure(const std::string& name, const torch::Tensor& got, const torch::Tensor& want);

}  // namespace holdfast
