// SPDX-License-Identifier: Apache-2.0
#include "model/point_model.h"

#include <torch/nn/modules/normalization.h>
#include <torch/types.h>

#include "model/contextual_attention.h"
#include "model/encoder.h"
#include "model/ops/convolution.h"
#include "model/ops/correlation.h"
#include "model/ops/feature_views.h"
#include "model/ops/sampling.h"
#include "model/ops/shape_check.h"
#include "model/refinement.h"
#include "model/update_block.h"

namespace holdfast {

PointModelImpl::PointModelImpl(const ModelOptions& options) : options_(options) {
  fnet_ = register_module("fnet", std::make_shared<EncoderImpl>(options));
  if (options.context_blocks > 0) {
    context_ = register_module("context", std::make_shared<ContextualAttentionImpl>(options));
  }
  delta_block_ = register_module("delta_block", std::make_shared<UpdateBlockImpl>(options));
  const torch::nn::GroupNormOptions norm(1, options.feature_channels);
  norm_weight_ = register_module("norm", torch::nn::GroupNorm(norm))->weight;
}

torch::Tensor PointModelImpl::EncodeBatch(const torch::Tensor& frames) {
  torch::Tensor pictures = frames.to(norm_weight_.device()).permute({0, 3, 1, 2}).to(torch::kFloat32);
  pictures.div_(255.0).mul_(2.0).sub_(1.0);
  const torch::Tensor map = fnet_->forward(pictures.to(norm_weight_.scalar_type()));
  return context_ == nullptr ? map : context_->forward(map);
}

torch::Tensor PointModelImpl::Encode(const torch::Tensor& frames) {
  CheckTensor("frames", frames, {-1, -1, -1, 3}, torch::kUInt8);
  TORCH_CHECK(frames.size(0) > 0 && frames.size(1) >= options_.stride && frames.size(1) % options_.stride == 0 &&
                  frames.size(2) >= options_.stride && frames.size(2) % options_.stride == 0,
              "frames: sides must be multiples of ", options_.stride, ", got ", frames.sizes());
  if (torch::GradMode::is_enabled() || !norm_weight_.device().is_cpu()) return EncodeBatch(frames);
  // One by one on the CPU: the same numbers whatever the batch, memory for one, and better use of the caches.
  std::vector<torch::Tensor> maps;
  for (int64_t f = 0; f < frames.size(0); ++f) maps.push_back(EncodeBatch(frames.narrow(0, f, 1)));
  return maps.size() == 1 ? maps.front() : torch::cat(maps, 0);
}

std::vector<WindowEstimate> PointModelImpl::Refine(const std::vector<WindowRows>& groups,
                                                   const RefineOptions& options) {
  const c10::InferenceMode guard;
  CheckWindows(groups, options_);
  TORCH_CHECK(!options.keep_templates || options.least_step <= 0, "least_step is ", options.least_step,
              ", must be 0 where templates are kept");
  if (groups.empty()) return {};
  Refinement refinement(groups, options_, norm_weight_.device());
  for (int64_t k = 0; k < options.iterations; ++k) {
    if (k > 0 && !refinement.Settle(options.least_step)) break;
    refinement.Advance(delta_block_->forward(refinement.Correlations(), refinement.positions()));
  }
  return refinement.Estimates(options.keep_templates);
}

PointModelImpl::Trajectory PointModelImpl::Unroll(const torch::Tensor& maps, const torch::Tensor& start,
                                                  int64_t iterations) {
  CheckFloating("maps", maps, {-1, options_.feature_channels, -1, -1});
  CheckTensor("start", start, {-1, maps.size(0), 2});
  const PyramidCells window = BuildCells(maps, options_.correlation_levels);
  torch::Tensor positions = start.detach();
  const torch::Tensor locked = positions.narrow(1, 0, 1);
  torch::Tensor sampled = SampleRows(window, positions);
  const torch::Tensor feature = sampled.narrow(1, 0, 1).expand_as(sampled);
  Trajectory result;
  for (int64_t k = 0; k < iterations; ++k) {
    if (k > 0) sampled = SampleRows(window, positions);
    const torch::Tensor templates = k == 0 ? feature.unsqueeze(2) : StackTemplates(feature, sampled);
    const torch::Tensor correlation =
        JoinTemplates(Correlate(window, templates, positions, options_.correlation_radius));
    const torch::Tensor out = delta_block_->forward(correlation, positions);
    result.positions.push_back(positions + out.narrow(2, 0, 2));
    if (options_.visibility_head) result.visibility_logit = out.select(2, 2);
    positions = torch::cat({locked, result.positions.back().detach().narrow(1, 1, positions.size(1) - 1)}, 1);
  }
  return result;
}

int64_t PointModelImpl::ParameterCount() const {
  int64_t count = 0;
  for (const auto& parameter : parameters()) count += parameter.numel();
  return count;
}

void PointModelImpl::PackWeights() { holdfast::PackWeights(*this); }

}  // namespace holdfast
