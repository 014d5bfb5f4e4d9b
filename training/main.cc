// SPDX-License-Identifier: Apache-2.0
// holdfast-train: flags -> request -> training. Exit status: 0 when done or after SIGTERM, 1 when it failed, 2 for
// wrong flags.
#include <atomic>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

#include "program/flags.h"
#include "program/network_process.h"
#include "program/termination.h"
#include "training/distributed.h"
#include "training/flags.h"
#include "training/job.h"

namespace holdfast {
namespace {

constexpr Program kProgram = {
    "holdfast-train",
    "holdfast-train --preset=small --time_budget=30m --out=DIR\n"
    "holdfast-train --preset=paper --format=pointodyssey --data=DIR --out=DIR\n\n"
    "Trains a network and goes on where the directory's last checkpoint stopped. SIGTERM writes a checkpoint and ends\n"
    "with status 0. Several processes train together when RANK, WORLD_SIZE, MASTER_ADDR and MASTER_PORT say so. A\n"
    "flag of the recipe that is not given leaves what the preset says."};

constexpr int kFailure = 1;
constexpr int kUsageError = 2;

absl::StatusOr<TrainRequest> ReadRequest(const std::vector<std::string>& args) {
  const absl::Status status = SetFlags(args, std::getenv);
  if (!status.ok()) return status;
  return TrainRequestFromFlags();
}

int Fail(const absl::Status& status, int exit_status) {
  std::cerr << "holdfast-train: " << status.message() << std::endl;
  return exit_status;
}

int Main(const std::vector<std::string>& args) {
  if (AnswerQuestion(kProgram, args, std::cout)) return EXIT_SUCCESS;
  std::atomic<bool> asked_to_stop{false};
  StopSignal stop;
  stop.SetCallback([&asked_to_stop] { asked_to_stop = true; });
  const TerminationWatcher watcher(stop);
  absl::StatusOr<TrainRequest> request = ReadRequest(args);
  if (!request.ok()) return Fail(request.status(), kUsageError);
  const absl::StatusOr<GroupOptions> group = GroupOptionsFromEnvironment(std::getenv);
  if (!group.ok()) return Fail(group.status(), kUsageError);
  request->trainer.device = DeviceOf(request->trainer.device, *group);
  const absl::Status status = RunTraining(*request, *group, asked_to_stop);
  return status.ok() ? EXIT_SUCCESS : Fail(status, kFailure);
}

}  // namespace
}  // namespace holdfast

int main(int argc, char** argv) {
  holdfast::PrepareForNetwork(argv);
  return holdfast::Main({argv + 1, argv + argc});
}
