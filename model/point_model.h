// SPDX-License-Identifier: Apache-2.0
// The network: encoder + contextual attention give one feature map a frame; refinement moves points through a window of
// frames by iterated local correlation and a temporal update block. Letters and conventions: model/README.md.
#pragma once

#include <torch/nn/module.h>
#include <torch/nn/pimpl.h>
#include <torch/types.h>

#include <memory>
#include <vector>

#include "model/ops/feature_pyramid.h"
#include "model/options.h"

namespace holdfast {

// Only declared: LibTorch's layers take longer to compile than all that uses this header.
class ContextualAttentionImpl;
class EncoderImpl;
class UpdateBlockImpl;

// Rows that share one window: N points on the same S frames. Positions are feature pixels (image pixels / stride).
struct WindowRows {
  std::vector<FeaturePyramid> frames;  // S pyramids of one size; the same pyramid may stand several times
  torch::Tensor start;                 // [N, S, 2] float32, initial positions (x, y); frame 0 stays where it is
  torch::Tensor feature;               // [N, C] float32, f1: the template sampled at the query
  // Templates of the first iteration, [N, S, C] each. Undefined: f1 at every frame. Defined when a run is to reproduce
  // the published script, which carries them from the window before.
  torch::Tensor carried_f2;
  torch::Tensor carried_f4;
};

// Result of a window for the rows of one WindowRows, float32 on the model's device.
struct WindowEstimate {
  torch::Tensor positions;         // [N, S, 2] feature pixels after the last iteration
  torch::Tensor visibility_logit;  // [N, S]; undefined without a visibility head
  torch::Tensor similarity;        // [N, S] cosine of f1 and the feature at the estimate
  torch::Tensor last_step;         // [N, S] feature pixels moved in the last iteration of the row
  torch::Tensor iterations;        // [N] int64, those of the row
  torch::Tensor f2;                // [N, S, C] templates of the last iteration; only with keep_templates
  torch::Tensor f4;
};

struct RefineOptions {
  int64_t iterations = 6;  // at most
  bool keep_templates = false;
  // A row ends after an iteration that moved it by less than this many feature pixels on every frame. 0: no row ends
  // early. REQUIRES: 0 with keep_templates.
  double least_step = 0;
};

// Thread-compatible: concurrent const calls are safe once the parameters no longer change.
class PointModelImpl : public torch::nn::Module {
 public:
  // REQUIRES: options.Validate() is OK.
  explicit PointModelImpl(const ModelOptions& options);

  const ModelOptions& options() const { return options_; }

  // frames [F, H, W, 3] uint8 RGB, H and W multiples of 8 -> [F, C, H/8, W/8] in channels-last memory, the dtype of the
  // parameters. Includes the contextual attention. Differentiable with respect to the parameters.
  torch::Tensor Encode(const torch::Tensor& frames);

  // Inference only (no gradient). All groups run as one batch; no row sees another.
  std::vector<WindowEstimate> Refine(const std::vector<WindowRows>& groups, const RefineOptions& options);

  // Training: one clip. maps [S, C, H8, W8] with gradient, start [N, S, 2] feature pixels, query feature sampled from
  // frame 0 at start[:, 0] -> positions after each iteration, K x [N, S, 2] feature pixels, not locked at frame 0 (the
  // losses want what the network said), and the visibility logits of the last iteration [N, S] (undefined without).
  struct Trajectory {
    std::vector<torch::Tensor> positions;
    torch::Tensor visibility_logit;
  };
  Trajectory Unroll(const torch::Tensor& maps, const torch::Tensor& start, int64_t iterations);

  int64_t ParameterCount() const;

  // For inference: keeps weights as the kernels read them too, until they change. Not while anybody infers.
  void PackWeights();

 private:
  torch::Tensor EncodeBatch(const torch::Tensor& frames);

  ModelOptions options_;
  std::shared_ptr<EncoderImpl> fnet_;
  std::shared_ptr<ContextualAttentionImpl> context_;  // null when options.context_blocks == 0
  std::shared_ptr<UpdateBlockImpl> delta_block_;
  torch::Tensor norm_weight_;  // of a norm in the published checkpoint that is never applied
};
TORCH_MODULE(PointModel);

}  // namespace holdfast
