// SPDX-License-Identifier: Apache-2.0
#include "client/cli/answer_times.h"

#include <gtest/gtest.h>

#include <chrono>

namespace holdfast {
namespace {

TrackUpdate UpdateOf(int64_t first, size_t count) {
  TrackUpdate update;
  update.runs.push_back({1, first, std::vector<float>(count)});
  return update;
}

TEST(AnswerTimesTest, CountsTheFirstEstimateOfEachFrame) {
  SteadyTime now;
  AnswerTimes times([&now] { return now; });
  EXPECT_EQ(times.Summary(), "");
  for (int i = 0; i < 4; ++i) {
    times.Sent();
    now += std::chrono::milliseconds(100);
  }
  EXPECT_EQ(times.Answered(UpdateOf(0, 2)), 2);  // after 400 and 300 ms
  now += std::chrono::milliseconds(1000);
  EXPECT_EQ(times.Answered(UpdateOf(0, 2)), 2) << "revised, not answered again";
  EXPECT_EQ(times.Answered(UpdateOf(2, 2)), 4);  // after 1200 and 1100 ms
  EXPECT_EQ(times.Answered(UpdateOf(2, 50)), 4) << "frames that were not sent";
  EXPECT_EQ(times.answered(), 4);
  EXPECT_EQ(times.Summary(), "first estimate of a frame after 400 ms (median), 1200 ms (95 % of frames)\n");
}

TEST(AnswerTimesTest, FramesBeforeTheFirstPointDoNotWait) {
  SteadyTime now;
  AnswerTimes times([&now] { return now; });
  for (int i = 0; i < 10; ++i) {
    times.Sent();
    now += std::chrono::milliseconds(100);
  }
  EXPECT_EQ(times.Answered(TrackUpdate()), 0);
  EXPECT_EQ(times.Answered(UpdateOf(8, 2)), 10);  // after 200 and 100 ms
  EXPECT_EQ(times.answered(), 10);
  EXPECT_EQ(times.Summary(), "first estimate of a frame after 100 ms (median), 200 ms (95 % of frames)\n");
}

}  // namespace
}  // namespace holdfast
