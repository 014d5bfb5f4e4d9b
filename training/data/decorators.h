// SPDX-License-Identifier: Apache-2.0
// Data sets made of data sets. Each owns the one it decorates and is as thread-safe as that one.
#pragma once

#include <cstdint>
#include <memory>

#include "absl/status/statusor.h"
#include "training/data/augment.h"
#include "training/data/dataset.h"
#include "training/data/track_selection.h"

namespace holdfast {

// An endless stream of the same samples: element i is the element (i mod n) of a permutation of its own for every
// epoch (i div n), drawn from 'seed'.
class ShuffledDataset : public Dataset {
 public:
  ShuffledDataset(std::unique_ptr<const Dataset> source, uint64_t seed) : source_(std::move(source)), seed_(seed) {}
  size_t size() const override { return source_->size() == 0 ? 0 : size_t{1} << 62; }
  absl::StatusOr<Sample> Get(size_t index, Rng& rng) const override;

 private:
  const std::unique_ptr<const Dataset> source_;
  const uint64_t seed_;
};

// The samples cut or scaled to 'size', either with the same chance.
class CroppedDataset : public Dataset {
 public:
  CroppedDataset(std::unique_ptr<const Dataset> source, ImageSize size) : source_(std::move(source)), size_(size) {}
  size_t size() const override { return source_->size(); }
  absl::StatusOr<Sample> Get(size_t index, Rng& rng) const override;

 private:
  const std::unique_ptr<const Dataset> source_;
  const ImageSize size_;
};

// The samples with the augmentations of augment.h, at options.size.
class AugmentedDataset : public Dataset {
 public:
  AugmentedDataset(std::unique_ptr<const Dataset> source, const AugmentOptions& options)
      : source_(std::move(source)), augmenter_(options) {}
  size_t size() const override { return source_->size(); }
  absl::StatusOr<Sample> Get(size_t index, Rng& rng) const override;

 private:
  const std::unique_ptr<const Dataset> source_;
  const Augmenter augmenter_;
};

// The samples with exactly 'points' tracks: those that keep the rules, spread out, and padding that is nowhere valid.
// Fewer than 'min_points' good tracks: FAILED_PRECONDITION.
class SelectedDataset : public Dataset {
 public:
  SelectedDataset(std::unique_ptr<const Dataset> source, int64_t points, int64_t min_points,
                  const TrackRules& rules = TrackRules::Training())
      : source_(std::move(source)), points_(points), min_points_(min_points), rules_(rules) {}
  size_t size() const override { return source_->size(); }
  absl::StatusOr<Sample> Get(size_t index, Rng& rng) const override;

 private:
  const std::unique_ptr<const Dataset> source_;
  const int64_t points_;
  const int64_t min_points_;
  const TrackRules rules_;
};

// What training on recorded data uses: shuffled, augmented (or only cropped) to 'augment.size', exactly 'points'
// tracks.
std::unique_ptr<Dataset> TrainingStream(std::unique_ptr<const Dataset> source, const AugmentOptions& augment,
                                        bool augmented, int64_t points, uint64_t seed);

}  // namespace holdfast
