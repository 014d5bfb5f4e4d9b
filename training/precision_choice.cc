// SPDX-License-Identifier: Apache-2.0
#include "training/precision_choice.h"

#include "absl/strings/str_cat.h"
#include "model/precision.h"
#include "model/precision_check.h"

namespace holdfast {

std::optional<std::string> WhyNotRun(const PointModel& fast, const PointModel& model,
                                     const std::vector<Phase>& phases) {
  for (const Phase& phase : phases) {
    const PrecisionDifference difference = ComparePrecisions(model, fast, CheckPicture(phase.height, phase.width));
    if (difference.within()) continue;
    return absl::StrCat("bfloat16 gives other results at ", phase.width, "x", phase.height, ": ", ToString(difference));
  }
  return std::nullopt;
}

std::optional<std::string> WhyNotBfloat16(const PointModel& model, const std::vector<Phase>& phases) {
  if (!ComputesBFloat16Faster(model->parameters().front().device())) return "bfloat16 is not faster on this device";
  return WhyNotRun(CopyInPrecision(model, torch::kBFloat16), model, phases);
}

}  // namespace holdfast
