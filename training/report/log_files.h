// SPDX-License-Identifier: Apache-2.0
// The written records of a training: one JSON object a line, and TensorBoard's events.
#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "training/report/training_report.h"

namespace holdfast {

// Appends to 'path': {"event":"step",...}, {"event":"validation",...}, {"event":"notice",...}; a line that
// finds no room is left out as a whole.
absl::StatusOr<std::unique_ptr<TrainingObserver>> OpenJsonLog(const std::string& path);

// A new file events.out.tfevents.<seconds>.holdfast.<process> in 'directory' (made if absent).
absl::StatusOr<std::unique_ptr<TrainingObserver>> OpenEventLog(const std::string& directory, absl::Time now);

}  // namespace holdfast
