// SPDX-License-Identifier: Apache-2.0
// Batches a data set and reads ahead of its consumer with worker threads.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "training/data/dataset.h"

namespace holdfast {

struct LoaderOptions {
  int64_t batch_size = 1;  // samples a batch of this process
  int workers = 1;         // threads; 0: the caller's thread makes each batch in Next()
  int64_t prefetch = 4;    // batches kept ready at most
  uint64_t seed = 0;       // of every random choice of the data set
  int64_t first_draw = 0;  // where to go on after a resume: a draw gives the same sample whatever came before
  int64_t rank = 0;        // of this process among 'world': together they see each sample of the global batch once
  int64_t world = 1;
  int max_attempts = 100;  // tries of other samples in place of a damaged one before Next() fails

  absl::Status Validate() const;
};

// Sample i of batch b of rank r is draw d = first_draw + (b * world + r) * batch_size + i of the data set: index d mod
// size(), with an Rng of (seed, d). So a batch depends on the options alone, not on the number of threads or their
// timing. A sample that fails is counted and another index, drawn from (seed, d) too, takes its place.
//
// Owned by its consumer, which may call Next() from one thread at a time; the data set is borrowed and must outlive it.
// Workers stop making batches when 'prefetch' are ready. The destructor stops and joins them.
class Loader {
 public:
  static absl::StatusOr<std::unique_ptr<Loader>> Create(const Dataset& dataset, const LoaderOptions& options);
  virtual ~Loader() = default;

  // Blocks until the next batch, in order, is there: batch_size samples. Errors only after max_attempts samples in a
  // row failed; the next call then goes on with the batch after.
  virtual absl::StatusOr<std::vector<Sample>> Next() = 0;

  // Samples skipped as damaged so far, and what the last of them said (empty: none yet).
  virtual int64_t skipped() const = 0;
  virtual std::string last_error() const = 0;
};

}  // namespace holdfast
