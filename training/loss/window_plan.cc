// SPDX-License-Identifier: Apache-2.0
#include "training/loss/window_plan.h"

#include <cmath>
#include <functional>
#include <tuple>

namespace holdfast {
namespace {

constexpr double kDriftShare = 0.1;    // deviation of the noise's drift over a window, of the frame's larger side
constexpr double kJitterPx = 2;        // deviation of the noise from frame to frame
constexpr double kContinuationPx = 1;  // deviation of an earlier window's result from the truth

// Chains of optical flow, as they were seen to go wrong on real videos.
constexpr double kLeastDriftPx = 0.02, kMostDriftPx = 1;  // deviation of a chain's drift in a frame; one for each point
constexpr double kFailVisible = 0.02, kFailHidden = 0.3;  // probability that a chain fails in a frame
constexpr double kCarriedShare = 0.5;                     // of the failed chains go on with something else
constexpr double kCarriedSpeed = 0.01;                    // deviation of its speed in a frame, of the larger side

torch::Tensor Draw(torch::IntArrayRef shape, const torch::Tensor& like, const std::function<double()>& draw) {
  torch::Tensor values = torch::empty(shape);
  float* value = values.data_ptr<float>();
  for (int64_t i = 0; i < values.numel(); ++i) value[i] = static_cast<float>(draw());
  return values.to(like.device());
}

torch::Tensor Normal(torch::IntArrayRef shape, const torch::Tensor& like, Rng& rng) {
  return Draw(shape, like, [&] { return rng.Normal(); });
}

// The truth where it is known, else the last position known before: the query's, in frame 0, always is.
torch::Tensor KnownTracks(const ClipTargets& targets) {
  const torch::Tensor& tracks = targets.tracks;
  const torch::Tensor frame = torch::arange(tracks.size(1), torch::TensorOptions(torch::kLong).device(tracks.device()));
  const torch::Tensor known = std::get<0>((targets.valid * frame).cummax(1));  // [N, S]
  return tracks.gather(1, known.unsqueeze(-1).expand_as(tracks));
}

torch::Tensor WithQuery(const torch::Tensor& start, const torch::Tensor& tracks) {
  return torch::cat({tracks.narrow(1, 0, 1), start.narrow(1, 1, start.size(1) - 1)}, 1);
}

}  // namespace

torch::Tensor ZeroVelocity(const torch::Tensor& tracks) { return tracks.narrow(1, 0, 1).expand_as(tracks); }

torch::Tensor NoisyStart(const ClipTargets& targets, int64_t larger_side, Rng& rng) {
  const torch::Tensor& tracks = targets.tracks;
  const int64_t n = tracks.size(0), s = tracks.size(1);
  const torch::Tensor time = torch::linspace(0, 1, s, tracks.options()).view({1, s, 1});
  const torch::Tensor drift = Normal({n, 1, 2}, tracks, rng) * (kDriftShare * static_cast<double>(larger_side));
  const torch::Tensor noise = ZeroVelocity(tracks) + drift * time + Normal({n, s, 2}, tracks, rng) * kJitterPx;
  const torch::Tensor share = Draw({n, 1, 1}, tracks, [&] { return rng.Uniform(); });
  return WithQuery(share * KnownTracks(targets) + (1 - share) * noise, tracks);
}

torch::Tensor ContinuedStart(const ClipTargets& targets, int64_t known, Rng& rng) {
  const torch::Tensor& tracks = targets.tracks;
  const torch::Tensor near = KnownTracks(targets) + Normal(tracks.sizes(), tracks, rng) * kContinuationPx;
  return WithQuery(near.index_select(1, TailIndex(tracks.size(1), known, tracks.device())), tracks);
}

torch::Tensor ChainedStart(const torch::Tensor& start, const ClipTargets& targets, int64_t known, int64_t larger_side,
                           Rng& rng) {
  const int64_t n = start.size(0), left = start.size(1) - known;
  if (left == 0) return start;
  const auto later = [&](const torch::Tensor& x) { return x.narrow(1, known, left); };
  const auto before = [&](const torch::Tensor& x) { return x.narrow(1, known - 1, left); };
  const torch::Tensor both_valid = later(targets.valid) & before(targets.valid);
  const torch::Tensor step = (later(targets.tracks) - before(targets.tracks)).masked_fill(~both_valid.unsqueeze(-1), 0);
  const torch::Tensor hazard =  // [N, left]
      torch::where(later(targets.visible), torch::full_like(step.select(2, 0), kFailVisible),
                   torch::full_like(step.select(2, 0), kFailHidden));
  const torch::Tensor lucky = Draw({n, left}, start, [&] { return rng.Uniform(); }) >= hazard;
  const torch::Tensor follows = lucky.to(step.scalar_type()).cumprod(1).unsqueeze(-1);
  const torch::Tensor drift =
      Draw({n, 1, 1}, start, [&] { return kLeastDriftPx * std::pow(kMostDriftPx / kLeastDriftPx, rng.Uniform()); });
  const torch::Tensor carried = Draw({n, 1, 1}, start, [&] { return rng.Chance(kCarriedShare) ? 1.0 : 0.0; });
  const torch::Tensor velocity =
      carried * Normal({n, 1, 2}, start, rng) * (kCarriedSpeed * static_cast<double>(larger_side));
  const torch::Tensor moved = follows * (step + drift * Normal({n, left, 2}, start, rng)) + (1 - follows) * velocity;
  return torch::cat({start.narrow(1, 0, known), start.narrow(1, known - 1, 1) + moved.cumsum(1)}, 1);
}

torch::Tensor TailIndex(int64_t frames, int64_t distinct, const torch::Device& device) {
  return torch::arange(frames, torch::TensorOptions(torch::kLong).device(device)).clamp_max(distinct - 1);
}

ClipTargets RepeatTail(const ClipTargets& targets, int64_t distinct) {
  const torch::Tensor index = TailIndex(targets.tracks.size(1), distinct, targets.tracks.device());
  ClipTargets out = {targets.tracks.index_select(1, index),
                     targets.visible.index_select(1, index),
                     targets.valid.index_select(1, index),
                     {}};
  if (targets.masks.defined()) out.masks = targets.masks.index_select(0, index);
  return out;
}

ClipWindowPlan PlanWindow(const ClipTargets& targets, int64_t larger_side, const ClipWindowOptions& options, Rng& rng) {
  const int64_t frames = targets.tracks.size(1);
  // Of a start that is known for its first frames only.
  const auto go_on = [&](const torch::Tensor& start, int64_t known) {
    return rng.Chance(options.chain_start) ? ChainedStart(start, targets, known, larger_side, rng) : start;
  };
  if (!rng.Chance(options.streaming_windows)) {
    const bool noisy = rng.Chance(options.noisy_start);
    return {noisy ? NoisyStart(targets, larger_side, rng) : go_on(ZeroVelocity(targets.tracks), 1), frames};
  }
  ClipWindowPlan plan;
  const bool early = rng.Chance(0.5);  // fewer frames have come than a window holds
  plan.distinct_frames = early ? rng.Integer(2, frames) : frames;
  const bool continued = !early || rng.Chance(0.5);
  const int64_t known = continued ? rng.Integer(1, plan.distinct_frames - 1) : 1;
  plan.start = go_on(continued ? ContinuedStart(targets, known, rng) : ZeroVelocity(targets.tracks), known);
  if (plan.distinct_frames < frames) {  // the tail repeats the newest frame, and so does its start
    plan.start = plan.start.index_select(1, TailIndex(frames, plan.distinct_frames, plan.start.device()));
  }
  return plan;
}

}  // namespace holdfast
