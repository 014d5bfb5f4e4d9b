// SPDX-License-Identifier: Apache-2.0
// JSON that comes in files. The first byte chooses the reader, the rest is the text. What is taken can be written, and
// is read as the same.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "io/bounded_json.h"
#include "model/options.h"
#include "server/engine/tracks/calibration.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

void ReadJson(absl::string_view text) {
  constexpr JsonLimits kLimits{/*max_bytes=*/4096, /*max_depth=*/5};
  const auto json = ParseBoundedJson(text, kLimits);
  if (!json.ok()) return;
  EXPECT_LE(text.size(), kLimits.max_bytes);
  EXPECT_FALSE(json->is_discarded());
  EXPECT_THAT(ParseBoundedJson(json->dump(), {/*max_bytes=*/1 << 20, kLimits.max_depth}), IsOkAndHolds(*json));
}

void ReadCalibration(absl::string_view text) {
  const absl::StatusOr<Calibration> calibration = Calibration::FromJson(text);
  if (!calibration.ok()) return;
  const absl::StatusOr<Calibration> again = Calibration::FromJson(calibration->ToJson());
  ASSERT_THAT(again, IsOk());
  EXPECT_EQ(again->weights(), calibration->weights());
  const float confidence = calibration->Confidence({});
  EXPECT_GE(confidence, 0);
  EXPECT_LE(confidence, 1);
}

void ReadModelOptions(absl::string_view text) {
  const absl::StatusOr<ModelOptions> options = ModelOptionsFromJson(text);
  if (!options.ok()) return;
  EXPECT_THAT(options->Validate(), IsOk());
  EXPECT_THAT(ModelOptionsFromJson(ModelOptionsToJson(*options)), IsOkAndHolds(*options));
}

}  // namespace
}  // namespace holdfast

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  constexpr void (*kReaders[])(absl::string_view) = {holdfast::ReadJson, holdfast::ReadCalibration,
                                                     holdfast::ReadModelOptions};
  holdfast::FuzzInput input(data, size);
  const uint8_t reader = input.TakeByte() % 3;
  kReaders[reader](input.TakeRest());
  return 0;
}
