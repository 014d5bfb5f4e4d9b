// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "absl/status/statusor.h"
#include "api/clock.h"
#include "server/engine/tracker_model.h"

namespace holdfast {

// Encodes the picture and refines a few rows, several times, on a thread of its own so that the caller's thread
// settings stay what they are. The libraries below choose and compile their kernels the first time and not in the first
// session; the others tell what the network costs. RESOURCE_EXHAUSTED when there is no memory for a frame of this size.
absl::StatusOr<WorkCosts> WarmUp(TrackerModel& model, const RgbImage& picture, int iterations, const Clock& clock);

}  // namespace holdfast
