// SPDX-License-Identifier: Apache-2.0
// Runs a fuzz target, which is linked to this file, on the inputs that are kept for it. Takes any compiler.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);
extern const char kFuzzCorpus[];  // the folder of the kept inputs

namespace holdfast {
namespace {

std::vector<std::filesystem::path> Corpus() {
  std::vector<std::filesystem::path> paths;
  for (const auto& entry : std::filesystem::directory_iterator(kFuzzCorpus)) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  return paths;
}

class ReplayTest : public ::testing::TestWithParam<std::filesystem::path> {};

TEST_P(ReplayTest, AKeptInputDoesNoHarm) {
  std::ifstream file(GetParam(), std::ios::binary);
  // As long as the input, so that reading beyond it is seen.
  const std::vector<uint8_t> input{std::istreambuf_iterator<char>(file), {}};
  ASSERT_FALSE(input.empty());
  EXPECT_EQ(LLVMFuzzerTestOneInput(input.data(), input.size()), 0);
}

TEST(NoInputTest, NoInputDoesNoHarm) { EXPECT_EQ(LLVMFuzzerTestOneInput(nullptr, 0), 0); }

INSTANTIATE_TEST_SUITE_P(Corpus, ReplayTest, ::testing::ValuesIn(Corpus()), [](const auto& info) {
  std::string name = info.param.filename().string();
  std::replace_if(
      name.begin(), name.end(), [](unsigned char c) { return std::isalnum(c) == 0; }, '_');
  return name;
});

}  // namespace
}  // namespace holdfast
