// SPDX-License-Identifier: Apache-2.0
#include "training/window_plan.h"

#include <functional>

namespace holdfast {
namespace {

constexpr double kDriftShare = 0.1;    // deviation of the noise's drift over a window, of the frame's larger side
constexpr double kJitterPx = 2;        // deviation of the noise from frame to frame
constexpr double kContinuationPx = 1;  // deviation of an earlier window's result from the truth

torch::Tensor Draw(torch::IntArrayRef shape, const torch::Tensor& like, const std::function<double()>& draw) {
  torch::Tensor values = torch::empty(shape);
  float* value = values.data_ptr<float>();
  for (int64_t i = 0; i < values.numel(); ++i) value[i] = static_cast<float>(draw());
  return values.to(like.device());
}

torch::Tensor Normal(torch::IntArrayRef shape, const torch::Tensor& like, Rng& rng) {
  return Draw(shape, like, [&] { return rng.Normal(); });
}

// The truth where it is known, else the query.
torch::Tensor KnownTracks(const ClipTargets& targets) {
  return torch::where(targets.valid.unsqueeze(-1), targets.tracks, ZeroVelocity(targets.tracks));
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
  if (!rng.Chance(options.streaming_windows)) {
    const bool noisy = rng.Chance(options.noisy_start);
    return {noisy ? NoisyStart(targets, larger_side, rng) : ZeroVelocity(targets.tracks), frames};
  }
  ClipWindowPlan plan;
  const bool early = rng.Chance(0.5);  // fewer frames have come than a window holds
  plan.distinct_frames = early ? rng.Integer(2, frames) : frames;
  const bool continued = !early || rng.Chance(0.5);
  const int64_t known = rng.Integer(1, plan.distinct_frames - 1);
  plan.start = continued ? ContinuedStart(targets, known, rng) : ZeroVelocity(targets.tracks);
  return plan;
}

}  // namespace holdfast
