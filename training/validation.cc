// SPDX-License-Identifier: Apache-2.0
#include "training/validation.h"

#include <torch/utils.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "training/loss/clip_targets.h"
#include "training/loss/window_plan.h"

namespace holdfast {
namespace {

// tensor [N, S, ...] -> vector in the order [S, N, ...]
template <typename T>
std::vector<T> FrameMajor(const torch::Tensor& tensor) {
  const torch::Tensor ordered = tensor.transpose(0, 1).cpu().contiguous();
  const T* data = ordered.data_ptr<T>();
  return std::vector<T>(data, data + ordered.numel());
}

ScoredVideo Score(PointModelImpl& network, const Sample& sample, const ClipTensors& clip, int64_t iterations) {
  const double stride = static_cast<double>(network.options().stride);
  const torch::Tensor start = ZeroVelocity(clip.targets.tracks);
  const auto trajectory = network.Unroll(network.Encode(clip.frames), start / stride, iterations);
  ScoredVideo video;
  video.frame_size = sample.size();
  video.frames = sample.num_frames();
  video.points = sample.num_points();
  video.query_frames.assign(sample.object_ids.size(), 0);
  video.truth = sample.tracks;
  video.valid = sample.valid;
  video.true_visible = sample.visible;
  video.estimate = FrameMajor<float>(trajectory.positions.back().to(torch::kFloat32) * stride);
  if (trajectory.visibility_logit.defined()) {
    video.visible = FrameMajor<uint8_t>((trajectory.visibility_logit > 0).to(torch::kUInt8));
  }
  return video;
}

}  // namespace

absl::StatusOr<Validation> Validation::Create(const Dataset& dataset, int64_t clips, uint64_t seed,
                                              int64_t iterations) {
  constexpr int kMaxFailures = 100;  // in a row; a data set may have no end
  std::vector<Sample> samples;
  int failures = 0;
  absl::Status last = absl::FailedPreconditionError("the validation set is empty");
  const auto wants_more = [&] { return static_cast<int64_t>(samples.size()) < clips && failures < kMaxFailures; };
  for (size_t i = 0; i < dataset.size() && wants_more(); ++i) {
    ++failures;
    Rng rng(seed, i);
    absl::StatusOr<Sample> sample = dataset.Get(i, rng);
    if (sample.ok() && sample->num_points() > 0) {
      samples.push_back(*std::move(sample));
      failures = 0;
    } else if (!sample.ok()) {
      last = sample.status();
    }
  }
  if (samples.empty()) return last;
  return Validation(std::move(samples), iterations);
}

absl::StatusOr<Metrics> Validation::Run(PointModelImpl& network, const torch::Device& device) const {
  torch::NoGradGuard no_grad;
  std::vector<Metrics> metrics;
  for (const Sample& sample : clips_) {
    const absl::StatusOr<ClipTensors> clip = ToTensors(sample, network.options().stride);
    if (!clip.ok()) return clip.status();
    metrics.push_back(ComputeMetrics(Score(network, sample, clip->To(device), iterations_)));
  }
  return MeanMetrics(metrics);
}

}  // namespace holdfast
