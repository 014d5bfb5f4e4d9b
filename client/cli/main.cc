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
  std::signal(SIGPIPE, SIG_IGN);  // a reader that goes away is an error of writing, and the rest is still written
  holdfast::StopSignal stop;
  holdfast::TerminationWatcher watcher(stop);
  const holdfast::Console console{std::cout, std::cerr, isatty(STDERR_FILENO) != 0,
                                  [](const char* name) { return std::getenv(name); }};
  const int code = holdfast::RunCommandLine({argv + 1, argv + argc}, console, stop);
  std::cout.flush();
  // A read of an input that stalls may still be going on, and what it uses must not be torn down under it.
  std::_Exit(code);
}
