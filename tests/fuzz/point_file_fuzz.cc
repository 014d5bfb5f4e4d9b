// SPDX-License-Identifier: Apache-2.0
// Files of points. The first byte chooses the format, the rest is the file.
#include "client/cli/point_file.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <set>

#include "tests/fuzz/fuzz_input.h"

namespace holdfast {
namespace {

constexpr ImageSize kSize{64, 48};

void ExpectSound(const std::vector<StartPoint>& points) {
  std::set<PointId> ids;
  for (const StartPoint& point : points) {
    EXPECT_TRUE(ids.insert(point.query.id).second);
    EXPECT_GE(point.frame, 0);
    EXPECT_TRUE(point.query.x >= 0 && point.query.x <= static_cast<float>(kSize.width - 1)) << point.query.x;
    EXPECT_TRUE(point.query.y >= 0 && point.query.y <= static_cast<float>(kSize.height - 1)) << point.query.y;
  }
}

}  // namespace
}  // namespace holdfast

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  holdfast::FuzzInput input(data, size);
  const bool csv = input.TakeByte() % 2 == 0;
  const absl::string_view text = input.TakeRest();
  const auto points =
      csv ? holdfast::ParsePointsCsv(text, holdfast::kSize) : holdfast::ParsePointsJson(text, holdfast::kSize);
  if (points.ok()) holdfast::ExpectSound(*points);
  return 0;
}
