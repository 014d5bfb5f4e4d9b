// SPDX-License-Identifier: Apache-2.0
// What sessions get: tracks, early and final estimates, points that come and go, errors of a stream.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <utility>
#include <vector>

#include "tests/server/engine/engine_fixture.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

TEST_F(EngineTest, TracksAClipFromTheFirstFrameToTheLast) {
  RecordingListener listener;
  auto session = Open(Config({{7, 10, 20}}), listener);
  PushFrames(*session, listener, 0, 50);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  const FinalTrack track = listener.Final(7);
  ASSERT_THAT(track, SizeIs(50));
  for (const auto& [frame, sample] : track) {
    EXPECT_FLOAT_EQ(sample.x, 10 + 4.0f * frame);
    EXPECT_EQ(sample.y, 20);
    EXPECT_EQ(sample.visible, sample.x < 63.5f);
  }
  EXPECT_EQ(listener.summary().frames, 50);
  EXPECT_EQ(listener.summary().points, 1);
  EXPECT_EQ(listener.summary().final_samples, 50);
}

TEST_F(EngineTest, TellsWhoWantsToKnowOfItsWorkForEachSession) {
  RecordingListener listener, other;
  listener.want_work = true;
  auto session = Open(Config({{7, 10, 20}, {8, 20, 10}}), listener);
  auto beside = Open(Config({{1, 10, 20}}), other);
  PushFrames(*session, listener, 0, 50);
  PushFrames(*beside, other, 0, 30);
  session->Finish();
  beside->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_THAT(other.AwaitDone(), IsOk());
  std::map<Stage, int64_t> counts;
  for (const StageWork& work : listener.work()) {
    counts[work.stage] += work.count;
    EXPECT_LE(work.begin, work.end);
    EXPECT_GE(work.first_frame, 0);
    EXPECT_LT(work.first_frame, 50);
  }
  EXPECT_EQ(counts[Stage::kDecode], 50);
  EXPECT_EQ(counts[Stage::kEncode], 50);
  EXPECT_GE(counts[Stage::kRefine], 2 * (50 - 24) / 8);  // a window of each point every hop
  EXPECT_GE(counts[Stage::kEmit], 2);
  EXPECT_THAT(other.work(), IsEmpty());
}

TEST_F(EngineTest, EncodesEveryFrameOnceWhateverThePointsAndWindows) {
  RecordingListener listener;
  std::vector<PointQuery> points;
  for (PointId id = 0; id < 100; ++id) points.push_back({id, 1, 1});
  auto session = Open(Config(points, /*hop=*/1), listener);
  PushFrames(*session, listener, 0, 60);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_EQ(counts_->frames, 60);
  EXPECT_GE(counts_->rows, 100 * 37);
  EXPECT_THAT(listener.Final(99), SizeIs(60));
}

TEST_F(EngineTest, APointDoesNotDependOnOthersNorOnHowItCame) {
  RecordingListener alone, crowd;
  {
    auto session = Open(Config({}), alone);
    PushFrames(*session, alone, 0, 10);
    ASSERT_THAT(alone.Push(*session, MakeFrame(10, {{5, 30, 10}})), IsOk());
    PushFrames(*session, alone, 11, 60);
    session->Finish();
    EXPECT_THAT(alone.AwaitDone(), IsOk());
  }
  std::vector<PointQuery> points;
  for (PointId id = 100; id < 150; ++id) points.push_back({id, 3, 3});
  auto session = Open(Config(points), crowd);
  PushFrames(*session, crowd, 0, 11);
  ASSERT_THAT(session->AddPoints({{5, 30, 10}}), IsOk());
  ASSERT_THAT(session->RemovePoints({100, 101}), IsOk());
  PushFrames(*session, crowd, 11, 60);
  session->Finish();
  EXPECT_THAT(crowd.AwaitDone(), IsOk());
  EXPECT_THAT(crowd.Final(5), SizeIs(50));
  EXPECT_EQ(crowd.Final(5), alone.Final(5));
}

TEST_F(EngineTest, SendsProvisionalEstimatesOnlyToWhoWantsThem) {
  RecordingListener with, without;
  SessionConfig config = Config({{1, 1, 1}});
  auto first = Open(config, with);
  config.send_provisional = false;
  auto second = Open(config, without);
  for (auto* pair : {&with, &without}) {
    auto& session = pair == &with ? *first : *second;
    PushFrames(session, *pair, 0, 40);
    session.Finish();
    EXPECT_THAT(pair->AwaitDone(), IsOk());
  }
  bool provisional = false;
  for (const TrackUpdate& update : with.updates()) {
    for (const PointRun& run : update.runs) provisional |= run.final_count < static_cast<int64_t>(run.x.size());
  }
  EXPECT_TRUE(provisional);
  for (const TrackUpdate& update : without.updates()) {
    for (const PointRun& run : update.runs) EXPECT_EQ(run.final_count, static_cast<int64_t>(run.x.size()));
  }
  EXPECT_EQ(with.Final(1), without.Final(1));
}

TEST_F(EngineTest, GivesAnEarlyEstimateBeforeTheWindowIsFull) {
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}}), listener);
  PushFrames(*session, listener, 0, 8);
  listener.AwaitUpdates(1);
  const TrackUpdate update = listener.updates().at(0);
  ASSERT_THAT(update.runs, SizeIs(1));
  EXPECT_EQ(update.runs[0].final_count, 1);
  EXPECT_THAT(update.runs[0].x, SizeIs(8));
  EXPECT_EQ(update.frames_received, 8);
  EXPECT_EQ(update.frames_processed, 8);
}

TEST_F(EngineTest, ASessionWithoutPointsHearsHowFarItIs) {
  RecordingListener listener;
  auto session = Open(Config(), listener);
  const auto processed = [&] { return listener.updates().back().frames_processed; };
  for (int64_t i = 0; i < 5; ++i) {
    PushFrames(*session, listener, i, i + 1);
    listener.AwaitUpdates(i + 1);  // who goes by it sends no other frame before
    EXPECT_EQ(processed(), i + 1);
  }
  ASSERT_THAT(listener.Push(*session, MakeFrame(5, {{1, 1, 1}})), IsOk());
  PushFrames(*session, listener, 6, 13);  // a hop of the point's frames
  listener.AwaitUpdates(6);
  EXPECT_THAT(listener.updates().back().runs, SizeIs(1));
  ASSERT_THAT(session->RemovePoints({1}), IsOk());
  PushFrames(*session, listener, 13, 14);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_EQ(processed(), 14);
  EXPECT_EQ(listener.summary().frames, 14);
}

std::string Jpeg() {
  std::vector<uint8_t> bytes;
  cv::imencode(".jpg", cv::Mat(kFrame.height, kFrame.width, CV_8UC3, cv::Scalar(9, 9, 9)), bytes);
  return {bytes.begin(), bytes.end()};
}

TEST_F(EngineTest, ABadFrameKeepsTheResultsOfTheFramesBeforeIt) {
  RecordingListener listener;
  SessionConfig config = Config({{1, 1, 1}});
  config.encoding = FrameEncoding::kJpeg;
  config.raw_size = {};
  auto session = Open(config, listener);
  for (int64_t i = 0; i < 30; ++i) ASSERT_THAT(listener.Push(*session, {i, Jpeg()}), IsOk());
  // Its parts are right but for the tables that are missing: found out by the decode pool.
  const std::string bad(
      "\xFF\xD8\xFF\xC0\x00\x0B\x08\x00\x20\x00\x40\x01\x01\x11\x00"
      "\xFF\xDA\x00\x08\x01\x01\x00\x00\x3F\x00\xFF\xD9",
      27);
  ASSERT_THAT(listener.Push(*session, {30, bad}), IsOk());
  const absl::Status status = listener.AwaitDone();
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("frame 30")));
  EXPECT_THAT(listener.Final(1), SizeIs(30));
  EXPECT_EQ(session->PushFrame({31, Jpeg()}).status(), status);
  EXPECT_EQ(metrics_.totals().frames[FrameResult::kRejected], 1);
  EXPECT_EQ(metrics_.totals().closed[SessionOutcome::kClientError], 1);
}

TEST_F(EngineTest, FailingTracksWhatCameBeforeToTheEnd) {
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}}), listener);
  PushFrames(*session, listener, 0, 30);
  const absl::Status wrong = listener.Push(*session, {30, "short"}).status();
  EXPECT_THAT(wrong, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("frame 30: 5 bytes, expected 2048")));
  session->Fail(wrong);
  EXPECT_EQ(listener.AwaitDone(), wrong);
  EXPECT_THAT(listener.Final(1), SizeIs(30));
  EXPECT_EQ(metrics_.totals().frames[FrameResult::kRejected], 1);
}

TEST_F(EngineTest, RemovedAndReSeededPointsEndAndStartWhereTheyShould) {
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}, {2, 2, 2}}), listener);
  PushFrames(*session, listener, 0, 25);
  ASSERT_THAT(session->RemovePoints({1}), IsOk());
  PushFrames(*session, listener, 25, 40);
  ASSERT_THAT(listener.Push(*session, MakeFrame(40, {{2, 40, 2}, {1, 20, 5}})), IsOk());
  PushFrames(*session, listener, 41, 70);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  const FinalTrack removed = listener.Final(1), seeded = listener.Final(2);
  EXPECT_EQ(removed.count(24), 1u);  // where it was removed
  EXPECT_EQ(removed.count(25), 0u);
  EXPECT_EQ(removed.count(39), 0u);
  EXPECT_EQ(removed.at(40).x, 20);
  EXPECT_FLOAT_EQ(seeded.at(39).x, 2 + 39 * 4);
  EXPECT_EQ(seeded.at(40).x, 40);
  EXPECT_FLOAT_EQ(seeded.at(69).x, 40 + 29 * 4);
  EXPECT_EQ(listener.summary().points, 4);
}

TEST_F(EngineTest, ASessionFullOfFramesToPolishGoesOnWhenTheyArePolished) {
  for (int round = 0; round < 100; ++round) {  // it takes a polish that ends when nothing else is left to do
    RecordingListener listener;
    auto session = Open(Config({{1, 1, 1}, {2, 2, 2}}), listener);
    PushFrames(*session, listener, 0, 40);
    ASSERT_THAT(listener.Push(*session, MakeFrame(40, {{2, 40, 2}, {1, 20, 5}})), IsOk());
    PushFrames(*session, listener, 41, 72);
    session->Finish();
    EXPECT_THAT(listener.AwaitDone(), IsOk());
  }
}

TEST_F(EngineTest, OfPointsReSeededAtOneFrameTheLastSeedsAreTrackedAndAllAreCounted) {
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}, {2, 2, 2}}), listener);
  for (int i = 0; i < 50; ++i) ASSERT_THAT(session->AddPoints({{1, static_cast<float>(i), 5}}), IsOk());
  PushFrames(*session, listener, 0, 10);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_EQ(listener.Final(1).at(0).x, 49);
  EXPECT_FLOAT_EQ(listener.Final(1).at(9).x, 49 + 9 * 4);
  EXPECT_FLOAT_EQ(listener.Final(2).at(9).x, 2 + 9 * 4);
  EXPECT_EQ(listener.summary().points, 52);
}

TEST_F(EngineTest, SessionsOfDifferentSizesShareTheEngine) {
  RecordingListener small, large;
  auto first = Open(Config({{1, 1, 1}}), small);
  SessionConfig config = Config({{1, 1, 1}});
  config.processing_size = {128, 64};
  auto second = Open(config, large);
  for (int64_t i = 0; i < 40; ++i) {
    PushFrames(*first, small, i, i + 1);
    PushFrames(*second, large, i, i + 1);
  }
  first->Finish();
  second->Finish();
  EXPECT_THAT(small.AwaitDone(), IsOk());
  EXPECT_THAT(large.AwaitDone(), IsOk());
  EXPECT_FLOAT_EQ(small.Final(1).at(39).x, 1 + 39 * 4.0f);
  EXPECT_FLOAT_EQ(large.Final(1).at(39).x, 1 + 39 * 2.0f);  // half a feature pixel is two pixels of this frame
}

TEST_F(EngineTest, AnEmptySessionEndsWell) {
  RecordingListener listener;
  auto session = Open(Config({{1, 1, 1}}), listener);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_THAT(listener.updates(), IsEmpty());
}

TEST_F(EngineTest, ASessionOfOneFrameReportsTheQueries) {
  RecordingListener listener;
  auto session = Open(Config({{1, 1.25f, 1}}), listener);
  PushFrames(*session, listener, 0, 1);
  session->Finish();
  EXPECT_THAT(listener.AwaitDone(), IsOk());
  EXPECT_EQ(listener.Final(1), (FinalTrack{{0, {1.25f, 1, true, 1}}}));
  EXPECT_EQ(counts_->rows, 0);
}

}  // namespace
}  // namespace holdfast
