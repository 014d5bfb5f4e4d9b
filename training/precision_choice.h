// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "model/point_model.h"
#include "training/recipe.h"

namespace holdfast {

// Why the network should not run in bfloat16 where 'model' lies, for clips of these phases: it is not faster there, or
// it gives other results than float32 at one of the sizes. Nothing: it may.
std::optional<std::string> WhyNotBfloat16(const PointModel& model, const std::vector<Phase>& phases);

// As above, with another network in place of model's rounded copy; for tests.
std::optional<std::string> WhyNotRun(const PointModel& fast, const PointModel& model, const std::vector<Phase>& phases);

}  // namespace holdfast
