// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "api/errors.h"
#include "api/types.h"

namespace holdfast {

// Whether a list can be within the limit of a session, before anything else is done with it.
absl::Status CheckPointCount(int64_t count, int64_t max_points);

// Adds what is wrong with the coordinates of element 'index' of 'list', fields named as "<list>[3].x": not finite, or
// outside a frame of size 'frame' (where it is known; else only negative).
void CheckPosition(absl::string_view list, size_t index, const PointQuery& point, std::optional<ImageSize> frame,
                   Violations& violations);

// What is wrong with the points of one message: their positions, and ids given twice.
Violations CheckPoints(absl::string_view list, const std::vector<PointQuery>& points, std::optional<ImageSize> frame);

}  // namespace holdfast
