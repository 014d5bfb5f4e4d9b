// SPDX-License-Identifier: Apache-2.0
#include "program/flags.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <sstream>

#include "absl/flags/flag.h"
#include "absl/flags/reflection.h"

ABSL_FLAG(int, side_length, 7, "Length of a side in pixels, long enough an explanation that it has to be wrapped");
ABSL_FLAG(std::string, place, "here", "Where");
ABSL_FLAG(bool, loud, false, "Be loud");

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;

class ProgramFlagsTest : public ::testing::Test {
 protected:
  EnvironmentLookup Environment() {
    return [this](const char* name) {
      const auto found = environment_.find(name);
      return found == environment_.end() ? nullptr : found->second.c_str();
    };
  }
  std::map<std::string, std::string> environment_;

 private:
  absl::FlagSaver saver_;
};

TEST_F(ProgramFlagsTest, ReadsEveryWayOfWritingAFlagAndReturnsTheRestInOrder) {
  const auto rest = ParseFlags({"first", "--side_length=9", "second", "-place", "there", "--loud", "third"});
  ASSERT_TRUE(rest.ok()) << rest.status();
  EXPECT_THAT(*rest, ElementsAre("first", "second", "third"));
  EXPECT_EQ(absl::GetFlag(FLAGS_side_length), 9);
  EXPECT_EQ(absl::GetFlag(FLAGS_place), "there");
  EXPECT_TRUE(absl::GetFlag(FLAGS_loud));
}

TEST_F(ProgramFlagsTest, ASwitchDoesNotSwallowTheNextArgument) {
  EXPECT_THAT(*ParseFlags({"--loud", "false"}), ElementsAre("false"));
  EXPECT_TRUE(absl::GetFlag(FLAGS_loud));
  EXPECT_THAT(*ParseFlags({"--noloud"}), IsEmpty());
  EXPECT_FALSE(absl::GetFlag(FLAGS_loud));
}

TEST_F(ProgramFlagsTest, TwoDashesEndTheFlagsAndOneDashIsAnArgument) {
  EXPECT_THAT(*ParseFlags({"-", "--", "--loud"}), ElementsAre("-", "--loud"));
  EXPECT_FALSE(absl::GetFlag(FLAGS_loud));
}

TEST_F(ProgramFlagsTest, WrongFlagsAreErrorsThatNameThem) {
  EXPECT_THAT(std::string(ParseFlags({"--sidelength=3"}).status().message()), HasSubstr("unknown flag --sidelength"));
  EXPECT_THAT(std::string(ParseFlags({"--side_length=wide"}).status().message()), HasSubstr("--side_length"));
  EXPECT_THAT(std::string(ParseFlags({"--place"}).status().message()), HasSubstr("--place needs a value"));
  EXPECT_EQ(ParseFlags({"--noplace"}).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(ProgramFlagsTest, FlagsOfTheFlagLibraryItselfAreNotOurs) {
  EXPECT_FALSE(ParseFlags({"--flagfile=/etc/passwd"}).ok());
}

TEST_F(ProgramFlagsTest, TheEnvironmentSetsFlagsAndTheCommandLineHasTheLastWord) {
  environment_ = {{"TEST_SIDE_LENGTH", "3"}, {"TEST_PLACE", "far"}, {"OTHER_LOUD", "true"}};
  ASSERT_TRUE(SetFlagsFromEnvironment("TEST_", Environment()).ok());
  EXPECT_EQ(absl::GetFlag(FLAGS_side_length), 3);
  EXPECT_FALSE(absl::GetFlag(FLAGS_loud));
  ASSERT_TRUE(ParseFlags({"--side_length=4"}).ok());
  EXPECT_EQ(absl::GetFlag(FLAGS_side_length), 4);
  EXPECT_EQ(absl::GetFlag(FLAGS_place), "far");
}

TEST_F(ProgramFlagsTest, AWrongValueInTheEnvironmentNamesTheVariable) {
  environment_ = {{"TEST_SIDE_LENGTH", "three"}};
  EXPECT_THAT(std::string(SetFlagsFromEnvironment("TEST_", Environment()).message()), HasSubstr("TEST_SIDE_LENGTH"));
}

TEST_F(ProgramFlagsTest, FlagsOnlyProgramsRefuseOtherArguments) {
  environment_ = {{"HOLDFAST_SIDE_LENGTH", "3"}, {"HOLDFAST_PORT", "tcp://10.0.0.1:50051"}};
  ASSERT_TRUE(SetFlags({"--place=far"}, Environment()).ok());
  EXPECT_EQ(absl::GetFlag(FLAGS_side_length), 3);
  EXPECT_EQ(absl::GetFlag(FLAGS_place), "far");
  ASSERT_TRUE(SetFlags({"--side_length=4"}, Environment()).ok());
  EXPECT_EQ(absl::GetFlag(FLAGS_side_length), 4);
  EXPECT_THAT(std::string(SetFlags({"video.mp4"}, Environment()).message()), HasSubstr("\"video.mp4\""));
  EXPECT_FALSE(SetFlags({"--plaice=far"}, Environment()).ok());
}

TEST_F(ProgramFlagsTest, HelpNamesEveryFlagOfTheProgramAndNoOther) {
  std::ostringstream out;
  EXPECT_TRUE(AnswerQuestion({"prog", "prog FILE"}, {"--loud", "--help"}, out));
  EXPECT_THAT(out.str(), StartsWith("prog FILE\n\n  --loud\n"));
  for (const char* flag : {"--place", "--side_length=7"}) EXPECT_THAT(out.str(), HasSubstr(flag));
  EXPECT_THAT(out.str(), Not(HasSubstr("flagfile")));
}

TEST_F(ProgramFlagsTest, TheVersionIsAnsweredAndOtherArgumentsAreNot) {
  std::ostringstream out;
  EXPECT_FALSE(AnswerQuestion({"prog", ""}, {"--loud"}, out));
  EXPECT_EQ(out.str(), "");
  EXPECT_TRUE(AnswerQuestion({"prog", ""}, {"--version"}, out));
  EXPECT_EQ(out.str(), "prog " + std::string(ProgramVersion()) + "\n");
}

TEST_F(ProgramFlagsTest, DescriptionsShowTheDefaultAndWrapTheText) {
  const std::string text = DescribeFlags({"side_length", "loud"});
  EXPECT_THAT(text, HasSubstr("  --side_length=7\n      Length of a side in pixels"));
  EXPECT_THAT(text, HasSubstr("has to be\n      wrapped\n"));
  EXPECT_THAT(text, HasSubstr("  --loud\n"));
  EXPECT_THAT(text, Not(HasSubstr("place")));
}

}  // namespace
}  // namespace holdfast
