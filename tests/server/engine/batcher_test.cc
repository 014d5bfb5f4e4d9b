// SPDX-License-Identifier: Apache-2.0
#include "server/engine/batcher.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/fake_tracker_model.h"
#include "tests/support/recorders.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr ImageSize kWide{64, 32}, kSquare{32, 32};

// A session without threads: frames are decoded as they are pushed, windows have 4 frames and come every 2. The pixels
// of frame i have the value 'first_value' + i.
class Stream {
 public:
  struct Options {
    ImageSize size = kWide;
    int iterations = 4;
    int first_value = 0;
    int64_t max_cached_frames = 16;
    bool early = false;  // windows before they are full
  };
  explicit Stream(const Options& options) : options_(options) {
    Session::Options session;
    session.accepted.processing_size = options.size;
    session.accepted.iterations = options.iterations;
    session.inbox.format = {FrameEncoding::kGray8, options.size, 1 << 20};
    session.inbox.limits = {/*max_points=*/100, /*max_frame_bytes=*/1 << 20, /*max_frame_pixels=*/1 << 20, 0};
    session.windows.frames = 4;
    session.windows.hop = 2;
    session.windows.early = options.early;
    session.provisional = false;
    session.max_cached_frames = options.max_cached_frames;
    const Session::Threads inline_jobs{[](const std::function<void()>& job) { job(); }, [] {}};
    session_ = std::make_shared<Session>(session, listener_, clock_, metrics_, inline_jobs, nullptr);
  }

  Session* get() { return session_.get(); }
  const RecordingListener& listener() const { return listener_; }
  FakeTrackerModel& model() { return model_; }

  void AddPoints(const std::vector<PointQuery>& points) { ASSERT_THAT(session_->AddPoints(points), IsOk()); }
  void Push(int count) {
    for (int i = 0; i < count; ++i, ++pushed_) {
      const char value = static_cast<char>(options_.first_value + pushed_);
      const size_t pixels = static_cast<size_t>(options_.size.width) * static_cast<size_t>(options_.size.height);
      ASSERT_THAT(session_->PushFrame({pushed_, std::string(pixels, value), {}, {}}), IsOk());
    }
  }
  // Pushes frames whose features are there at once.
  void Admit(int count) {
    Push(count);
    for (const DecodedFrame& frame : session_->TakeFrames(count)) {
      const RgbImage* image = &frame.image;
      session_->Admit(frame, model_.Encode({&image, 1}).front(), model_);
    }
  }

 private:
  const Options options_;
  FakeTrackerModel model_{4};
  SimulatedClock clock_;
  RecordingMetrics metrics_;
  RecordingListener listener_;
  std::shared_ptr<Session> session_;
  int64_t pushed_ = 0;
};

std::vector<int64_t> Indices(const FrameBatch::Part& part) {
  std::vector<int64_t> indices;
  for (const DecodedFrame& frame : part.frames) indices.push_back(frame.index);
  return indices;
}

std::vector<int> Values(const WindowGroup& group) {
  std::vector<int> values;
  for (const FrameFeaturesPtr& frame : group.frames) values.push_back(FakeTrackerModel::ValueOf(*frame));
  return values;
}

// Of the queries, feature pixels: the fake network's templates hold it.
std::vector<float> QueriedAt(const WindowGroup& group) {
  std::vector<float> x;
  for (const WindowRow& row : group.rows) x.push_back(row.feature[1]);
  return x;
}

TEST(FairSharesTest, WhoWantsLittleGetsItAndTheRestIsShared) {
  EXPECT_THAT(FairShares({1000, 1}, 50), ElementsAre(49, 1));
  EXPECT_THAT(FairShares({10, 10, 10}, 7), ElementsAre(3, 2, 2));
  EXPECT_THAT(FairShares({1, 2, 100}, 12), ElementsAre(1, 2, 9));
  EXPECT_THAT(FairShares({0, 5}, 4), ElementsAre(0, 4));
  EXPECT_THAT(FairShares({1, 1}, 50), ElementsAre(1, 1));
  EXPECT_THAT(FairShares({5, 5, 5}, 2), ElementsAre(1, 1, 0));
  EXPECT_THAT(FairShares({5, 5}, 0), ElementsAre(0, 0));
  EXPECT_THAT(FairShares({}, 5), IsEmpty());
}

TEST(TakeFrameBatchTest, TheFirstSessionThatHasFramesDecidesTheSize) {
  Stream idle({kWide}), full({kWide, 4, 0, /*max_cached_frames=*/0});
  Stream first({kSquare}), other({kWide}), second({kSquare});
  full.Push(1);
  first.Push(3);
  other.Push(2);
  second.Push(1);
  const FrameBatch batch = TakeFrameBatch({idle.get(), full.get(), first.get(), other.get(), second.get()}, 10);
  ASSERT_THAT(batch.parts, SizeIs(2));
  EXPECT_EQ(batch.parts[0].session, first.get());
  EXPECT_THAT(Indices(batch.parts[0]), ElementsAre(0, 1, 2));
  EXPECT_EQ(batch.parts[1].session, second.get());
  EXPECT_THAT(Indices(batch.parts[1]), ElementsAre(0));
  EXPECT_EQ(first.get()->FramesReady(), 0) << "they were taken";
  EXPECT_EQ(other.get()->FramesReady(), 2);
}

TEST(TakeFrameBatchTest, RoomIsSharedAndWhatIsLeftComesNext) {
  Stream a({}), b({}), c({});
  a.Push(5);
  b.Push(5);
  c.Push(1);
  const FrameBatch batch = TakeFrameBatch({a.get(), b.get(), c.get()}, 6);
  ASSERT_THAT(batch.parts, SizeIs(3));
  EXPECT_THAT(Indices(batch.parts[0]), ElementsAre(0, 1, 2));
  EXPECT_THAT(Indices(batch.parts[1]), ElementsAre(0, 1));
  EXPECT_THAT(Indices(batch.parts[2]), ElementsAre(0));
  const FrameBatch next = TakeFrameBatch({b.get(), c.get(), a.get()}, 4);
  ASSERT_THAT(next.parts, SizeIs(2)) << "one has no frame any more";
  EXPECT_EQ(next.parts[0].session, b.get());
  EXPECT_THAT(Indices(next.parts[0]), ElementsAre(2, 3));
  EXPECT_THAT(Indices(next.parts[1]), ElementsAre(3, 4));
}

TEST(TakeFrameBatchTest, WhoGetsNoShareHasNoPart) {
  Stream a({}), b({}), c({});
  for (Stream* stream : {&a, &b, &c}) stream->Push(1);
  EXPECT_THAT(TakeFrameBatch({a.get(), b.get(), c.get()}, 2).parts, SizeIs(2));
  EXPECT_EQ(c.get()->FramesReady(), 1);
  EXPECT_THAT(TakeFrameBatch({a.get(), b.get()}, 2).parts, IsEmpty());
}

TEST(MakeRowBatchTest, TheFirstSessionThatHasRowsDecidesTheIterations) {
  Stream waits({kWide, /*iterations=*/9}), a({kWide, 4, 10}), other({kWide, 6, 30}), b({kSquare, 4, 50});
  waits.AddPoints({{1, 8, 8}});
  waits.Admit(3);
  a.AddPoints({{1, 8, 8}, {2, 16, 8}});
  other.AddPoints({{1, 8, 8}});
  b.AddPoints({{7, 24, 8}});
  for (Stream* stream : {&a, &other, &b}) stream->Admit(4);
  const RowBatch batch = MakeRowBatch({waits.get(), a.get(), other.get(), b.get()}, 10);
  EXPECT_EQ(batch.iterations, 4);
  EXPECT_EQ(batch.rows, 3);
  ASSERT_THAT(batch.parts, SizeIs(2));
  EXPECT_EQ(batch.parts[0].session, a.get());
  EXPECT_EQ(batch.parts[1].session, b.get());
  ASSERT_THAT(batch.groups, SizeIs(2)) << "no group has rows of two sessions";
  EXPECT_THAT(Values(batch.groups[0]), ElementsAre(10, 11, 12, 13));
  const float shift = a.get()->tracks().geometry().ToFeatures(8, 8).x;
  EXPECT_THAT(QueriedAt(batch.groups[0]), ElementsAre(shift, shift + 1)) << "8 pixels are one of the features";
  EXPECT_THAT(Values(batch.groups[1]), ElementsAre(50, 51, 52, 53));
  EXPECT_THAT(batch.groups[1].rows, SizeIs(1));
}

// Points 1 and 2 of frame 0 are due on frames 0 to 3, points 3 and 4 of frame 2 on frames 2 to 5.
void TwoWindows(Stream& stream) {
  stream.AddPoints({{1, 8, 8}, {2, 16, 8}});
  stream.Admit(3);
  stream.AddPoints({{3, 24, 8}, {4, 32, 8}});
  stream.Admit(3);
}

TEST(MakeRowBatchTest, RowsOfOneWindowShareItsFrames) {
  Stream stream({kWide, 4, 10});
  TwoWindows(stream);
  const RowBatch batch = MakeRowBatch({stream.get()}, 10);
  EXPECT_EQ(batch.rows, 4);
  ASSERT_THAT(batch.groups, SizeIs(2));
  EXPECT_THAT(Values(batch.groups[0]), ElementsAre(10, 11, 12, 13));
  EXPECT_THAT(batch.groups[0].rows, SizeIs(2));
  EXPECT_THAT(Values(batch.groups[1]), ElementsAre(12, 13, 14, 15));
  EXPECT_THAT(batch.groups[1].rows, SizeIs(2));
}

TEST(MakeRowBatchTest, WindowsThatBeginApartShareNothingThoughTheyEndTogether) {
  Stream stream({kWide, 4, 10, 16, /*early=*/true});
  stream.AddPoints({{1, 8, 8}});
  stream.Admit(3);
  stream.AddPoints({{2, 16, 8}});
  stream.Admit(1);
  const RowBatch batch = MakeRowBatch({stream.get()}, 10);
  ASSERT_THAT(batch.groups, SizeIs(2));
  EXPECT_THAT(Values(batch.groups[0]), ElementsAre(10, 11, 12, 13));
  EXPECT_THAT(Values(batch.groups[1]), ElementsAre(12, 13, 13, 13)) << "the newest frame repeated";
}

TEST(MakeRowBatchTest, RoomIsSharedAndTheOldestWindowsComeFirst) {
  Stream crowd({kWide, 4, 10}), single({kWide, 4, 50});
  TwoWindows(crowd);
  single.AddPoints({{1, 8, 8}});
  single.Admit(4);
  const RowBatch batch = MakeRowBatch({crowd.get(), single.get()}, 4);
  EXPECT_EQ(batch.rows, 4);
  ASSERT_THAT(batch.groups, SizeIs(3));
  EXPECT_THAT(batch.groups[0].rows, SizeIs(2));
  EXPECT_THAT(Values(batch.groups[1]), ElementsAre(12, 13, 14, 15));
  EXPECT_THAT(batch.groups[1].rows, SizeIs(1)) << "the fourth row waits";
  EXPECT_THAT(Values(batch.groups[2]), ElementsAre(50, 51, 52, 53));

  const RowBatch narrow = MakeRowBatch({crowd.get(), single.get()}, 1);
  EXPECT_EQ(narrow.rows, 1);
  ASSERT_THAT(narrow.groups, SizeIs(1));
  EXPECT_THAT(Values(narrow.groups[0]), ElementsAre(10, 11, 12, 13));
}

// The fake network moves a point by half a feature pixel, 4 pixels, a frame; frames 0 to 2 of a first window are final.
TEST(MakeRowBatchTest, EstimatesInTheGroupsOrderAreThoseOfThePartsRows) {
  Stream a({}), b({});
  TwoWindows(a);
  b.AddPoints({{1, 40, 8}});
  b.Admit(4);
  RowBatch batch = MakeRowBatch({b.get(), a.get()}, 10);
  std::vector<RowEstimate> estimates = a.model().Refine(batch.groups, {batch.iterations, false});
  ASSERT_EQ(static_cast<int64_t>(estimates.size()), batch.rows);
  RowEstimate* next = estimates.data();
  for (const RowBatch::Part& part : batch.parts) {
    part.session->Apply(part.rows, next);
    next += part.rows.size();
  }
  const auto ends = [](const Stream& stream, PointId id) {
    const FinalTrack track = stream.listener().Final(id);
    return track.empty() ? std::pair<int64_t, float>() : std::pair(track.rbegin()->first, track.rbegin()->second.x);
  };
  EXPECT_EQ(ends(b, 1), std::pair(int64_t{2}, 48.0f));
  EXPECT_EQ(ends(a, 1), std::pair(int64_t{2}, 16.0f));
  EXPECT_EQ(ends(a, 2), std::pair(int64_t{2}, 24.0f));
  EXPECT_EQ(ends(a, 3), std::pair(int64_t{4}, 32.0f));
  EXPECT_EQ(ends(a, 4), std::pair(int64_t{4}, 40.0f));
}

TEST(MakeRowBatchTest, WithoutARowThereIsNothing) {
  Stream stream({});
  stream.Admit(6);
  const RowBatch batch = MakeRowBatch({stream.get()}, 10);
  EXPECT_EQ(batch.rows, 0);
  EXPECT_THAT(batch.parts, IsEmpty());
  EXPECT_THAT(batch.groups, IsEmpty());
}

}  // namespace
}  // namespace holdfast
