// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/point_model.h"
#include "training/data/dataset.h"
#include "training/data/sample.h"
#include "training/evaluation/metrics.h"

namespace holdfast {

// A fixed set of clips, kept in memory, on which a network is measured while it trains: one window a clip, from zero
// velocity. The full protocol is the evaluator's.
class Validation {
 public:
  // The first 'clips' clips of 'dataset' that can be read, drawn with 'seed'.
  static absl::StatusOr<Validation> Create(const Dataset& dataset, int64_t clips, uint64_t seed, int64_t iterations);

  absl::StatusOr<Metrics> Run(PointModelImpl& network, const torch::Device& device) const;

 private:
  Validation(std::vector<Sample> clips, int64_t iterations) : clips_(std::move(clips)), iterations_(iterations) {}

  std::vector<Sample> clips_;
  int64_t iterations_;
};

}  // namespace holdfast
