// SPDX-License-Identifier: Apache-2.0
#include "training/data/decorators.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

// A permutation of 0 .. count - 1 without a table: a Feistel network on the next even number of bits, walked until it
// lands inside. REQUIRES: value < count.
uint64_t Permuted(uint64_t value, uint64_t count, uint64_t seed) {
  int half_bits = 1;
  while (half_bits < 31 && (uint64_t{1} << (2 * half_bits)) < count) ++half_bits;
  const uint64_t mask = (uint64_t{1} << half_bits) - 1;
  do {
    uint64_t left = value >> half_bits, right = value & mask;
    for (uint64_t round = 0; round < 6; ++round) {
      const uint64_t mixed = left ^ (MixSeed(MixSeed(seed, round), right) & mask);
      left = right;
      right = mixed;
    }
    value = (left << half_bits) | right;
  } while (value >= count);
  return value;
}

absl::Status Unusable(const Sample& sample, absl::string_view why) {
  return absl::FailedPreconditionError(absl::StrCat(sample.source, ": ", why));
}

}  // namespace

absl::StatusOr<Sample> ShuffledDataset::Get(size_t index, Rng& rng) const {
  const size_t count = source_->size();
  return source_->Get(Permuted(index % count, count, MixSeed(seed_, index / count)), rng);
}

absl::StatusOr<Sample> CroppedDataset::Get(size_t index, Rng& rng) const {
  absl::StatusOr<Sample> sample = source_->Get(index, rng);
  if (sample.ok()) CropOrScale(size_, rng, *sample);
  return sample;
}

absl::StatusOr<Sample> AugmentedDataset::Get(size_t index, Rng& rng) const {
  absl::StatusOr<Sample> sample = source_->Get(index, rng);
  if (sample.ok()) augmenter_.Apply(rng, *sample);
  return sample;
}

absl::StatusOr<Sample> SelectedDataset::Get(size_t index, Rng& rng) const {
  absl::StatusOr<Sample> sample = source_->Get(index, rng);
  if (!sample.ok()) return sample;
  MarkOutside(rules_, *sample);
  const std::vector<int64_t> good = GoodTracks(rules_, *sample);
  if (static_cast<int64_t>(good.size()) < min_points_) {
    return Unusable(*sample, absl::StrCat("only ", good.size(), " good tracks, wanted ", min_points_));
  }
  sample->SelectPoints(SpreadOut(*sample, good, points_));
  for (int64_t n = 0; n < sample->num_points() && sample->has_masks(); ++n) {
    sample->object_ids[static_cast<size_t>(n)] = sample->IdAt(0, sample->Position(0, n));
  }
  PadPoints(points_, *sample);
  return sample;
}

std::unique_ptr<Dataset> TrainingStream(std::unique_ptr<const Dataset> source, const AugmentOptions& augment,
                                        bool augmented, int64_t points, uint64_t seed) {
  std::unique_ptr<Dataset> stream = std::make_unique<ShuffledDataset>(std::move(source), seed);
  if (augmented) {
    stream = std::make_unique<AugmentedDataset>(std::move(stream), augment);
  } else {
    stream = std::make_unique<CroppedDataset>(std::move(stream), augment.size);
  }
  return std::make_unique<SelectedDataset>(std::move(stream), points, std::max<int64_t>(points / 4, 1));
}

}  // namespace holdfast
