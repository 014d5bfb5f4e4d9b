// SPDX-License-Identifier: Apache-2.0
// holdfast-train: flags -> request -> training. Exit status: 0 when the training is done, 1 when it failed, 2 for wrong
// flags, 130 or 143 when SIGINT or SIGTERM stopped it earlier, so that whoever supervises it starts it again.
#include <atomic>
#include <csignal>
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
#include "training/trainer.h"

namespace holdfast {
namespace {

constexpr Program kProgram = {
    "holdfast-train",
    "holdfast-train --preset=small --time_budget=30m --out=DIR\n"
    "holdfast-train --preset=paper --format=pointodyssey --data=DIR --out=DIR\n\n"
    "Trains a network and goes on where the directory's last checkpoint stopped. SIGTERM writes a checkpoint and ends\n"
    "with status 143, a training that is done with 0. Several processes train together when RANK, WORLD_SIZE,\n"
    "MASTER_ADDR and MASTER_PORT say so. A flag of the recipe that is not given leaves what the preset says."};

constexpr int kFailure = 1;
constexpr int kUsageError = 2;

absl::StatusOr<TrainRequest> ReadRequest(const std::vector<std::string>& args, const GroupOptions& group) {
  const absl::Status status = SetFlags(args, std::getenv);
  if (!status.ok()) return status;
  return TrainRequestFromFlags(group);
}

int Fail(const absl::Status& status, int exit_status) {
  std::cerr << "holdfast-train: " << status.message() << std::endl;
  return exit_status;
}

// All processes of a training stop together. None may look complete, or it would be missing when the others go on.
int StoppedExitCode(const StopSignal& stop) {
  const bool asked_another_process = !stop.stopped();
  return SignalExitCode(asked_another_process ? SIGTERM : stop.signal());
}

int Main(const std::vector<std::string>& args) {
  if (AnswerQuestion(kProgram, args, std::cout)) return EXIT_SUCCESS;
  std::atomic<bool> asked_to_stop{false};
  StopSignal stop;
  stop.SetCallback([&asked_to_stop] { asked_to_stop = true; });
  const TerminationWatcher watcher(stop);
  const absl::StatusOr<GroupOptions> group = GroupOptionsFromEnvironment(std::getenv);
  if (!group.ok()) return Fail(group.status(), kUsageError);
  const absl::StatusOr<TrainRequest> request = ReadRequest(args, *group);
  if (!request.ok()) return Fail(request.status(), kUsageError);
  const absl::StatusOr<StopReason> reason = RunTraining(*request, *group, asked_to_stop);
  if (!reason.ok()) return Fail(reason.status(), kFailure);
  return *reason == StopReason::kFinished ? EXIT_SUCCESS : StoppedExitCode(stop);
}

}  // namespace
}  // namespace holdfast

int main(int argc, char** argv) {
  holdfast::PrepareForNetwork(argv);
  return holdfast::Main({argv + 1, argv + argc});
}
