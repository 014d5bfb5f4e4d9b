// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/evaluator.h"

#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

// A clip whose points all have a query with frames after it.
struct Trial {
  Sample clip;
  std::vector<int64_t> query_frames;  // [N]
};

absl::StatusOr<Trial> MakeTrial(Sample clip) {
  if (absl::Status status = clip.Validate(); !status.ok()) return status;
  Trial trial;
  std::vector<int64_t> kept;
  for (int64_t n = 0; n < clip.num_points(); ++n) {
    const int64_t query = clip.QueryFrame(n);
    if (query < 0 || query + 1 >= clip.num_frames()) continue;
    kept.push_back(n);
    trial.query_frames.push_back(query);
  }
  if (kept.empty()) return absl::FailedPreconditionError("no point is visible before the last frame");
  clip.SelectPoints(kept);
  trial.clip = std::move(clip);
  return trial;
}

// [S, N] object ids under the estimates.
std::vector<int32_t> IdsUnder(const Sample& clip, const std::vector<float>& positions) {
  std::vector<int32_t> ids;
  ids.reserve(positions.size() / 2);
  for (int64_t frame = 0; frame < clip.num_frames(); ++frame) {
    for (int64_t point = 0; point < clip.num_points(); ++point) {
      const size_t at = 2 * clip.At(frame, point);
      const cv::Point2f xy{positions[at], positions[at + 1]};
      ids.push_back(std::isfinite(xy.x) && std::isfinite(xy.y) ? clip.IdAt(frame, xy) : 0);
    }
  }
  return ids;
}

absl::StatusOr<SequenceReport> RunMethod(const Trial& trial, ClipTracker& method, const Clock& clock) {
  const SteadyTime start = clock.SteadyNow();
  absl::StatusOr<ClipEstimate> estimate = method.Track(trial.clip, trial.query_frames);
  if (!estimate.ok()) {
    return absl::Status(estimate.status().code(), absl::StrCat(method.name(), ": ", estimate.status().message()));
  }
  SequenceReport report;
  report.seconds = absl::ToDoubleSeconds(clock.Since(start));
  report.name = trial.clip.source;
  report.frames = trial.clip.num_frames();
  report.points = trial.clip.num_points();
  report.frame_size = trial.clip.size();
  report.processing_size = estimate->processing_size;
  report.iterations = estimate->iterations;
  const ScoredVideo video = ToScoredVideo(trial.clip, trial.query_frames, *std::move(estimate));
  report.metrics = ComputeMetrics(video);
  report.claims = ClaimsOf(video);
  return report;
}

// All methods on one clip: all of them succeed, or the clip is skipped.
absl::StatusOr<std::vector<SequenceReport>> RunMethods(Sample clip, const std::vector<ClipTracker*>& methods,
                                                       const Clock& clock) {
  absl::StatusOr<Trial> trial = MakeTrial(std::move(clip));
  if (!trial.ok()) return trial.status();
  std::vector<SequenceReport> reports;
  for (ClipTracker* method : methods) {
    absl::StatusOr<SequenceReport> report = RunMethod(*trial, *method, clock);
    if (!report.ok()) return report.status();
    reports.push_back(*std::move(report));
  }
  return reports;
}

void Skip(const std::string& name, const absl::Status& reason, std::vector<Report>& reports) {
  for (Report& report : reports) report.skipped.push_back({name, std::string(reason.message())});
}

void RunSequence(const Dataset& dataset, size_t index, const std::vector<ClipTracker*>& methods,
                 const EvaluationOptions& options, const Clock& clock, std::vector<Report>& reports) {
  Rng rng(options.seed, index);
  absl::StatusOr<Sample> clip = dataset.Get(index, rng);
  if (!clip.ok()) return Skip(absl::StrCat("#", index), clip.status(), reports);
  const std::string name = clip->source;
  absl::StatusOr<std::vector<SequenceReport>> rows = RunMethods(*std::move(clip), methods, clock);
  if (!rows.ok()) return Skip(name, rows.status(), reports);
  for (size_t m = 0; m < methods.size(); ++m) reports[m].sequences.push_back(std::move((*rows)[m]));
}

Metrics MeanOf(const std::vector<SequenceReport>& sequences) {
  std::vector<Metrics> metrics;
  metrics.reserve(sequences.size());
  for (const SequenceReport& sequence : sequences) metrics.push_back(sequence.metrics);
  return MeanMetrics(metrics);
}

std::optional<double> MeanIterations(const std::vector<SequenceReport>& sequences) {
  double sum = 0;
  int64_t count = 0;
  for (const SequenceReport& sequence : sequences) {
    if (!sequence.iterations) continue;
    sum += *sequence.iterations;
    ++count;
  }
  return count == 0 ? std::nullopt : std::optional<double>(sum / static_cast<double>(count));
}

std::optional<Reliability> ReliabilityOf(const std::vector<SequenceReport>& sequences) {
  std::vector<Claim> claims;
  for (const SequenceReport& sequence : sequences) {
    claims.insert(claims.end(), sequence.claims.begin(), sequence.claims.end());
  }
  return ComputeReliability(claims);
}

}  // namespace

ScoredVideo ToScoredVideo(const Sample& clip, const std::vector<int64_t>& query_frames, ClipEstimate estimate) {
  ScoredVideo video;
  video.frame_size = clip.size();
  video.frames = clip.num_frames();
  video.points = clip.num_points();
  video.query_frames = query_frames;
  video.truth = clip.tracks;
  video.valid = clip.valid;
  video.true_visible = clip.visible;
  video.hidden = clip.hidden;
  if (clip.has_masks()) {
    video.object_ids = clip.object_ids;
    video.estimate_ids = IdsUnder(clip, estimate.positions);
  }
  video.estimate = std::move(estimate.positions);
  video.visible = std::move(estimate.visible);
  video.confidence = std::move(estimate.confidence);
  return video;
}

absl::StatusOr<std::vector<Report>> Evaluate(const Dataset& dataset, const std::vector<ClipTracker*>& methods,
                                             const EvaluationOptions& options, const Clock& clock) {
  if (methods.empty() || dataset.size() == 0) return absl::FailedPreconditionError("nothing to evaluate");
  std::vector<Report> reports(methods.size());
  for (size_t m = 0; m < methods.size(); ++m) reports[m].method = methods[m]->name();
  for (size_t index = 0; index < dataset.size(); ++index) {
    if (options.progress) options.progress(index, dataset.size());
    RunSequence(dataset, index, methods, options, clock, reports);
  }
  if (reports[0].sequences.empty()) {
    const SkippedSequence& first = reports[0].skipped.front();
    return absl::FailedPreconditionError(
        absl::StrCat("all of the ", dataset.size(), " sequences failed; the first, ", first.name, ": ", first.reason));
  }
  for (Report& report : reports) {
    report.mean = MeanOf(report.sequences);
    report.iterations = MeanIterations(report.sequences);
    report.reliability = ReliabilityOf(report.sequences);
  }
  return reports;
}

}  // namespace holdfast
