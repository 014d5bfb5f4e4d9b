// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "absl/types/span.h"
#include "api/types.h"

namespace holdfast {

// When the frames that may still be reported were captured, where the caller said so. Thread-safe.
class CaptureTimes {
 public:
  // The first frame to come.
  void StartAt(int64_t frame) ABSL_LOCKS_EXCLUDED(mutex_);
  // Of the next frame.
  void Push(std::optional<absl::Time> time) ABSL_LOCKS_EXCLUDED(mutex_);
  void EvictBefore(int64_t frame) ABSL_LOCKS_EXCLUDED(mutex_);
  // Of the frames of 'runs', ascending; frames without a time are left out.
  std::vector<FrameTime> Of(absl::Span<const PointRun> runs) const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  mutable absl::Mutex mutex_;
  std::deque<std::optional<absl::Time>> times_ ABSL_GUARDED_BY(mutex_);  // from frame oldest_ on
  int64_t oldest_ ABSL_GUARDED_BY(mutex_) = 0;
  int64_t known_ ABSL_GUARDED_BY(mutex_) = 0;  // entries of times_ that are not empty
};

}  // namespace holdfast
