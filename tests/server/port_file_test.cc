// SPDX-License-Identifier: Apache-2.0
#include "server/port_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

std::string TextOf(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

TEST(PortFileTest, SaysTheOpenPortsWhileTheServerRuns) {
  const TempDir dir;
  const std::string path = dir.File("ports");
  std::ofstream(path) << "grpc=1\n";
  EXPECT_THAT(PreparePortFile(path), IsOk());
  EXPECT_FALSE(std::filesystem::exists(path)) << "it was an earlier run's";
  EXPECT_THAT(WritePortFile(path, {{"grpc", 2}, {"web", 0}}), IsOk());
  EXPECT_EQ(TextOf(path), "grpc=2\n");
  RemovePortFile(path);
  EXPECT_TRUE(std::filesystem::is_empty(std::filesystem::path(path).parent_path()));
  RemovePortFile(path);
}

TEST(PortFileTest, APlaceThatCannotBeWrittenToIsFoundAtOnce) {
  const TempDir dir;
  EXPECT_FALSE(PreparePortFile(dir.File("none/ports")).ok());
}

TEST(PortFileTest, WhatIsNoFileStays) {
  EXPECT_THAT(PreparePortFile("/dev/null"), IsOk());
  RemovePortFile("/dev/null");
  EXPECT_TRUE(std::filesystem::exists("/dev/null"));
}

}  // namespace
}  // namespace holdfast
