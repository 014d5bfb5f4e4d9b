// SPDX-License-Identifier: Apache-2.0
// Runs methods over a data set by the query-first protocol: a point is given in the first frame that shows it, and the
// frames after that one are scored.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "api/clock.h"
#include "api/types.h"
#include "training/data/dataset.h"
#include "training/evaluation/clip_tracker.h"
#include "training/evaluation/metrics.h"
#include "training/evaluation/reliability.h"

namespace holdfast {

struct SequenceReport {
  std::string name;
  int64_t frames = 0;
  int64_t points = 0;                // scored ones
  ImageSize frame_size;              // of the source
  ImageSize processing_size;         // at which the method looked at it
  double seconds = 0;                // the method took for all of it
  std::optional<double> iterations;  // as in ClipEstimate
  Metrics metrics;
  std::vector<Claim> claims;  // empty: the method has no confidence
};

struct SkippedSequence {
  std::string name;
  std::string reason;
};

// One method on one data set.
struct Report {
  std::string method;
  std::vector<SequenceReport> sequences;
  std::vector<SkippedSequence> skipped;
  Metrics mean;                            // over sequences
  std::optional<double> iterations;        // the same
  std::optional<Reliability> reliability;  // over the claims of all sequences; empty: there are none
};

struct EvaluationOptions {
  uint64_t seed = 0;  // of whatever chance the data set leaves open; sequence i is the same for every method
  // Called before each sequence; may be empty.
  std::function<void(size_t index, size_t size)> progress;
};

// What 'method' said about a clip beside its truth. REQUIRES: as ClipTracker::Track, and it gave the estimate.
ScoredVideo ToScoredVideo(const Sample& clip, const std::vector<int64_t>& query_frames, ClipEstimate estimate);

// The report of each method, all on the very same clips. A sequence that cannot be read, has no point to follow or
// fails a method is skipped by every method and listed. Not even one sequence left: FAILED_PRECONDITION naming the
// first reason. Methods are borrowed.
absl::StatusOr<std::vector<Report>> Evaluate(const Dataset& dataset, const std::vector<ClipTracker*>& methods,
                                             const EvaluationOptions& options, const Clock& clock);

}  // namespace holdfast
