// SPDX-License-Identifier: Apache-2.0
// From what positions, and on what kind of window, a training clip starts.
#pragma once

#include <torch/types.h>

#include "training/data/rng.h"
#include "training/loss/clip_targets.h"

namespace holdfast {

struct ClipWindowOptions {
  double noisy_start = 0.5;      // probability of a start between noise and truth
  double streaming_windows = 0;  // probability of a window as the engine has them
  double chain_start = 0;        // probability that optical flow carries the points where they would else stand still
};

struct ClipWindowPlan {
  torch::Tensor start;          // [N, S, 2] float32 image pixels; frame 0 is the query, exactly
  int64_t distinct_frames = 0;  // from here on the window repeats frame distinct_frames - 1; S: it does not
};

// Draws a plan for a clip: zero velocity, noise mixed with the truth, or, as in serving, a tail that repeats the newest
// frame and a start that continues an earlier window's result. Where the points' positions are not known, the start
// repeats the last known one or goes on by a chain of optical flow. REQUIRES: S >= 2.
ClipWindowPlan PlanWindow(const ClipTargets& targets, int64_t larger_side, const ClipWindowOptions& options, Rng& rng);

// The query repeated.
torch::Tensor ZeroVelocity(const torch::Tensor& tracks);
// c * truth + (1 - c) * noise with a coefficient c per point; noise drifts and jitters around the query.
torch::Tensor NoisyStart(const ClipTargets& targets, int64_t larger_side, Rng& rng);
// Nearly the truth for 'known' frames, then the last of them repeated.
torch::Tensor ContinuedStart(const ClipTargets& targets, int64_t known, Rng& rng);
// 'start' for 'known' >= 1 frames; from there on what the motion prior makes of it: a chain that follows the truth
// frame by frame with a slow drift, until it fails, most likely where the point is hidden. A chain that failed stands
// still or goes on with something else.
torch::Tensor ChainedStart(const torch::Tensor& start, const ClipTargets& targets, int64_t known, int64_t larger_side,
                           Rng& rng);
// The clip's ground truth when its frames from 'distinct' on are replaced by frame distinct - 1.
ClipTargets RepeatTail(const ClipTargets& targets, int64_t distinct);
// [0, 1, .., distinct - 1, distinct - 1, ..], 'frames' numbers.
torch::Tensor TailIndex(int64_t frames, int64_t distinct, const torch::Device& device);

}  // namespace holdfast
