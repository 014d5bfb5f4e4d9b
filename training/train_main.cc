// SPDX-License-Identifier: Apache-2.0
// holdfast-train: flags -> request -> training. Exit status: 0 when done or after SIGTERM, 1 when it failed, 2 for
// wrong flags.
#include <malloc.h>

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "flags/program_flags.h"
#include "training/stop_signal.h"
#include "training/train_flags.h"
#include "training/train_job.h"

namespace holdfast {
namespace {

constexpr int kFailure = 1;
constexpr int kUsageError = 2;

// A step frees what the next one takes again: tensors of some megabytes, which malloc would hand back to the kernel
// each time, to be cleared and mapped anew (an eighth of a step's time).
void KeepFreedMemory() {
  mallopt(M_MMAP_THRESHOLD, 32 << 20);  // the largest that glibc takes
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
  mallopt(M_TOP_PAD, 64 << 20);
}

absl::StatusOr<TrainRequest> ReadRequest(const std::vector<std::string>& args) {
  const absl::Status status = SetFlagsFromEnvironment("HOLDFAST_", std::getenv);
  if (!status.ok()) return status;
  const absl::StatusOr<std::vector<std::string>> rest = ParseFlags(args);
  if (!rest.ok()) return rest.status();
  if (!rest->empty()) return absl::InvalidArgumentError(absl::StrCat("unexpected argument \"", rest->front(), "\""));
  return TrainRequestFromFlags();
}

int Fail(const absl::Status& status, int exit_status) {
  std::cerr << "holdfast-train: " << status.message() << std::endl;
  return exit_status;
}

int Main(const std::vector<std::string>& args) {
  if (std::count(args.begin(), args.end(), "--help") > 0) return std::cout << TrainUsage(), EXIT_SUCCESS;
  if (std::count(args.begin(), args.end(), "--version") > 0) {
    return std::cout << "holdfast-train " HOLDFAST_VERSION "\n", EXIT_SUCCESS;
  }
  KeepFreedMemory();
  const StopSignal stop;
  const absl::StatusOr<TrainRequest> request = ReadRequest(args);
  if (!request.ok()) return Fail(request.status(), kUsageError);
  const absl::StatusOr<GroupOptions> group = GroupOptionsFromEnvironment(std::getenv);
  if (!group.ok()) return Fail(group.status(), kUsageError);
  const absl::Status status = RunTraining(*request, *group, stop.requested());
  return status.ok() ? EXIT_SUCCESS : Fail(status, kFailure);
}

}  // namespace
}  // namespace holdfast

int main(int argc, char** argv) { return holdfast::Main({argv + 1, argv + argc}); }
