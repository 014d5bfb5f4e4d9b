// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <sys/resource.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "absl/strings/str_cat.h"
#include "server/checkpoint/key_ring.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

const char kSecret[] = "abababababababababababababababababababababababababababababababab";

class KeyFileTest : public ::testing::Test {
 protected:
  // Each time another file of the same name, as editors and platforms write it.
  void Write(const std::string& text) const {
    std::ofstream(path_ + ".new") << text;
    std::filesystem::rename(path_ + ".new", path_);
  }
  void WriteKey(const std::string& id) const { Write(absl::StrCat(id, ":", kSecret, "\n")); }
  void Open() {
    auto file = OpenKeyFile(path_, clock_, log_);
    ASSERT_THAT(file, IsOk());
    file_ = *std::move(file);
  }
  std::string SealingId() { return file_->Current()->sealing().id; }
  void Wait() { clock_.Advance(kFileCheckPeriod); }

  const TempDir dir_;
  const std::string path_ = dir_.File("keys");
  SimulatedClock clock_;
  std::ostringstream lines_;
  const std::shared_ptr<spdlog::logger> log_ =
      std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::ostream_sink_mt>(lines_));
  std::unique_ptr<KeyFile> file_;
};

TEST_F(KeyFileTest, AChangedFileIsReadAgainOnceASecond) {
  WriteKey("one");
  Open();
  EXPECT_EQ(SealingId(), "one");
  WriteKey("two");
  EXPECT_EQ(SealingId(), "one");
  Wait();
  EXPECT_EQ(SealingId(), "two");
  EXPECT_THAT(lines_.str(), AllOf(HasSubstr("sealing with two"), Not(HasSubstr(kSecret))));
}

TEST_F(KeyFileTest, KeysInUseStayWhatTheyAre) {
  WriteKey("one");
  Open();
  const auto keys = file_->Current();
  WriteKey("two");
  Wait();
  EXPECT_EQ(SealingId(), "two");
  EXPECT_EQ(keys->sealing().id, "one");
}

TEST_F(KeyFileTest, TheWallClockPlaysNoPart) {
  WriteKey("one");
  Open();
  WriteKey("two");
  clock_.SetWallBy(absl::Hours(24));
  EXPECT_EQ(SealingId(), "one");
}

TEST_F(KeyFileTest, AFileThatIsWrongOrGoneChangesNothingAndIsWarnedOfOnce) {
  WriteKey("one");
  Open();
  Wait();
  EXPECT_EQ(SealingId(), "one");
  EXPECT_THAT(lines_.str(), IsEmpty());
  Write("two:short\n");
  Wait();
  EXPECT_EQ(SealingId(), "one");
  EXPECT_THAT(lines_.str(), AllOf(HasSubstr("warning"), HasSubstr("stay as they were"), HasSubstr("line 1")));
  lines_.str("");
  Wait();
  EXPECT_EQ(SealingId(), "one");
  EXPECT_THAT(lines_.str(), IsEmpty());
  std::filesystem::remove(path_);
  Wait();
  EXPECT_EQ(SealingId(), "one");
  EXPECT_THAT(lines_.str(), HasSubstr("warning"));
  WriteKey("three");
  Wait();
  EXPECT_EQ(SealingId(), "three");
}

// With no descriptor left a file can be looked at, by root too, and not be read.
TEST_F(KeyFileTest, AFileThatCouldNotBeReadIsTriedAgainAndWarnedOfOnce) {
  WriteKey("one");
  Open();
  WriteKey("two");
  rlimit before;
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit none = {0, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &none), 0);
  for (int i = 0; i < 3; ++i) {
    Wait();
    EXPECT_EQ(SealingId(), "one");
  }
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &before), 0);
  const std::string lines = lines_.str();
  EXPECT_EQ(std::count(lines.begin(), lines.end(), '\n'), 1) << lines;
  EXPECT_THAT(lines, HasSubstr("stay as they were"));
  Wait();
  EXPECT_EQ(SealingId(), "two");
}

TEST_F(KeyFileTest, AServerDoesNotStartWithAWrongFile) {
  EXPECT_THAT(OpenKeyFile(path_, clock_, log_), StatusIs(absl::StatusCode::kNotFound, HasSubstr(path_)));
  Write("nonsense");
  EXPECT_THAT(OpenKeyFile(path_, clock_, log_),
              StatusIs(absl::StatusCode::kInvalidArgument, AllOf(HasSubstr(path_), HasSubstr("line 1"))));
  Write(std::string(kMaxWatchedFileBytes + 1, '#'));
  EXPECT_THAT(OpenKeyFile(path_, clock_, log_), StatusIs(absl::StatusCode::kResourceExhausted));
}

}  // namespace
}  // namespace holdfast
