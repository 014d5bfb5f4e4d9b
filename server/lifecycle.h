// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>

namespace holdfast {

// kLoading -> kServing -> kDraining -> kStopped; states may be skipped, never gone back to.
enum class LifecycleState { kLoading, kServing, kDraining, kStopped };

// Where the server stands. Thread-safe.
class Lifecycle {
 public:
  LifecycleState state() const { return state_.load(std::memory_order_acquire); }

  // False, and nothing happens, unless 'to' is a later state.
  bool Advance(LifecycleState to) {
    LifecycleState from = state();
    while (from < to) {
      if (state_.compare_exchange_weak(from, to, std::memory_order_acq_rel)) return true;
    }
    return false;
  }

 private:
  std::atomic<LifecycleState> state_{LifecycleState::kLoading};
};

}  // namespace holdfast
