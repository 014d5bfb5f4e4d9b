// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "server/engine/checkpoint_sealer.h"

namespace holdfast {

// Keeps the states itself: a token is the number of one.
class MemorySealer final : public CheckpointSealer {
 public:
  absl::StatusOr<std::string> Seal(const SessionState& state) const override {
    if (before_seal) before_seal();
    if (failures > 0) {
      --failures;
      return absl::InternalError("there is no memory");
    }
    if (full) return absl::ResourceExhaustedError("the token would be too long");
    absl::MutexLock lock(&mutex_);
    states_.push_back(state);
    return absl::StrCat(states_.size() - 1);
  }
  absl::StatusOr<SessionState> Unseal(absl::string_view token) const override {
    size_t number = 0;
    absl::MutexLock lock(&mutex_);
    if (!absl::SimpleAtoi(token, &number) || number >= states_.size()) {
      return absl::FailedPreconditionError("config.resume_token: no token");
    }
    return states_[number];
  }
  bool outlives_process() const override { return true; }

  std::string Forge(const SessionState& state) const { return *Seal(state); }

  // Set before the first session.
  std::function<void()> before_seal;
  bool full = false;
  mutable std::atomic<int> failures = 0;  // of the next calls

 private:
  mutable absl::Mutex mutex_;
  mutable std::vector<SessionState> states_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace holdfast
