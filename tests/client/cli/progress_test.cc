// SPDX-License-Identifier: Apache-2.0
#include "client/cli/progress.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

namespace holdfast {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

class ProgressTest : public ::testing::Test {
 protected:
  Progress::Options Options(bool terminal, int64_t total) {
    return {terminal, total, [this] { return now_; }};
  }
  SteadyTime now_;
  std::ostringstream out_;
};

TEST_F(ProgressTest, ATerminalShowsABarWithRateAndLag) {
  Progress progress(Options(true, 40), out_);
  now_ += std::chrono::seconds(2);
  progress.Update(20, 7);
  EXPECT_EQ(out_.str(), "\r[###############...............] 20/40 frames  10.0 frames/s  lag 7\x1b[K");
}

TEST_F(ProgressTest, ATerminalIsRedrawnAtMostTenTimesASecond) {
  Progress progress(Options(true, 40), out_);
  now_ += std::chrono::milliseconds(99);
  progress.Update(1, 0);
  EXPECT_THAT(out_.str(), IsEmpty());
  now_ += std::chrono::milliseconds(1);
  progress.Update(2, 0);
  EXPECT_THAT(out_.str(), HasSubstr("2/40"));
}

TEST_F(ProgressTest, ALogGetsAPlainLineEveryFiveSeconds) {
  Progress progress(Options(false, 0), out_);
  now_ += std::chrono::seconds(4);
  progress.Update(8, 1);
  EXPECT_THAT(out_.str(), IsEmpty());
  now_ += std::chrono::seconds(1);
  progress.Update(10, 1);
  EXPECT_EQ(out_.str(), "10 frames  2.0 frames/s  lag 1\n");
}

TEST_F(ProgressTest, ClosingDrawsTheLastStateOnce) {
  Progress progress(Options(true, 40), out_);
  now_ += std::chrono::milliseconds(50);
  progress.Update(40, 0);
  progress.Close();
  EXPECT_THAT(out_.str(), HasSubstr("] 40/40"));
  EXPECT_THAT(out_.str(), EndsWith("\n"));
  const std::string closed = out_.str();
  now_ += std::chrono::seconds(9);
  progress.Update(41, 0);
  progress.Close();
  EXPECT_EQ(out_.str(), closed);
}

TEST_F(ProgressTest, ALogDoesNotSayTheSameTwice) {
  Progress progress(Options(false, 10), out_);
  now_ += std::chrono::seconds(5);
  progress.Update(10, 0);
  const std::string said = out_.str();
  progress.Close();
  EXPECT_EQ(out_.str(), said);
}

TEST_F(ProgressTest, WhatInterruptsABarHasALineOfItsOwn) {
  Progress progress(Options(true, 40), out_);
  progress.Interrupt();
  EXPECT_THAT(out_.str(), IsEmpty());
  now_ += std::chrono::seconds(1);
  progress.Update(20, 7);
  progress.Interrupt();
  EXPECT_THAT(out_.str(), EndsWith("lag 7\x1b[K\n"));
  const std::string ended = out_.str();
  progress.Interrupt();
  EXPECT_EQ(out_.str(), ended);
}

TEST_F(ProgressTest, MoreFramesThanAnnouncedDoNotBreakTheBar) {
  Progress progress(Options(true, 10), out_);
  now_ += std::chrono::seconds(1);
  progress.Update(15, 0);
  EXPECT_THAT(out_.str(), HasSubstr("[##############################] 15/10"));
  EXPECT_THAT(out_.str(), Not(HasSubstr(".]")));
}

}  // namespace
}  // namespace holdfast
