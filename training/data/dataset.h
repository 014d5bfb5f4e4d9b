// SPDX-License-Identifier: Apache-2.0
// What a source of clips is: a size and a random access. Cropping, augmenting and shuffling are decorators that are
// data sets themselves (decorators.h); batching and prefetching are the loader's (loader.h).
#pragma once

#include <cstddef>
#include <cstdint>

#include "absl/status/statusor.h"
#include "training/data/rng.h"
#include "training/data/sample.h"

namespace holdfast {

class Dataset {
 public:
  virtual ~Dataset() = default;

  virtual size_t size() const = 0;

  // The clip of this index, index < size(). All chance comes from 'rng': the same index and the same state of 'rng'
  // give the same sample. Any number of threads may call at once, each with an Rng of its own.
  // A damaged or unusable sequence is an error (DATA_LOSS, NOT_FOUND, FAILED_PRECONDITION) that names the file;
  // callers go on with another index.
  virtual absl::StatusOr<Sample> Get(size_t index, Rng& rng) const = 0;
};

}  // namespace holdfast
