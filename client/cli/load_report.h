// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/cli/load_session.h"

namespace holdfast {

// A table: a line for each kind of client, and the errors that were not expected.
std::string DescribeLoad(const std::vector<LoadResult>& results, absl::Duration took);
std::string LoadAsJson(const std::vector<LoadResult>& results, absl::Duration took);

// INTERNAL where a healthy client saw an error, or where no healthy client got a session; the text says how many.
absl::Status CheckLoad(const std::vector<LoadResult>& results);

}  // namespace holdfast
