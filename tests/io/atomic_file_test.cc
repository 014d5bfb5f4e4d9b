// SPDX-License-Identifier: Apache-2.0
#include "io/atomic_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

namespace fs = std::filesystem;

using ::testing::HasSubstr;

std::string Content(std::ifstream file) {
  std::stringstream out;
  out << file.rdbuf();
  return out.str();
}

std::function<absl::Status(const std::string&)> Text(const std::string& text) {
  return [text](const std::string& temporary) {
    std::ofstream(temporary) << text;
    return absl::OkStatus();
  };
}

// Restores the process's umask.
class ScopedUmask {
 public:
  explicit ScopedUmask(mode_t mask) : old_(::umask(mask)) {}
  ~ScopedUmask() { ::umask(old_); }

 private:
  const mode_t old_;
};

TEST(RemoveTemporaryFilesTest, RemovesWhatAKilledProcessLeftAndNothingElse) {
  const TempDir dir;
  const PendingFile pending(dir.File("weights.safetensors"));
  std::ofstream(pending.temporary()) << "half";
  const PendingFile without_suffix(dir.File("weights"));
  std::ofstream(without_suffix.temporary()) << "half";
  for (const char* name : {"weights.safetensors", ".holdfast-notes.tmp", ".holdfast-0123456789abcdef", "x.tmp"}) {
    std::ofstream(dir.File(name)) << "of others";
  }
  RemoveTemporaryFiles(dir.path().string());
  EXPECT_FALSE(fs::exists(pending.temporary()));
  EXPECT_FALSE(fs::exists(without_suffix.temporary()));
  EXPECT_EQ(dir.Count(), 4u);
  RemoveTemporaryFiles(dir.File("no such directory"));
}

// Gives up root's rights as long as it lives.
class ScopedNobody {
 public:
  ScopedNobody() { EXPECT_EQ(::seteuid(65534), 0); }
  ~ScopedNobody() { EXPECT_EQ(::seteuid(0), 0); }
};

// A directory of root's that all may write to.
class ForeignFileTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (::geteuid() != 0) GTEST_SKIP() << "only root can make files that are somebody else's";
  }
  void MakeFile(const std::string& name, mode_t mode) {
    std::ofstream(dir_.File(name)) << "the longer old one";
    ASSERT_EQ(::chmod(dir_.File(name).c_str(), mode), 0);
  }
  void AllowRenaming(bool others) { ASSERT_EQ(::chmod(dir_.path().c_str(), others ? 0777 : 01777), 0); }

  const TempDir dir_;
};

TEST_F(ForeignFileTest, AFileThatCannotBeReplacedIsWrittenInPlace) {
  AllowRenaming(false);
  MakeFile("result.txt", 0666);
  const ScopedNobody nobody;
  ASSERT_THAT(CheckWritable(dir_.File("result.txt")), IsOk());
  ASSERT_THAT(WriteFileAtomically(dir_.File("result.txt"), "new"), IsOk());
  EXPECT_EQ(Content(std::ifstream(dir_.File("result.txt"))), "new");
  EXPECT_EQ(dir_.Count(), 1u);
}

TEST_F(ForeignFileTest, WhatCannotBeWrittenAtAllIsKeptAndNamed) {
  AllowRenaming(false);
  MakeFile("result.txt", 0644);
  const ScopedNobody nobody;
  std::string kept;
  const absl::Status failed = WriteAtomically(dir_.File("result.txt"), [&](const std::string& temporary) {
    kept = temporary;
    return Text("new")(temporary);
  });
  EXPECT_THAT(failed, StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr(kept)));
  EXPECT_EQ(Content(std::ifstream(kept)), "new");
  EXPECT_EQ(Content(std::ifstream(dir_.File("result.txt"))), "the longer old one");
}

TEST_F(ForeignFileTest, AFileThatMayNotBeWrittenToIsRefusedBeforehand) {
  AllowRenaming(true);
  MakeFile("result.txt", 0644);
  const ScopedNobody nobody;
  EXPECT_THAT(CheckWritable(dir_.File("result.txt")),
              StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr("result.txt")));
  EXPECT_EQ(dir_.Count(), 1u);
}

TEST(WriteAtomicallyTest, TheFileHasItsNameOnlyWhenItIsWhole) {
  const TempDir dir;
  const std::string path = dir.File("result.npz");
  const absl::Status written = WriteAtomically(path, [&](const std::string& temporary) {
    EXPECT_EQ(fs::path(temporary).parent_path(), dir.path()) << "a name is only taken over within a file system";
    EXPECT_EQ(fs::path(temporary).extension(), ".npz") << "libraries choose the format by it";
    std::ofstream(temporary) << "whole";
    EXPECT_FALSE(fs::exists(path));
    return absl::OkStatus();
  });
  ASSERT_THAT(written, IsOk());
  EXPECT_EQ(Content(std::ifstream(path)), "whole");
  EXPECT_EQ(dir.Count(), 1u);
}

TEST(WriteAtomicallyTest, WhoReadsTheOldFileKeepsIt) {
  const TempDir dir;
  const std::string path = dir.File("result.txt");
  ASSERT_THAT(WriteAtomically(path, Text("the old one")), IsOk());
  std::ifstream reader(path);
  ASSERT_THAT(WriteAtomically(path, Text("new")), IsOk());
  EXPECT_EQ(Content(std::move(reader)), "the old one");
  EXPECT_EQ(Content(std::ifstream(path)), "new");
}

TEST(WriteAtomicallyTest, AFailedWriteLeavesTheOldFileAndNothingBesides) {
  const TempDir dir;
  for (const bool there_is_an_old_one : {false, true}) {
    const std::string path = dir.File("result.txt");
    if (there_is_an_old_one) std::ofstream(path) << "old";
    const absl::Status failed = WriteAtomically(path, [](const std::string& temporary) {
      std::ofstream(temporary) << "half";
      return absl::DataLossError("the disk is full");
    });
    EXPECT_THAT(failed, StatusIs(absl::StatusCode::kDataLoss, HasSubstr("result.txt: the disk is full")));
    EXPECT_EQ(dir.Count(), there_is_an_old_one ? 1u : 0u);
    EXPECT_EQ(Content(std::ifstream(path)), there_is_an_old_one ? "old" : "");
  }
}

TEST(WriteAtomicallyTest, AWriterThatMadeNoFileIsAnError) {
  const TempDir dir;
  const std::string path = dir.File("result.txt");
  const absl::Status failed = WriteAtomically(path, [](const std::string&) { return absl::OkStatus(); });
  EXPECT_FALSE(failed.ok());
  EXPECT_THAT(failed.message(), HasSubstr(path));
  EXPECT_EQ(dir.Count(), 0u);
}

TEST(WriteAtomicallyTest, ANameThatIsTakenByADirectoryLeavesNothingBeside) {
  const TempDir dir;
  const std::string path = dir.File("result.txt");
  fs::create_directory(path);
  const absl::Status failed = WriteAtomically(path, Text("new"));
  EXPECT_FALSE(failed.ok());
  EXPECT_THAT(failed.message(), HasSubstr(path));
  EXPECT_TRUE(fs::is_directory(path));
  EXPECT_EQ(dir.Count(), 1u);
}

TEST(WriteAtomicallyTest, TheUmaskDecidesWhoMayReadTheFile) {
  const TempDir dir;
  const ScopedUmask umask(027);
  ASSERT_THAT(WriteAtomically(dir.File("result.txt"), Text("new")), IsOk());
  EXPECT_EQ(fs::status(dir.File("result.txt")).permissions(), static_cast<fs::perms>(0640));
}

TEST(WriteAtomicallyTest, AFileThatIsReplacedHandsOnItsMode) {
  const TempDir dir;
  for (const mode_t mode : {0600, 0664}) {
    std::ofstream(dir.File("result.txt")) << "old";
    ASSERT_EQ(::chmod(dir.File("result.txt").c_str(), mode), 0);
    ASSERT_THAT(WriteFileAtomically(dir.File("result.txt"), "new"), IsOk());
    EXPECT_EQ(fs::status(dir.File("result.txt")).permissions(), static_cast<fs::perms>(mode));
  }
}

TEST(WriteAtomicallyTest, FilesOfADirectoryAreWrittenAtTheSameTime) {
  const TempDir dir;
  const absl::Status written = WriteAtomically(dir.File("a.txt"), [&](const std::string& temporary) {
    std::ofstream(temporary) << "a";
    return WriteAtomically(dir.File("b.txt"), Text("b"));
  });
  ASSERT_THAT(written, IsOk());
  EXPECT_EQ(Content(std::ifstream(dir.File("a.txt"))), "a");
  EXPECT_EQ(Content(std::ifstream(dir.File("b.txt"))), "b");
}

TEST(WriteAtomicallyTest, ALinkStaysOneAndItsFileIsWritten) {
  const TempDir dir, other;
  std::ofstream(other.File("old.txt")) << "old";
  fs::create_symlink(other.File("old.txt"), dir.File("far.txt"));
  fs::create_symlink("far.txt", dir.File("near.txt"));
  fs::create_symlink("new.txt", dir.File("dangling.txt"));
  for (const char* name : {"near.txt", "dangling.txt"}) {
    ASSERT_THAT(CheckWritable(dir.File(name)), IsOk());
    ASSERT_THAT(WriteAtomically(dir.File(name), Text(name)), IsOk());
    EXPECT_TRUE(fs::is_symlink(dir.File(name)));
  }
  EXPECT_EQ(Content(std::ifstream(other.File("old.txt"))), "near.txt");
  EXPECT_EQ(Content(std::ifstream(dir.File("new.txt"))), "dangling.txt");
  EXPECT_EQ(dir.Count(), 4u);
  EXPECT_EQ(other.Count(), 1u);
}

TEST(WriteAtomicallyTest, APipeStaysOneAndItsReaderGetsTheBytes) {
  const TempDir dir;
  const std::string path = dir.File("pipe.csv");
  ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
  ASSERT_THAT(CheckWritable(path), IsOk());
  std::string read;
  std::thread reader([&] { read = Content(std::ifstream(path)); });
  EXPECT_THAT(WriteAtomically(path, Text("all of it")), IsOk());
  reader.join();
  EXPECT_EQ(read, "all of it");
  EXPECT_TRUE(fs::is_fifo(path));
  EXPECT_EQ(dir.Count(), 1u);
}

// By a link of its own, so that a wrong rename takes the link and not the machine's device.
TEST(WriteAtomicallyTest, ADeviceStaysOne) {
  const TempDir dir;
  fs::create_symlink("/dev/null", dir.File("null.json"));
  ASSERT_THAT(CheckWritable(dir.File("null.json")), IsOk());
  ASSERT_THAT(WriteFileAtomically(dir.File("null.json"), "{}"), IsOk());
  EXPECT_TRUE(fs::is_character_file(dir.File("null.json")));
  EXPECT_TRUE(fs::is_symlink(dir.File("null.json")));
}

TEST(CheckWritableTest, AFileThatIsThereIsNotTouched) {
  const TempDir dir;
  std::ofstream(dir.File("a.json")) << "old";
  EXPECT_THAT(CheckWritable(dir.File("a.json")), IsOk());
  EXPECT_EQ(Content(std::ifstream(dir.File("a.json"))), "old");
  EXPECT_EQ(dir.Count(), 1u) << "what was tried is gone";
}

TEST(CheckWritableTest, AFileThatIsNotThereIsNotMade) {
  const TempDir dir;
  EXPECT_THAT(CheckWritable(dir.File("a.json")), IsOk());
  EXPECT_EQ(dir.Count(), 0u);
  EXPECT_THAT(CheckWritable("a.json"), IsOk()) << "the working directory needs no name";
}

TEST(CheckWritableTest, WhereNoFileCanBeMadeIsNamed) {
  const TempDir dir;
  const absl::Status nobody = CheckWritable("/proc/a.json");  // not even root makes files there
  EXPECT_FALSE(nobody.ok());
  EXPECT_THAT(nobody.message(), HasSubstr("/proc/a.json"));
  EXPECT_THAT(CheckWritable(dir.File("no/a.json")), StatusIs(absl::StatusCode::kNotFound, HasSubstr("/no")));
  EXPECT_THAT(CheckWritable(dir.path().string()),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(dir.path().string())));
}

}  // namespace
}  // namespace holdfast
