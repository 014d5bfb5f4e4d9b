// SPDX-License-Identifier: Apache-2.0
// The program "holdfast".
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <iostream>
#include <opencv2/core/utils/logger.hpp>

#include "client/cli/command_line.h"
#include "program/termination.h"

int main(int argc, char** argv) {
  // What OpenCV has to say of files it cannot open is said better by the commands.
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  // A reader that goes away, or a file as large as it may be, is an error of writing, and the rest is still written.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  holdfast::StopSignal stop;
  holdfast::TerminationWatcher watcher(stop);
  const holdfast::Console console{std::cout, std::cerr, isatty(STDERR_FILENO) != 0,
                                  [](const char* name) { return std::getenv(name); }};
  int code = holdfast::RunCommandLine({argv + 1, argv + argc}, console, stop);
  if (!std::cout.flush() && code == 0) {
    std::cerr << "holdfast: what there is to say cannot be written to standard output\n";
    code = 1;
  }
  // A read of an input that stalls may still be going on, and what it uses must not be torn down under it.
  std::_Exit(code);
}
