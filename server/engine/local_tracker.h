// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "api/point_tracker.h"
#include "server/engine/engine.h"

namespace holdfast {

// PointTracker in this process: blocking streams over an engine. 'engine' must outlive the tracker and its streams.
class LocalTracker final : public PointTracker {
 public:
  explicit LocalTracker(Engine& engine) : engine_(engine) {}
  absl::StatusOr<std::unique_ptr<TrackStream>> Open(const SessionConfig& config, TrackObserver& observer) override;
  absl::StatusOr<TrackerInfo> Info() override;

 private:
  Engine& engine_;
};

}  // namespace holdfast
