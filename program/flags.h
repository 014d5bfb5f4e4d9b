// SPDX-License-Identifier: Apache-2.0
// The front of every program: --help, --version, and its flags.
//
// Fills absl flags from the environment and the command line without ending the process: absl's own parser exits with
// code 1 on a wrong flag and on --help, and cannot be tested in-process.
#pragma once

#include <functional>
#include <ostream>
#include <string>
#include <vector>

#include "absl/flags/commandlineflag.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace holdfast {

struct Program {
  absl::string_view name;   // "holdfast-server"
  absl::string_view usage;  // what --help says above the flags
};

absl::string_view ProgramVersion();

// Answers --help (usage and every flag) or --version on 'out' if either is among 'args'; the program then ends well.
bool AnswerQuestion(const Program& program, const std::vector<std::string>& args, std::ostream& out);

// As std::getenv: null when the variable is not set.
using EnvironmentLookup = std::function<const char*(const char*)>;

// Flag "max_side" is set from variable "<prefix>MAX_SIDE" where that exists. Call it before ParseFlags, so that the
// command line has the last word. INVALID_ARGUMENT names the variable.
absl::Status SetFlagsFromEnvironment(absl::string_view prefix, const EnvironmentLookup& getenv);

// Sets flags from --name=value, --name value, --switch and --noswitch; returns what is left, in order. "--" ends the
// flags. 'args' is without the program's name. INVALID_ARGUMENT for unknown flags and values that do not parse.
absl::StatusOr<std::vector<std::string>> ParseFlags(const std::vector<std::string>& args);

// Both, with the prefix "HOLDFAST_", for programs that take flags only: INVALID_ARGUMENT for anything else.
absl::Status SetFlags(const std::vector<std::string>& args, const EnvironmentLookup& getenv);

// Every flag of the program, by name; none of the flag library's own.
std::vector<const absl::CommandLineFlag*> ProgramFlags();

// Name, default and explanation of each flag, wrapped for a terminal. REQUIRES: the names exist.
std::string DescribeFlags(const std::vector<absl::string_view>& names);

}  // namespace holdfast
