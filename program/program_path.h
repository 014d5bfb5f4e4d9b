// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace holdfast {

// The file that this process runs, absolute and without symbolic links; empty where the system does not tell.
std::string ProgramPath();

}  // namespace holdfast
