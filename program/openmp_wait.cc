// SPDX-License-Identifier: Apache-2.0
#include "program/openmp_wait.h"

#include <unistd.h>

#include <cstdlib>
#include <string>

#include "program/program_path.h"

namespace holdfast {

void ChooseOpenMpWait(char** argv) {
  constexpr char kSpinVariable[] = "GOMP_SPINCOUNT";
  if (std::getenv(kSpinVariable) != nullptr || std::getenv("OMP_WAIT_POLICY") != nullptr) return;
  // Not /proc/self/exe itself: the process would be called "exe".
  const std::string program = ProgramPath();
  if (program.empty() || setenv(kSpinVariable, kSpinCount, /*overwrite=*/0) != 0) return;
  execv(program.c_str(), argv);
}

}  // namespace holdfast
