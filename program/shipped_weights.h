// SPDX-License-Identifier: Apache-2.0
// Where the weights are that come with the programs.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace holdfast {

// Where the shipped weights may lie for a program at 'program' (as ProgramPath has it), best place first:
//   PREFIX/share/holdfast/weights for PREFIX/bin/NAME, as an installation has it;
//   SOURCE/weights for SOURCE/build/PRESET/DIRECTORY/NAME, as a build of the source tree has it;
//   /usr/share/holdfast/weights, whatever 'program' is.
// The current directory plays no part: what a program tracks with does not depend on where it was started.
std::vector<std::string> ShippedWeightsPlaces(const std::string& program);

// The first of those places that is there. NOT_FOUND names them all.
absl::StatusOr<std::string> FindShippedWeights(const std::string& program);

}  // namespace holdfast
