// SPDX-License-Identifier: Apache-2.0
// Of programs that hold the tests of several source files: --source=x_test.cc runs those of one, as ctest does; other
// arguments are GoogleTest's.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <iostream>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"

namespace {

// Takes every test of other files out of the filter. False: there is none of this one.
bool SelectSource(absl::string_view source) {
  const ::testing::UnitTest& all = *::testing::UnitTest::GetInstance();
  const std::string end = absl::StrCat("/", source);
  std::vector<std::string> others;
  bool found = false;
  for (int i = 0; i < all.total_test_suite_count(); ++i) {
    const ::testing::TestSuite& suite = *all.GetTestSuite(i);
    for (int j = 0; j < suite.total_test_count(); ++j) {
      const ::testing::TestInfo& test = *suite.GetTestInfo(j);
      const bool wanted = absl::EndsWith(test.file(), end);
      found = found || wanted;
      if (!wanted) others.push_back(absl::StrCat(suite.name(), ".", test.name()));
    }
  }
  std::string filter = GTEST_FLAG_GET(filter);
  if (!others.empty()) absl::StrAppend(&filter, absl::StrContains(filter, '-') ? ":" : "-", absl::StrJoin(others, ":"));
  GTEST_FLAG_SET(filter, filter);
  return found;
}

}  // namespace

int main(int argc, char** argv) {
  ::testing::InitGoogleMock(&argc, argv);
  for (int i = 1; i < argc; ++i) {
    absl::string_view argument = argv[i];
    if (absl::ConsumePrefix(&argument, "--source=") && SelectSource(argument)) continue;
    std::cerr << argv[0] << ": " << argv[i] << ": there is no such test, or argument\n";
    return 2;
  }
  return RUN_ALL_TESTS();
}
