// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "absl/strings/string_view.h"
#include "proto/errors.h"
#include "proto/types.h"

namespace holdfast {

// What is wrong with the points of one message, fields named as "<list>[3].x": coordinates that are not finite or
// outside a frame of size 'frame' (where it is known; else only negative ones), and ids given twice.
std::vector<FieldViolation> CheckPoints(absl::string_view list, const std::vector<PointQuery>& points,
                                        std::optional<ImageSize> frame);

}  // namespace holdfast
