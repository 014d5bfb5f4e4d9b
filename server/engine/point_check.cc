// SPDX-License-Identifier: Apache-2.0
#include "server/engine/point_check.h"

#include <cmath>

#include "absl/container/flat_hash_set.h"
#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

void CheckCoordinate(const std::string& field, float value, std::optional<int> size,
                     std::vector<FieldViolation>& violations) {
  if (std::isfinite(value) && value >= 0 && (!size || value <= *size - 1)) return;
  violations.push_back({field, size ? absl::StrCat(value, " is not in 0 .. ", *size - 1)
                                    : absl::StrCat(value, " is not a coordinate of a frame")});
}

}  // namespace

std::vector<FieldViolation> CheckPoints(absl::string_view list, const std::vector<PointQuery>& points,
                                        std::optional<ImageSize> frame) {
  std::vector<FieldViolation> violations;
  std::optional<int> width, height;
  if (frame) {
    width = frame->width;
    height = frame->height;
  }
  absl::flat_hash_set<PointId> ids;
  for (size_t i = 0; i < points.size(); ++i) {
    const std::string point = absl::StrCat(list, "[", i, "]");
    if (!ids.insert(points[i].id).second) {
      violations.push_back({point + ".id", absl::StrCat(points[i].id, " stands twice in this message")});
    }
    CheckCoordinate(point + ".x", points[i].x, width, violations);
    CheckCoordinate(point + ".y", points[i].y, height, violations);
  }
  return violations;
}

}  // namespace holdfast
