// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/metrics.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

namespace holdfast {
namespace {

constexpr double kScoredSide = 256;  // pixels
constexpr std::array<double, 5> kThresholds = {1, 2, 4, 8, 16};

// One frame of one track, after its query, of which there is some truth.
struct Pair {
  int64_t frames_since_query = 0;
  bool placed = false;  // it is known where the point is
  double error = 0;     // pixels of a 256x256 frame
  bool truly_visible = false;
  bool visible = false;   // as estimated
  bool has_mask = false;  // it is known what the point and its estimate lie on
  bool strayed = false;   // on different objects
};
using Track = std::vector<Pair>;  // in the order of time

Track CollectTrack(const ScoredVideo& video, int64_t point) {
  Track track;
  const int64_t query = video.query_frames[point];
  for (int64_t frame = query + 1; frame < video.frames; ++frame) {
    const int64_t index = video.Index(frame, point);
    const bool placed = video.valid[index] != 0;
    if (!placed && (video.hidden.empty() || video.hidden[index] == 0)) continue;
    Pair pair{frame - query, placed, ScoredError(video, index), video.true_visible[index] != 0,
              !video.visible.empty() && video.visible[index] != 0};
    pair.has_mask = !video.estimate_ids.empty() && video.object_ids[point] != 0;
    pair.strayed = pair.has_mask && video.estimate_ids[index] != video.object_ids[point];
    track.push_back(pair);
  }
  return track;
}

Track Placed(const Track& track) {
  Track placed;
  std::copy_if(track.begin(), track.end(), std::back_inserter(placed), [](const Pair& pair) { return pair.placed; });
  return placed;
}

// Percentage of the pairs that 'selects' takes whose error is below a threshold, mean over the thresholds.
template <typename Selects>
std::optional<double> DeltaAverage(const std::vector<Track>& tracks, Selects selects) {
  int64_t pairs = 0;
  int64_t close = 0;  // summed over thresholds
  for (const Track& track : tracks) {
    for (const Pair& pair : track) {
      if (!selects(pair)) continue;
      ++pairs;
      close += std::count_if(kThresholds.begin(), kThresholds.end(), [&](double t) { return pair.error < t; });
    }
  }
  if (pairs == 0) return std::nullopt;
  return 100.0 * close / (pairs * static_cast<double>(kThresholds.size()));
}

// Percentage of the frames after the query that pass before the error first exceeds 'limit_px'.
double SurvivalOf(const Track& track, int64_t frames_after_query, double limit_px) {
  const auto failure = std::find_if(track.begin(), track.end(), [&](const Pair& p) { return p.error > limit_px; });
  if (failure == track.end()) return 100;
  return 100.0 * (failure->frames_since_query - 1) / frames_after_query;
}

double MedianError(const Track& track) {
  std::vector<double> errors;
  for (const Pair& pair : track) errors.push_back(pair.error);
  std::sort(errors.begin(), errors.end());
  const size_t middle = errors.size() / 2;
  return errors.size() % 2 == 1 ? errors[middle] : (errors[middle - 1] + errors[middle]) / 2;
}

// Share of the estimated or true "visible" that is both and close, as TAP-Vid counts it: a visible estimate that is too
// far off is a false positive and its visible truth a miss. Empty: nothing is visible, nor said to be.
std::optional<double> Jaccard(const std::vector<Track>& tracks, double threshold_px) {
  int64_t hits = 0;
  int64_t truths = 0;
  int64_t false_alarms = 0;
  for (const Track& track : tracks) {
    for (const Pair& pair : track) {
      const bool hit = pair.truly_visible && pair.error < threshold_px;
      truths += pair.truly_visible;
      hits += pair.visible && hit;
      false_alarms += pair.visible && !hit;
    }
  }
  if (truths + false_alarms == 0) return std::nullopt;
  return static_cast<double>(hits) / (truths + false_alarms);
}

void AddVisibilityMetrics(const std::vector<Track>& tracks, Metrics& metrics) {
  int64_t pairs = 0;
  int64_t right = 0;
  for (const Track& track : tracks) {
    pairs += track.size();
    right += std::count_if(track.begin(), track.end(), [](const Pair& p) { return p.visible == p.truly_visible; });
  }
  if (pairs == 0) return;
  metrics.oa = 100.0 * right / pairs;
  double sum = 0;
  for (double threshold : kThresholds) {
    const std::optional<double> jaccard = Jaccard(tracks, threshold);
    if (!jaccard) return;  // at no other threshold either
    sum += *jaccard;
  }
  metrics.aj = 100.0 * sum / kThresholds.size();
}

std::optional<double> ShareStrayed(const std::vector<Track>& tracks) {
  int64_t pairs = 0;
  int64_t strayed = 0;
  for (const Track& track : tracks) {
    for (const Pair& pair : track) {
      if (!pair.has_mask || !pair.truly_visible) continue;
      ++pairs;
      strayed += pair.strayed;
    }
  }
  if (pairs == 0) return std::nullopt;
  return 100.0 * strayed / pairs;
}

}  // namespace

double ScoredError(const ScoredVideo& video, int64_t index) {
  const double dx = double{video.estimate[2 * index]} - video.truth[2 * index];
  const double dy = double{video.estimate[2 * index + 1]} - video.truth[2 * index + 1];
  const double error =
      std::hypot(dx * kScoredSide / video.frame_size.width, dy * kScoredSide / video.frame_size.height);
  return std::isfinite(error) ? error : std::numeric_limits<double>::infinity();
}

const std::array<MetricColumn, 9>& MetricColumns() {
  static constexpr std::array<MetricColumn, 9> kColumns = {{{"delta_avg", "d_avg", &Metrics::delta_avg},
                                                            {"delta_vis", "d_vis", &Metrics::delta_vis},
                                                            {"delta_occ", "d_occ", &Metrics::delta_occ},
                                                            {"survival_50", "surv50", &Metrics::survival_50},
                                                            {"survival_16", "surv16", &Metrics::survival_16},
                                                            {"mte", "MTE", &Metrics::mte},
                                                            {"oa", "OA", &Metrics::oa},
                                                            {"aj", "AJ", &Metrics::aj},
                                                            {"left_object", "left", &Metrics::left_object}}};
  return kColumns;
}

Metrics ComputeMetrics(const ScoredVideo& video) {
  std::vector<Track> tracks, all;
  Metrics metrics;
  double survival_50 = 0;
  double survival_16 = 0;
  double median_errors = 0;
  for (int64_t point = 0; point < video.points; ++point) {
    all.push_back(CollectTrack(video, point));
    Track track = Placed(all.back());
    if (track.empty()) continue;
    const int64_t frames_after_query = video.frames - 1 - video.query_frames[point];
    survival_50 += SurvivalOf(track, frames_after_query, 50);
    survival_16 += SurvivalOf(track, frames_after_query, 16);
    median_errors += MedianError(track);
    tracks.push_back(std::move(track));
  }
  if (!video.visible.empty()) AddVisibilityMetrics(all, metrics);
  if (tracks.empty()) return metrics;
  metrics.delta_avg = DeltaAverage(tracks, [](const Pair&) { return true; });
  metrics.delta_vis = DeltaAverage(tracks, [](const Pair& pair) { return pair.truly_visible; });
  metrics.delta_occ = DeltaAverage(tracks, [](const Pair& pair) { return !pair.truly_visible; });
  metrics.survival_50 = survival_50 / tracks.size();
  metrics.survival_16 = survival_16 / tracks.size();
  metrics.mte = median_errors / tracks.size();
  metrics.left_object = ShareStrayed(tracks);
  return metrics;
}

Metrics MeanMetrics(const std::vector<Metrics>& videos) {
  Metrics mean;
  for (const MetricColumn& column : MetricColumns()) {
    double sum = 0;
    int64_t count = 0;
    for (const Metrics& video : videos) {
      if (!(video.*column.value)) continue;
      sum += *(video.*column.value);
      ++count;
    }
    if (count > 0) mean.*column.value = sum / count;
  }
  return mean;
}

}  // namespace holdfast
