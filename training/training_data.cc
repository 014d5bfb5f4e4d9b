// SPDX-License-Identifier: Apache-2.0
#include "training/training_data.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "training/data/decorators.h"
#include "training/data/readers/neutral.h"
#include "training/data/readers/point_odyssey.h"
#include "training/data/synthetic/synthetic_dataset.h"

namespace holdfast {
namespace {

absl::StatusOr<std::unique_ptr<Dataset>> OpenSynthetic(const TrainingDataOptions& options, const Phase& phase) {
  SyntheticOptions synthetic;
  synthetic.seed = options.seed;
  synthetic.frames = options.frames;
  synthetic.height = static_cast<int>(phase.height);
  synthetic.width = static_cast<int>(phase.width);
  synthetic.points = phase.points;
  synthetic.pictures = options.pictures;
  synthetic.motion_ramp_clips = options.motion_ramp_clips;
  synthetic.alike_share = options.alike_share;
  if (options.clips > 0) synthetic.count = static_cast<size_t>(options.clips);
  auto dataset = SyntheticDataset::Create(synthetic);
  if (!dataset.ok()) return dataset.status();
  return *std::move(dataset);
}

absl::StatusOr<std::unique_ptr<Dataset>> OpenRecorded(const TrainingDataOptions& options) {
  if (options.format == "pointodyssey") {
    PointOdysseyOptions recorded;
    recorded.root = options.dir;
    recorded.split = options.split;
    recorded.frames = options.frames;
    return PointOdyssey::Create(recorded);
  }
  if (options.format != "neutral") {
    return absl::InvalidArgumentError(
        absl::StrCat("unknown data format \"", options.format, "\"; there are synthetic, pointodyssey and neutral"));
  }
  NeutralOptions recorded;
  recorded.root = options.dir;
  recorded.frames = options.frames;
  return Neutral::Create(recorded);
}

}  // namespace

absl::StatusOr<std::unique_ptr<Dataset>> OpenTrainingData(const TrainingDataOptions& options, const Phase& phase) {
  if (options.format == "synthetic") return OpenSynthetic(options, phase);
  absl::StatusOr<std::unique_ptr<Dataset>> recorded = OpenRecorded(options);
  if (!recorded.ok()) return recorded.status();
  AugmentOptions augment;
  augment.size = {static_cast<int>(phase.width), static_cast<int>(phase.height)};
  return TrainingStream(*std::move(recorded), augment, options.augment, phase.points, options.seed);
}

absl::StatusOr<std::unique_ptr<Loader>> TrainingClips::Open(const Phase& phase, int64_t first_draw) {
  absl::StatusOr<std::unique_ptr<Dataset>> dataset = OpenTrainingData(data_, phase);
  if (!dataset.ok()) return dataset.status();
  dataset_ = *std::move(dataset);
  LoaderOptions options;
  options.batch_size = loader_.batch_size;
  options.workers = loader_.workers;
  options.seed = data_.seed;
  options.first_draw = first_draw;
  options.rank = loader_.rank;
  options.world = loader_.world;
  return Loader::Create(*dataset_, options);
}

}  // namespace holdfast
