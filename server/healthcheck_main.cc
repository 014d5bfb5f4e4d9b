// SPDX-License-Identifier: Apache-2.0
// holdfast-healthcheck: holdfast-server --healthcheck without LibTorch, whose loading takes a second of a processor.
// Exit status: 0 ready, 1 not, 2 for wrong flags.
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

#include "program/flags.h"
#include "server/flags.h"
#include "server/health_check.h"

namespace holdfast {
namespace {

constexpr absl::Duration kHealthTimeout = absl::Seconds(3);
constexpr Program kProgram = {
    "holdfast-healthcheck",
    "Asks the holdfast-server that was given the same flags, or environment, whether it is ready."};

int Complain(const absl::Status& status, int exit_status) {
  std::cerr << kProgram.name << ": " << status.message() << "\n";
  return exit_status;
}

int Main(std::vector<std::string> args) {
  if (AnswerQuestion(kProgram, args, std::cout)) return 0;
  args.push_back("--healthcheck");
  if (const absl::Status set = SetFlags(args, std::getenv); !set.ok()) return Complain(set, 2);
  const absl::Status health = CheckHealth(AddressToCheck().value_or(""), kHealthTimeout);
  return health.ok() ? 0 : Complain(health, 1);
}

}  // namespace
}  // namespace holdfast

int main(int argc, char** argv) { return holdfast::Main({argv + 1, argv + argc}); }
