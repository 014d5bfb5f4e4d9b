// SPDX-License-Identifier: Apache-2.0
#include "client/cli/live_bound.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <deque>
#include <utility>

#include "absl/time/time.h"

namespace holdfast {
namespace {

// A line that carries a frame in 'each', and the way there and back.
struct Line {
  absl::Duration each;
  absl::Duration way;
};

struct Seen {
  int64_t bound;
  absl::Duration longest_wait;  // of a frame, after the first few
};

// Sends 100 frames as fast as the bound lets them.
Seen Follow(const Line& line) {
  LiveBound bound;
  SteadyTime now, free;
  std::deque<std::pair<SteadyTime, SteadyTime>> under_way;  // sent and answered at
  Seen seen{0, absl::ZeroDuration()};
  for (int64_t answered = 0; answered < 100;) {
    while (static_cast<int64_t>(under_way.size()) < bound.frames()) {
      free = std::max(free, now) + absl::ToChronoNanoseconds(line.each);
      under_way.emplace_back(now, free + absl::ToChronoNanoseconds(line.way));
    }
    now = under_way.front().second;
    if (answered >= 50) seen.longest_wait = std::max(seen.longest_wait, Between(under_way.front().first, now));
    under_way.pop_front();
    bound.Answered(++answered, now);
  }
  seen.bound = bound.frames();
  return seen;
}

TEST(LiveBoundTest, FramesDoNotGrowOldOnAThinLine) {
  const Seen seen = Follow({absl::Milliseconds(800), absl::Milliseconds(50)});  // 200 kB at 2 Mbit/s
  EXPECT_EQ(seen.bound, 2);
  EXPECT_LE(seen.longest_wait, absl::Milliseconds(1700));
  EXPECT_LE(Follow({absl::Milliseconds(300), absl::Milliseconds(50)}).longest_wait, absl::Milliseconds(1300));
}

TEST(LiveBoundTest, ALineThatCarriesMoreIsFilled) {
  EXPECT_EQ(Follow({absl::Milliseconds(10), absl::Milliseconds(5)}).bound, 8);
  EXPECT_EQ(Follow({absl::Milliseconds(10), absl::Milliseconds(200)}).bound, 8);  // far away
  EXPECT_EQ(Follow({absl::Milliseconds(10), absl::Milliseconds(600)}).bound, 8);
}

TEST(LiveBoundTest, BeginsCarefullyAndCountsARevisionForNoAnswer) {
  LiveBound bound;
  SteadyTime now;
  EXPECT_EQ(bound.frames(), 2);
  for (int i = 0; i < 20; ++i) bound.Answered(1, now += std::chrono::milliseconds(1));
  EXPECT_EQ(bound.frames(), 2);
  for (int i = 2; i < 8; ++i) bound.Answered(i, now += std::chrono::milliseconds(100));
  EXPECT_EQ(bound.frames(), 8);
  bound.Answered(9, now += std::chrono::seconds(3));
  EXPECT_EQ(bound.frames(), 2) << "a line that has become thin";
}

}  // namespace
}  // namespace holdfast
