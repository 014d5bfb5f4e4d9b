// SPDX-License-Identifier: Apache-2.0
#include "server/streams/outbox.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <random>
#include <utility>
#include <vector>

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr int64_t kNoLimit = int64_t{1} << 40;

PointRun MakeRun(PointId id, int64_t first_frame, std::vector<float> x, int64_t final_count) {
  const size_t n = x.size();
  return {id, first_frame, x, x, std::vector<uint8_t>(n, 1), std::vector<float>(n, 1), final_count};
}

TrackUpdate Update(std::vector<PointRun> runs, int64_t frames = 1) { return {std::move(runs), frames, frames}; }

TEST(OutboxTest, NewerEstimatesReplaceOlderOnesOfTheSameFrames) {
  Outbox outbox;
  outbox.Add(Update({MakeRun(1, 10, {1, 2, 3}, 1)}));
  outbox.Add(Update({MakeRun(1, 11, {20, 30, 40}, 2)}));
  const TrackUpdate update = outbox.Take(kNoLimit);
  ASSERT_THAT(update.runs, SizeIs(1));
  EXPECT_EQ(update.runs[0].first_frame, 10);
  EXPECT_THAT(update.runs[0].x, ElementsAre(1, 20, 30, 40));
  EXPECT_EQ(update.runs[0].final_count, 3);
  EXPECT_TRUE(outbox.empty());
  EXPECT_EQ(outbox.bytes(), 0);
}

TEST(OutboxTest, FinalSamplesThatWereNotSentAreNeverLost) {
  Outbox outbox;
  for (int64_t frame = 0; frame < 100; ++frame) outbox.Add(Update({MakeRun(1, frame, {float(frame)}, 1)}));
  const TrackUpdate update = outbox.Take(kNoLimit);
  ASSERT_THAT(update.runs, SizeIs(1));
  EXPECT_THAT(update.runs[0].x, SizeIs(100));
  EXPECT_EQ(update.runs[0].final_count, 100);
}

TEST(OutboxTest, TellsWhetherWhatWasMarkedStillWaits) {
  Outbox outbox;
  outbox.Mark();
  EXPECT_FALSE(outbox.marked_waits());
  outbox.Add(Update({MakeRun(1, 0, {1, 2, 3, 4}, 0), MakeRun(2, 0, {1}, 0)}));
  outbox.Mark();
  outbox.Add(Update({MakeRun(2, 0, {5}, 0), MakeRun(3, 0, {1}, 0)}));  // one is merged, one is later
  EXPECT_TRUE(outbox.marked_waits());
  EXPECT_THAT(outbox.Take(1).runs, SizeIs(1));  // the first sample of point 1, whose other ones still wait
  while (outbox.marked_waits()) {
    for (const PointRun& run : outbox.Take(61).runs) EXPECT_NE(run.id, 3U);
  }
  EXPECT_FALSE(outbox.empty());
  EXPECT_EQ(outbox.Take(kNoLimit).runs[0].id, 3U);
}

TEST(OutboxTest, RunsThatDoNotFitTogetherKeepTheirOrder) {
  Outbox outbox;
  outbox.Add(Update({MakeRun(1, 0, {1}, 1)}));
  outbox.Add(Update({MakeRun(1, 5, {6}, 1)}));     // a gap
  outbox.Add(Update({MakeRun(1, 6, {7, 8}, 0)}));  // joins the second
  outbox.Add(Update({MakeRun(1, 7, {9}, 1)}));     // final after a provisional one
  outbox.Add(Update({MakeRun(1, 2, {3}, 0)}));     // earlier
  const TrackUpdate update = outbox.Take(kNoLimit);
  std::vector<int64_t> starts;
  for (const PointRun& run : update.runs) starts.push_back(run.first_frame);
  EXPECT_THAT(starts, ElementsAre(0, 5, 7, 2));
}

TEST(OutboxTest, AWindowThatRevisesInstantEstimatesJoinsThem) {
  Outbox outbox;
  outbox.Add(Update({MakeRun(1, 20, {1, 2, 3, 4}, 0)}));     // instant ones of frames 20 .. 23
  outbox.Add(Update({MakeRun(1, 17, {5, 6, 7, 8, 9}, 2)}));  // a window up to frame 21
  const TrackUpdate update = outbox.Take(kNoLimit);
  ASSERT_THAT(update.runs, SizeIs(1));
  EXPECT_EQ(update.runs[0].first_frame, 17);
  EXPECT_THAT(update.runs[0].x, ElementsAre(5, 6, 7, 8, 9, 3, 4));
  EXPECT_EQ(update.runs[0].final_count, 2);
  EXPECT_EQ(outbox.bytes(), 0);
}

TEST(OutboxTest, CaptureTimesComeWithTheResultsOfTheirFrames) {
  Outbox outbox;
  TrackUpdate update = Update({MakeRun(1, 4, {1, 2}, 2), MakeRun(2, 5, {3}, 0)});
  update.capture_times = {{4, absl::FromUnixSeconds(40)}, {5, absl::FromUnixSeconds(50)}};
  outbox.Add(update);
  const TrackUpdate first = outbox.Take(80);  // one run
  ASSERT_THAT(first.runs, SizeIs(1));
  ASSERT_THAT(first.capture_times, SizeIs(2));
  EXPECT_EQ(first.capture_times[1].frame, 5);
  EXPECT_EQ(first.capture_times[1].capture_time, absl::FromUnixSeconds(50));
  const TrackUpdate second = outbox.Take(80);
  ASSERT_THAT(second.capture_times, SizeIs(1)) << "the frame's other result";
  EXPECT_EQ(second.capture_times[0].frame, 5);
}

TEST(OutboxTest, ProvisionalUpdatesOfTheSameFramesDoNotAddUp) {
  Outbox outbox;
  outbox.Add(Update({MakeRun(1, 0, std::vector<float>(24, 1), 0)}));
  const int64_t once = outbox.bytes();
  for (int i = 0; i < 1000; ++i) outbox.Add(Update({MakeRun(1, 0, std::vector<float>(24, float(i)), 0)}));
  EXPECT_EQ(outbox.bytes(), once);
}

TEST(OutboxTest, AWatermarkAloneIsWorthAMessageOnce) {
  Outbox outbox;
  outbox.Add(Update({}, 3));
  ASSERT_FALSE(outbox.empty());
  const TrackUpdate update = outbox.Take(kNoLimit);
  EXPECT_THAT(update.runs, IsEmpty());
  EXPECT_EQ(update.frames_processed, 3);
  outbox.Add(Update({}, 3));
  EXPECT_TRUE(outbox.empty());
}

TEST(OutboxTest, TheWatermarkComesWithTheLastOfTheResults) {
  Outbox outbox;
  outbox.Add(Update({MakeRun(1, 0, {1}, 1), MakeRun(2, 0, {1}, 1)}, 9));
  EXPECT_EQ(outbox.Take(70).frames_processed, 0);
  EXPECT_EQ(outbox.Take(70).frames_processed, 9);
  EXPECT_TRUE(outbox.empty());
}

TEST(OutboxTest, ALongRunIsSplit) {
  Outbox outbox;
  outbox.Add(Update({MakeRun(1, 100, std::vector<float>(1000, 1), 500)}));
  int64_t next = 100;
  int64_t finals = 0;
  while (!outbox.empty()) {
    const TrackUpdate part = outbox.Take(4000);
    ASSERT_THAT(part.runs, SizeIs(1));
    EXPECT_EQ(part.runs[0].first_frame, next);
    EXPECT_LE(part.runs[0].x.size(), 310U);
    next += static_cast<int64_t>(part.runs[0].x.size());
    finals += part.runs[0].final_count;
  }
  EXPECT_EQ(next, 1100);
  EXPECT_EQ(finals, 500);
  EXPECT_EQ(outbox.bytes(), 0);
}

// What a client knows after a sequence of updates.
class Reader {
 public:
  void Apply(const TrackUpdate& update) {
    for (const PointRun& run : update.runs) {
      for (size_t i = 0; i < run.x.size(); ++i) {
        known[{run.id, run.first_frame + static_cast<int64_t>(i)}] = {run.x[i],
                                                                      static_cast<int64_t>(i) < run.final_count};
      }
    }
  }
  std::map<std::pair<PointId, int64_t>, std::pair<float, bool>> known;
};

TEST(OutboxTest, CoalescedUpdatesTellTheSameAsTheUpdatesThemselves) {
  std::mt19937 random(7);
  for (int round = 0; round < 200; ++round) {
    Outbox outbox;
    Reader direct;
    Reader coalesced;
    for (int i = 0; i < 40; ++i) {
      const int64_t length = 1 + random() % 6;
      std::vector<float> x(length);
      for (float& value : x) value = static_cast<float>(random() % 1000);
      const TrackUpdate update = Update({MakeRun(random() % 3, random() % 12, x, random() % (length + 1))}, i);
      direct.Apply(update);
      outbox.Add(update);
      if (random() % 5 == 0 && !outbox.empty()) coalesced.Apply(outbox.Take(1 + random() % 300));
    }
    while (!outbox.empty()) coalesced.Apply(outbox.Take(1 + random() % 300));
    EXPECT_EQ(outbox.bytes(), 0);
    ASSERT_EQ(coalesced.known, direct.known) << "round " << round;
  }
}

ObjectRun MakeObjectRun(int64_t first_frame, const std::vector<float>& x, int64_t final_count) {
  ObjectRun run{3, first_frame, {}, final_count};
  for (const float value : x) run.samples.push_back({{value, 0}, 1, 0, 1, {}, {}});
  return run;
}
std::vector<float> Centres(const ObjectRun& run) {
  std::vector<float> x;
  for (const ObjectSample& sample : run.samples) x.push_back(sample.centre.x);
  return x;
}

TEST(OutboxTest, WhatIsSaidOfObjectsIsCoalescedToo) {
  Outbox outbox;
  TrackUpdate update = Update({MakeRun(1, 10, {1}, 0)});
  update.objects = {MakeObjectRun(10, {1, 2, 3}, 1)};
  outbox.Add(update);
  update.objects = {MakeObjectRun(11, {20, 30, 40}, 2)};
  outbox.Add(update);
  const TrackUpdate taken = outbox.Take(kNoLimit);
  ASSERT_THAT(taken.objects, SizeIs(1));
  EXPECT_THAT(Centres(taken.objects[0]), ElementsAre(1, 20, 30, 40));
  EXPECT_EQ(taken.objects[0].final_count, 3);
  EXPECT_TRUE(outbox.empty());
  EXPECT_EQ(outbox.bytes(), 0);
}

TEST(OutboxTest, ObjectsComeBehindTheirPointsAndInPieces) {
  Outbox outbox;
  TrackUpdate update = Update({MakeRun(1, 0, {1, 2}, 0)});
  update.objects = {MakeObjectRun(0, {1, 2, 3}, 2)};
  outbox.Add(update);
  outbox.Mark();
  EXPECT_THAT(outbox.Take(48 + 13).objects, IsEmpty());
  std::vector<float> centres;
  int64_t finals = 0;
  while (outbox.marked_waits()) {
    for (const ObjectRun& run : outbox.Take(90).objects) {
      for (const float x : Centres(run)) centres.push_back(x);
      finals += run.final_count;
    }
  }
  EXPECT_THAT(centres, ElementsAre(1, 2, 3));
  EXPECT_EQ(finals, 2);
  EXPECT_EQ(outbox.bytes(), 0);
}

}  // namespace
}  // namespace holdfast
