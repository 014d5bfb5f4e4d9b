// SPDX-License-Identifier: Apache-2.0
// The data sets a training can run on, by name.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "training/clip_source.h"
#include "training/data/dataset.h"
#include "training/data/synthetic/synthetic_options.h"
#include "training/recipe.h"

namespace holdfast {

struct TrainingDataOptions {
  std::string format = "synthetic";  // synthetic, pointodyssey or neutral
  std::string dir;                   // of recorded data
  std::string split = "train";       // of pointodyssey
  std::string pictures;              // of synthetic: directory with objects/ and backgrounds/; empty: textures only
  int64_t clips = 0;                 // synthetic clips there are; 0: never the same twice
  bool augment = true;               // recorded clips
  int64_t frames = 24;
  int64_t motion_ramp_clips = 0;                        // of synthetic, as in SyntheticOptions
  double alike_share = SyntheticOptions().alike_share;  // the same
  uint64_t seed = 0;
};

// The data set of one phase. INVALID_ARGUMENT for an unknown format, NOT_FOUND without data.
absl::StatusOr<std::unique_ptr<Dataset>> OpenTrainingData(const TrainingDataOptions& options, const Phase& phase);

struct TrainingLoaderOptions {
  int64_t batch_size = 1;
  int workers = 1;
  int64_t rank = 0;
  int64_t world = 1;
};

// Opens the data set of each phase as it comes.
class TrainingClips : public ClipSource {
 public:
  TrainingClips(const TrainingDataOptions& data, const TrainingLoaderOptions& loader) : data_(data), loader_(loader) {}
  absl::StatusOr<std::unique_ptr<Loader>> Open(const Phase& phase, int64_t first_draw) override;

 private:
  const TrainingDataOptions data_;
  const TrainingLoaderOptions loader_;
  std::unique_ptr<Dataset> dataset_;  // of the phase that was opened last
};

}  // namespace holdfast
