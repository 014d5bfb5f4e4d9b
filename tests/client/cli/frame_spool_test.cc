// SPDX-License-Identifier: Apache-2.0
#include "client/cli/frame_spool.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

// $TMPDIR as long as the object lives.
class TemporaryDirectory {
 public:
  explicit TemporaryDirectory(const std::string& path) { setenv("TMPDIR", path.c_str(), /*overwrite=*/1); }
  ~TemporaryDirectory() { unsetenv("TMPDIR"); }
};

TEST(FrameSpoolTest, GivesFramesBackInAnyOrderAndLeavesNoFile) {
  const TempDir dir;
  const TemporaryDirectory temporary(dir.path().string());
  auto spool = FrameSpool::Create();
  ASSERT_THAT(spool, IsOk());
  EXPECT_EQ(dir.Count(), 0u) << "nobody else sees the frames";
  const std::string large(3'000'000, 'x');
  for (const std::string& frame : {std::string("first"), large, std::string(), std::string("a\0b", 3)}) {
    ASSERT_THAT(spool->Append(frame), IsOk());
  }
  EXPECT_EQ(spool->size(), 4);
  EXPECT_THAT(spool->Read(3), IsOkAndHolds(std::string("a\0b", 3)));
  EXPECT_THAT(spool->Read(2), IsOkAndHolds(std::string()));
  EXPECT_THAT(spool->Read(1), IsOkAndHolds(large));
  EXPECT_THAT(spool->Read(0), IsOkAndHolds(std::string("first")));
}

TEST(FrameSpoolTest, ADirectoryThatTakesNoFilesIsNamed) {
  const TempDir dir;
  const TemporaryDirectory temporary(dir.File("none"));
  EXPECT_THAT(FrameSpool::Create(), StatusIs(absl::StatusCode::kNotFound,
                                             testing::AllOf(testing::HasSubstr("TMPDIR"), testing::HasSubstr("none"))));
}

}  // namespace
}  // namespace holdfast
