// SPDX-License-Identifier: Apache-2.0
#include "program/shipped_weights.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "program/program_path.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr char kInstalled[] = "/usr/share/holdfast/weights/small.safetensors";

void MakeFile(const std::string& path) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  std::ofstream(path) << "weights";
}

TEST(ShippedWeightsTest, AnInstalledProgramLooksBesideItself) {
  EXPECT_THAT(ShippedWeightsPlaces("/opt/holdfast/bin/holdfast-server"),
              ElementsAre("/opt/holdfast/share/holdfast/weights/small.safetensors", kInstalled));
  EXPECT_THAT(ShippedWeightsPlaces("/usr/bin/holdfast-server"), ElementsAre(kInstalled));
}

TEST(ShippedWeightsTest, AProgramOfABuildTreeLooksInItsSourceTree) {
  EXPECT_THAT(ShippedWeightsPlaces("/home/me/holdfast/build/release/bin/holdfast-server"),
              ElementsAre("/home/me/holdfast/build/release/share/holdfast/weights/small.safetensors",
                          "/home/me/holdfast/weights/small.safetensors", kInstalled));
}

TEST(ShippedWeightsTest, AProgramOfUnknownPlaceHasTheInstalledOnes) {
  EXPECT_THAT(ShippedWeightsPlaces(""), ElementsAre(kInstalled));
}

TEST(ShippedWeightsTest, TheFirstPlaceThatHasThemWins) {
  const TempDir dir;
  const std::string program = dir.File("build/release/bin/holdfast-server");
  MakeFile(dir.File("weights/small.safetensors"));
  auto found = FindShippedWeights(program);
  ASSERT_THAT(found, IsOk());
  EXPECT_EQ(*found, dir.File("weights/small.safetensors"));
  MakeFile(dir.File("build/release/share/holdfast/weights/small.safetensors"));
  found = FindShippedWeights(program);
  ASSERT_THAT(found, IsOk());
  EXPECT_EQ(*found, dir.File("build/release/share/holdfast/weights/small.safetensors"));
}

TEST(ShippedWeightsTest, AnErrorNamesEveryPlaceTried) {
  if (std::filesystem::exists(kInstalled)) GTEST_SKIP() << "weights are installed here";
  const TempDir dir;
  const std::string program = dir.File("build/release/bin/holdfast-server");
  EXPECT_THAT(FindShippedWeights(program),
              StatusIs(absl::StatusCode::kNotFound,
                       AllOf(HasSubstr(dir.File("build/release/share/holdfast/weights/small.safetensors")),
                             HasSubstr(dir.File("weights/small.safetensors")), HasSubstr(kInstalled))));
}

TEST(ProgramPathTest, DoesNotDependOnTheCurrentDirectory) {
  const std::string before = ProgramPath();
  EXPECT_TRUE(std::filesystem::path(before).is_absolute());
  EXPECT_TRUE(std::filesystem::is_regular_file(before));
  const auto start = std::filesystem::current_path();
  std::filesystem::current_path("/");
  EXPECT_EQ(ProgramPath(), before);
  std::filesystem::current_path(start);
}

}  // namespace
}  // namespace holdfast
