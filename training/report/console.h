// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <ostream>
#include <string>

#include "training/report/training_report.h"

namespace holdfast {

struct ConsoleOptions {
  bool terminal = false;     // a bar that is rewritten in place; else a plain line now and then
  int64_t lines_every = 20;  // steps between plain lines
};

// Progress for people. 'out' is borrowed.
std::unique_ptr<TrainingObserver> MakeConsole(std::ostream& out, const ConsoleOptions& options);

// "[#####.....]", 'width' cells inside; share in [0, 1].
std::string ProgressBar(double share, int width);

}  // namespace holdfast
