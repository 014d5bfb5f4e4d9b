// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "server/engine/evidence.h"
#include "training/evaluation/calibration_fit.h"
#include "training/evaluation/clip_tracker.h"

namespace holdfast {

// The evidence for the estimates of one session after the other. Thread-safe.
class EvidenceLog {
 public:
  // What an engine reports to; the log must outlive the engine.
  EvidenceSink Sink();
  // What was reported since the last call.
  std::map<std::pair<PointId, int64_t>, Evidence> Take() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  absl::Mutex mutex_;
  std::map<std::pair<PointId, int64_t>, Evidence> evidence_ ABSL_GUARDED_BY(mutex_);
};

// Tracks as another method does, and adds to 'judged' the evidence for each estimate and whether it was right.
class CalibratingClipTracker final : public ClipTracker {
 public:
  // 'log' hears of what 'method' estimates; it and 'judged' must outlive this.
  CalibratingClipTracker(std::unique_ptr<ClipTracker> method, EvidenceLog& log, std::vector<Judged>& judged)
      : method_(std::move(method)), log_(log), judged_(judged) {}

  std::string name() const override { return method_->name(); }
  absl::StatusOr<ClipEstimate> Track(const Sample& clip, const std::vector<int64_t>& query_frames) override;

 private:
  const std::unique_ptr<ClipTracker> method_;
  EvidenceLog& log_;
  std::vector<Judged>& judged_;
};

}  // namespace holdfast
