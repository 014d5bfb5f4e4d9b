// SPDX-License-Identifier: Apache-2.0
#include "training/loss/clip_step.h"

#include <algorithm>
#include <limits>

namespace holdfast {
namespace {

double ValueOf(const torch::Tensor& part) {
  return part.defined() ? part.item<double>() : std::numeric_limits<double>::quiet_NaN();
}

// Each distinct frame is encoded once; a repeated tail shares its map, and the gradients add up there.
torch::Tensor EncodeWindow(PointModelImpl& network, const torch::Tensor& frames, int64_t distinct) {
  const int64_t all = frames.size(0);
  const torch::Tensor maps = network.Encode(frames.narrow(0, 0, distinct));
  if (distinct == all) return maps;
  return maps.index_select(0, TailIndex(all, distinct, frames.device()));
}

}  // namespace

ClipStepResult AddClipGradient(PointModelImpl& network, const ClipTensors& clip, const ClipStepOptions& options,
                               Rng& rng, const Clock& clock) {
  const int64_t stride = network.options().stride;
  const int64_t larger_side = std::max(clip.frames.size(1), clip.frames.size(2));
  const ClipWindowPlan plan = PlanWindow(clip.targets, larger_side, options.window, rng);
  const ClipTargets targets =
      plan.distinct_frames == clip.frames.size(0) ? clip.targets : RepeatTail(clip.targets, plan.distinct_frames);
  const SteadyTime begin = clock.SteadyNow();
  Prediction prediction;
  prediction.stride = stride;
  prediction.maps = EncodeWindow(network, clip.frames, plan.distinct_frames);
  const SteadyTime encoded = clock.SteadyNow();
  const auto trajectory = network.Unroll(prediction.maps, plan.start / static_cast<double>(stride), options.iterations);
  for (const torch::Tensor& xy : trajectory.positions) {
    prediction.positions.push_back(xy * static_cast<double>(stride));
  }
  prediction.visibility_logit = trajectory.visibility_logit;
  const LossParts parts = ClipLoss(prediction, targets, options.loss);
  const SteadyTime refined = clock.SteadyNow();
  parts.total.backward();
  ClipStepResult result = {parts.Map(ValueOf), {}};
  result.times.encode = Between(begin, encoded);
  result.times.refine = Between(encoded, refined);
  result.times.backward = clock.Since(refined);
  return result;
}

}  // namespace holdfast
