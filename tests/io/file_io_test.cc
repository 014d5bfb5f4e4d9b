// SPDX-License-Identifier: Apache-2.0
#include "io/file_io.h"

#include <gmock/gmock.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include "io/atomic_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::Eq;
using ::testing::HasSubstr;

constexpr int64_t kNoLimit = int64_t{1} << 40;

// Files written while it lives end at 'bytes': what a full disk does.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) : handler_(::signal(SIGXFSZ, SIG_IGN)) {
    ::getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limit = {bytes, before_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    ::signal(SIGXFSZ, handler_);
  }

 private:
  rlimit before_ = {};
  sighandler_t handler_;
};

TEST(FileIoTest, WhatWasWrittenIsRead) {
  const TempDir dir;
  const std::string bytes("a\0b\n", 4);
  ASSERT_THAT(WriteFileAtomically(dir.File("x"), bytes), IsOk());
  EXPECT_THAT(ReadFile(dir.File("x"), kNoLimit), IsOkAndHolds(Eq(bytes)));
  EXPECT_EQ(dir.Count(), 1);
}

TEST(FileIoTest, AnOlderFileIsReplaced) {
  const TempDir dir;
  ASSERT_THAT(WriteFileAtomically(dir.File("x"), "a longer text"), IsOk());
  ASSERT_THAT(WriteFileAtomically(dir.File("x"), "short"), IsOk());
  EXPECT_THAT(ReadFile(dir.File("x"), kNoLimit), IsOkAndHolds(Eq("short")));
}

TEST(FileIoTest, TheFileIsReadableByOthersButNotWritable) {
  const TempDir dir;
  const mode_t mask = ::umask(022);
  ASSERT_THAT(WriteFileAtomically(dir.File("x"), "x"), IsOk());
  ::umask(mask);
  struct stat info = {};
  ASSERT_EQ(::stat(dir.File("x").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0644u);
}

TEST(FileIoTest, AFullDiskLeavesTheOldFileAndNoTemporary) {
  const TempDir dir;
  ASSERT_THAT(WriteFileAtomically(dir.File("x"), "old"), IsOk());
  absl::Status status;
  {
    const FileSizeLimit limit(4096);
    status = WriteFileAtomically(dir.File("x"), std::string(100000, 'n'));
  }
  EXPECT_THAT(status, StatusIs(absl::ErrnoToStatusCode(EFBIG), HasSubstr("cannot write")));
  EXPECT_THAT(ReadFile(dir.File("x"), kNoLimit), IsOkAndHolds(Eq("old")));
  EXPECT_EQ(dir.Count(), 1);
}

TEST(FileIoTest, AFailedRenameLeavesNoTemporary) {
  const TempDir dir;
  std::filesystem::create_directory(dir.path() / "x");  // a file cannot take the place of a directory
  EXPECT_FALSE(WriteFileAtomically(dir.File("x"), "new").ok());
  EXPECT_EQ(dir.Count(), 1);
  EXPECT_TRUE(std::filesystem::is_directory(dir.path() / "x"));
}

TEST(FileIoTest, ADirectoryThatIsNotThereOrNotWritableIsReported) {
  EXPECT_THAT(WriteFileAtomically("/nonexistent/x", "x"), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_FALSE(WriteFileAtomically("/proc/x", "x").ok());  // nobody can create files there, root included
  const TempDir dir;
  std::filesystem::permissions(dir.path(), std::filesystem::perms::owner_read | std::filesystem::perms::owner_exec);
  if (::geteuid() != 0) {
    EXPECT_THAT(WriteFileAtomically(dir.File("x"), "x"), StatusIs(absl::StatusCode::kPermissionDenied));
  }
  std::filesystem::permissions(dir.path(), std::filesystem::perms::owner_all);
}

TEST(FileIoTest, ReadingSaysWhatIsWrong) {
  const TempDir dir;
  EXPECT_THAT(ReadFile(dir.File("none"), kNoLimit), StatusIs(absl::StatusCode::kNotFound, HasSubstr("none")));
  EXPECT_THAT(ReadFile(dir.path().string(), kNoLimit),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("not a regular file")));
  std::ofstream(dir.File("large")).put('x');
  std::filesystem::resize_file(dir.File("large"), 1 << 30);  // sparse: takes no disk
  EXPECT_THAT(ReadFile(dir.File("large"), 1 << 20),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("1073741824 bytes; at most 1048576")));
}

TEST(FileIoTest, APipeIsRefusedAtOnce) {
  const TempDir dir;
  ASSERT_EQ(::mkfifo(dir.File("pipe").c_str(), 0600), 0);
  EXPECT_THAT(ReadFile(dir.File("pipe"), kNoLimit), StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(Sha256Test, KnownDigests) {  // FIPS 180-2, appendix B.1, and the empty text
  EXPECT_EQ(Sha256Hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(Sha256Hex(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

}  // namespace
}  // namespace holdfast
