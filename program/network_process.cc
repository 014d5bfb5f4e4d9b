// SPDX-License-Identifier: Apache-2.0
#include "program/network_process.h"

#include "program/freed_memory.h"
#include "program/openmp_wait.h"

namespace holdfast {

void PrepareForNetwork(char** argv) {
  ChooseOpenMpWait(argv);
  KeepFreedMemory();
}

}  // namespace holdfast
