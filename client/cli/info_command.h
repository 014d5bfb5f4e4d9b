// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "api/types.h"

namespace holdfast {

// What a server runs and the limits it sets, for people.
std::string DescribeServer(const TrackerInfo& info);
// The same for programs; the names are those of the protocol.
std::string ServerAsJson(const TrackerInfo& info);

}  // namespace holdfast
