// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "program/flags.h"
#include "program/termination.h"

namespace holdfast {

// Where a command reads and writes.
struct Console {
  std::ostream& out;
  std::ostream& err;
  bool terminal;  // whether 'err' is one
  EnvironmentLookup getenv;
};

// The program "holdfast" without its process: 'args' is without the program's name. Returns the exit code: 0 done,
// 1 failed, 2 called wrongly, SignalExitCode where 'stop' cut it short.
int RunCommandLine(const std::vector<std::string>& args, const Console& console, StopSignal& stop);

}  // namespace holdfast
