// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/point_check.h"

#include <cmath>

#include "absl/container/flat_hash_set.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

namespace holdfast {
namespace {

bool IsInside(float value, std::optional<int> size) {
  return std::isfinite(value) && value >= 0 && (!size || value <= *size - 1);
}

std::string WhyNot(float value, std::optional<int> size) {
  return size ? absl::StrCat(value, " is not in 0 .. ", *size - 1)
              : absl::StrCat(value, " is not a coordinate of a frame");
}

}  // namespace

absl::Status CheckPointCount(int64_t count, int64_t max_points) {
  if (count <= max_points) return absl::OkStatus();
  return OverloadError("points of a session", absl::StrCat("at most ", max_points), absl::ZeroDuration());
}

void CheckPosition(absl::string_view list, size_t index, const PointQuery& point, std::optional<ImageSize> frame,
                   Violations& violations) {
  const auto check = [&](absl::string_view member, float value, std::optional<int> size) {
    if (IsInside(value, size)) return;
    violations.AddMade([&] {
      return FieldViolation{absl::StrCat(list, "[", index, "]", member), WhyNot(value, size)};
    });
  };
  check(".x", point.x, frame ? std::optional<int>(frame->width) : std::nullopt);
  check(".y", point.y, frame ? std::optional<int>(frame->height) : std::nullopt);
}

Violations CheckPoints(absl::string_view list, const std::vector<PointQuery>& points, std::optional<ImageSize> frame) {
  Violations violations;
  absl::flat_hash_set<PointId> ids;
  for (size_t i = 0; i < points.size(); ++i) {
    if (!ids.insert(points[i].id).second) {
      violations.AddMade([&] {
        return FieldViolation{absl::StrCat(list, "[", i, "].id"),
                              absl::StrCat(points[i].id, " stands twice in this message")};
      });
    }
    CheckPosition(list, i, points[i], frame, violations);
  }
  return violations;
}

}  // namespace holdfast
