// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <torch/types.h>

#include <map>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "api/types.h"
#include "model/point_model.h"
#include "server/engine/metrics.h"

namespace holdfast {

// The network in the precision that is right for a frame's size. A size is tried once, before its first frame: where
// the fast network says other than the exact one, the size is left to the exact one and the metrics hear of it.
class PrecisionSwitch {
 public:
  // One network for every size: the caller has chosen.
  PrecisionSwitch(PointModel only, EngineMetrics& metrics);
  // 'exact' in float32, 'fast' in another type; of the same weights, on one device.
  PrecisionSwitch(PointModel exact, PointModel fast, EngineMetrics& metrics);

  // Compute thread. Takes the time of two frames and two windows in both precisions when the size is new.
  PointModel& ForSize(ImageSize size) ABSL_LOCKS_EXCLUDED(mutex_);
  // Any thread. Runs each group on the network that its features came from; estimates in the order of the groups.
  std::vector<WindowEstimate> Refine(std::vector<WindowRows> groups, const RefineOptions& options);
  // Any thread. The type of the features of frames of this size; the larger one for a size that was not tried yet, so
  // that what is admitted by it suffices either way.
  torch::ScalarType FeatureType(ImageSize size) const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  bool has_choice() const { return !fast_.is_empty(); }
  PointModel& SourceOf(const WindowRows& rows);

  PointModel exact_;
  PointModel fast_{nullptr};
  EngineMetrics& metrics_;
  mutable absl::Mutex mutex_;
  std::map<std::pair<int, int>, bool> is_fast_right_ ABSL_GUARDED_BY(mutex_);  // by width and height
};

}  // namespace holdfast
