// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "server/options.h"

namespace holdfast {

// What the flags say now, checked. NOT_FOUND when they name no weights and the shipped ones are not there.
absl::StatusOr<ServerOptions> OptionsFromFlags();

// Where the server listens that --healthcheck asks; nothing without that flag.
std::optional<std::string> AddressToCheck();

}  // namespace holdfast
