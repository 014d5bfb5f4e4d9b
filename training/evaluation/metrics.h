// SPDX-License-Identifier: Apache-2.0
// How good tracks are: the numbers that papers on point tracking report. Plain C++ on vectors, no torch.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "api/types.h"

namespace holdfast {

// Truth beside estimates of N points on the S frames of one video. Arrays are row-major [S, N] or [S, N, 2]; positions
// are pixels (x, y) of frames of 'frame_size'. An estimate that is not finite is infinitely wrong.
struct ScoredVideo {
  ImageSize frame_size;
  int64_t frames = 0;                 // S
  int64_t points = 0;                 // N
  std::vector<int64_t> query_frames;  // [N]; only frames after a point's query count
  std::vector<float> truth;           // [S, N, 2]
  std::vector<uint8_t> valid;         // [S, N]; 0: there is no truth here
  std::vector<uint8_t> true_visible;  // [S, N]
  std::vector<uint8_t> hidden;        // [S, N] 1: hidden, and nobody knows where (not valid); empty: none is
  std::vector<float> estimate;        // [S, N, 2]
  std::vector<uint8_t> visible;       // [S, N] estimated; empty: the tracker says nothing about visibility
  std::vector<float> confidence;      // [S, N] in [0, 1]; empty: the tracker says nothing about it
  std::vector<int32_t> object_ids;    // [N] of the objects the points lie on; 0: unknown
  std::vector<int32_t> estimate_ids;  // [S, N] of what the estimates lie on; empty: there are no masks

  int64_t Index(int64_t frame, int64_t point) const { return frame * points + point; }
};

// Shares in percent, distances in pixels of a 256x256 frame (x * 256 / W, y * 256 / H). Empty: nothing to measure.
struct Metrics {
  std::optional<double> delta_avg;    // mean over the thresholds 1, 2, 4, 8, 16 px of the valid pairs closer than that
  std::optional<double> delta_vis;    // the same, truly visible pairs only
  std::optional<double> delta_occ;    // the same, truly hidden pairs only
  std::optional<double> survival_50;  // share of the frames before the error first exceeds 50 px, mean over tracks
  std::optional<double> survival_16;  // the same at 16 px
  std::optional<double> mte;          // median error of each track, mean over tracks; pixels
  // These two count frames whose points are hidden nobody knows where, too.
  std::optional<double> oa;           // share of pairs whose visibility is right
  std::optional<double> aj;           // average Jaccard of TAP-Vid over the thresholds of delta_avg
  std::optional<double> left_object;  // share of the truly visible pairs whose estimate lies on another object
};

struct MetricColumn {
  const char* key;     // in JSON
  const char* header;  // in tables
  std::optional<double> Metrics::*value;
};
const std::array<MetricColumn, 9>& MetricColumns();

// How far the estimate of a frame and a point is from the truth, in pixels of a 256x256 frame. 'index': see Index().
double ScoredError(const ScoredVideo& video, int64_t index);

// REQUIRES: the arrays of 'video' have the sizes said above. Tracks without a valid frame after their query count
// nowhere but in oa and aj, and there where they are hidden.
Metrics ComputeMetrics(const ScoredVideo& video);

// The mean of each metric over the videos that have it.
Metrics MeanMetrics(const std::vector<Metrics>& videos);

}  // namespace holdfast
