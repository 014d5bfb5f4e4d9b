// SPDX-License-Identifier: Apache-2.0
// Fills absl flags from the environment and the command line without ending the process: absl's own parser exits with
// code 1 on a wrong flag and on --help, and cannot be tested in-process.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace holdfast {

// As std::getenv: null when the variable is not set.
using EnvironmentLookup = std::function<const char*(const char*)>;

// Flag "max_side" is set from variable "<prefix>MAX_SIDE" where that exists. Call it before ParseFlags, so that the
// command line has the last word. INVALID_ARGUMENT names the variable.
absl::Status SetFlagsFromEnvironment(absl::string_view prefix, const EnvironmentLookup& getenv);

// Sets flags from --name=value, --name value, --switch and --noswitch; returns what is left, in order. "--" ends the
// flags. 'args' is without the program's name. INVALID_ARGUMENT for unknown flags and values that do not parse.
absl::StatusOr<std::vector<std::string>> ParseFlags(const std::vector<std::string>& args);

// Name, default and explanation of each flag, wrapped for a terminal. REQUIRES: the names exist.
std::string DescribeFlags(const std::vector<absl::string_view>& names);

}  // namespace holdfast
