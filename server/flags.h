// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/options.h"

namespace holdfast {

// Sets every flag of the server whose variable HOLDFAST_<FLAG> exists, e.g. HOLDFAST_MAX_SESSIONS for --max_sessions.
// Other HOLDFAST_ variables are left alone: Kubernetes makes such for a service of that name. 'getenv' returns null
// for what is not set.
absl::Status SetFlagsFromEnvironment(const std::function<const char*(const std::string&)>& getenv);

// What the flags say now, checked.
absl::StatusOr<ServerOptions> OptionsFromFlags();

// What --help and --version say. Call it once, before ParseOptions.
void DescribeProgram();

// The environment, then the command line, which wins. Exits on --help and on flags that do not exist.
absl::StatusOr<ServerOptions> ParseOptions(int argc, char** argv);

}  // namespace holdfast
