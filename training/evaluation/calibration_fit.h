// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "server/engine/evidence.h"
#include "server/engine/tracks/calibration.h"

namespace holdfast {

// The evidence for an estimate, and whether it was right (see kRightWithin).
struct Judged {
  Evidence evidence;
  bool right = false;
};

// The calibration under which what was observed is most likely, but for a slight pull of its weights towards 0. Every
// estimate that was polished counts a second time as it was before, so that provisional estimates are judged too.
// FAILED_PRECONDITION: all of them are right, or none is.
absl::StatusOr<Calibration> FitCalibration(const std::vector<Judged>& observed);

}  // namespace holdfast
