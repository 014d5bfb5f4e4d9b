// SPDX-License-Identifier: Apache-2.0
#include "training/data/loader.h"

#include <algorithm>
#include <exception>
#include <map>
#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"

namespace holdfast {
namespace {

using Batch = std::vector<Sample>;

// Makes any batch, in any order, from any thread; counts what it had to skip.
class BatchMaker {
 public:
  BatchMaker(const Dataset& dataset, const LoaderOptions& options) : dataset_(dataset), options_(options) {}

  absl::StatusOr<Batch> Make(int64_t batch) {
    Batch samples;
    const int64_t first_draw = options_.first_draw + (batch * options_.world + options_.rank) * options_.batch_size;
    for (int64_t i = 0; i < options_.batch_size; ++i) {
      absl::StatusOr<Sample> sample = Draw(static_cast<uint64_t>(first_draw + i));
      if (!sample.ok()) return sample.status();
      samples.push_back(*std::move(sample));
    }
    return samples;
  }

  int64_t skipped() const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return skipped_;
  }
  std::string last_error() const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return last_error_;
  }

 private:
  absl::StatusOr<Sample> Draw(uint64_t draw) {
    Rng rng(options_.seed, draw);
    size_t index = draw % dataset_.size();
    absl::Status failure;
    for (int attempt = 0; attempt < options_.max_attempts; ++attempt) {
      absl::StatusOr<Sample> sample = Get(index, rng);
      if (sample.ok()) return sample;
      failure = sample.status();
      CountSkip(failure);
      index = static_cast<size_t>(rng.Next() % dataset_.size());
    }
    return absl::Status(failure.code(), absl::StrCat(options_.max_attempts,
                                                     " samples in a row are unusable; the last: ", failure.message()));
  }

  // Nothing a library throws over a damaged file may end a worker thread.
  absl::StatusOr<Sample> Get(size_t index, Rng& rng) const {
    try {
      return dataset_.Get(index, rng);
    } catch (const std::exception& e) {
      return absl::DataLossError(absl::StrCat("sample ", index, ": ", e.what()));
    }
  }

  void CountSkip(const absl::Status& failure) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    ++skipped_;
    last_error_ = failure.ToString();
  }

  const Dataset& dataset_;
  const LoaderOptions options_;
  mutable absl::Mutex mutex_;
  int64_t skipped_ ABSL_GUARDED_BY(mutex_) = 0;
  std::string last_error_ ABSL_GUARDED_BY(mutex_);
};

// Batches made where and when they are asked for.
class DirectLoader : public Loader {
 public:
  DirectLoader(const Dataset& dataset, const LoaderOptions& options) : maker_(dataset, options) {}

  absl::StatusOr<Batch> Next() override { return maker_.Make(next_++); }
  int64_t skipped() const override { return maker_.skipped(); }
  std::string last_error() const override { return maker_.last_error(); }

 private:
  BatchMaker maker_;
  int64_t next_ = 0;
};

// Workers claim batch numbers in order, make them in parallel and leave them in 'ready_', where Next() picks them up in
// order. A number is claimed only when it is less than 'prefetch' ahead of the consumer, which bounds 'ready_'.
class PrefetchingLoader : public Loader {
 public:
  PrefetchingLoader(const Dataset& dataset, const LoaderOptions& options)
      : maker_(dataset, options), prefetch_(options.prefetch) {
    for (int i = 0; i < options.workers; ++i) threads_.emplace_back([this] { Work(); });
  }

  ~PrefetchingLoader() override {
    {
      absl::MutexLock lock(&mutex_);
      stopping_ = true;
    }
    for (std::thread& thread : threads_) thread.join();
  }

  absl::StatusOr<Batch> Next() override {
    absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(this, &PrefetchingLoader::WantedIsReadyLocked));
    auto node = ready_.extract(wanted_);
    ++wanted_;
    return std::move(node.mapped());
  }

  int64_t skipped() const override { return maker_.skipped(); }
  std::string last_error() const override { return maker_.last_error(); }

 private:
  bool WantedIsReadyLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return ready_.count(wanted_) != 0; }
  bool MayClaimOrStopLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return stopping_ || unclaimed_ < wanted_ + prefetch_;
  }

  void Work() {
    while (true) {
      int64_t number = 0;
      {
        absl::MutexLock lock(&mutex_);
        mutex_.Await(absl::Condition(this, &PrefetchingLoader::MayClaimOrStopLocked));
        if (stopping_) return;
        number = unclaimed_++;
      }
      absl::StatusOr<Batch> batch = maker_.Make(number);
      absl::MutexLock lock(&mutex_);
      ready_.emplace(number, std::move(batch));
    }
  }

  BatchMaker maker_;
  const int64_t prefetch_;
  mutable absl::Mutex mutex_;
  int64_t wanted_ ABSL_GUARDED_BY(mutex_) = 0;     // the batch Next() gives next
  int64_t unclaimed_ ABSL_GUARDED_BY(mutex_) = 0;  // the first batch no worker has begun
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::map<int64_t, absl::StatusOr<Batch>> ready_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::thread> threads_;  // last: they use all of the above
};

}  // namespace

absl::Status LoaderOptions::Validate() const {
  if (batch_size < 1) return absl::InvalidArgumentError("batch_size must be positive");
  if (workers < 0 || workers > 1024) return absl::InvalidArgumentError("workers must be in [0, 1024]");
  if (prefetch < 1) return absl::InvalidArgumentError("prefetch must be positive");
  if (first_draw < 0) return absl::InvalidArgumentError("first_draw must not be negative");
  if (world < 1 || rank < 0 || rank >= world) return absl::InvalidArgumentError("rank must be in [0, world)");
  if (max_attempts < 1) return absl::InvalidArgumentError("max_attempts must be positive");
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<Loader>> Loader::Create(const Dataset& dataset, const LoaderOptions& options) {
  if (absl::Status status = options.Validate(); !status.ok()) return status;
  if (dataset.size() == 0) return absl::FailedPreconditionError("the data set is empty");
  if (options.workers == 0) return std::unique_ptr<Loader>(std::make_unique<DirectLoader>(dataset, options));
  return std::unique_ptr<Loader>(std::make_unique<PrefetchingLoader>(dataset, options));
}

}  // namespace holdfast
