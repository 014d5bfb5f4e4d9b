// SPDX-License-Identifier: Apache-2.0
#include "client/cli/load_session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include "absl/synchronization/notification.h"
#include "api/errors.h"
#include "tests/support/fake_tracker.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

FakeEstimate Still(const PointQuery& query, int64_t, int64_t) { return {query.x, query.y}; }

// Refuses every session, and notes when.
class FullTracker final : public PointTracker {
 public:
  FullTracker(const Clock& clock, std::vector<SteadyTime>& asked) : clock_(clock), asked_(asked) {}
  absl::StatusOr<std::unique_ptr<TrackStream>> Open(const SessionConfig&, TrackObserver& observer) override {
    asked_.push_back(clock_.SteadyNow());
    const absl::Status full = OverloadError("sessions", "all are open", absl::Seconds(2));
    observer.OnDone(full, {});
    return full;
  }
  absl::StatusOr<TrackerInfo> Info() override { return TrackerInfo{}; }

 private:
  const Clock& clock_;
  std::vector<SteadyTime>& asked_;
};

// A stream whose end never comes, unless it is cancelled.
class EndlessStream final : public TrackStream {
 public:
  EndlessStream(absl::Notification& finishing, TrackObserver& observer) : finishing_(finishing), observer_(observer) {}
  absl::Status PushFrame(Frame) override { return absl::OkStatus(); }
  absl::Status AddPoints(std::vector<PointQuery>) override { return absl::OkStatus(); }
  absl::Status RemovePoints(std::vector<PointId>) override { return absl::OkStatus(); }
  absl::Status Finish() override {
    finishing_.Notify();
    cancelled_.WaitForNotification();
    const absl::Status status = absl::CancelledError("as asked");
    observer_.OnDone(status, {});
    return status;
  }
  void Cancel() override { cancelled_.Notify(); }

 private:
  absl::Notification& finishing_;
  TrackObserver& observer_;
  absl::Notification cancelled_;
};

class EndlessTracker final : public PointTracker {
 public:
  explicit EndlessTracker(absl::Notification& finishing) : finishing_(finishing) {}
  absl::StatusOr<std::unique_ptr<TrackStream>> Open(const SessionConfig&, TrackObserver& observer) override {
    return std::make_unique<EndlessStream>(finishing_, observer);
  }
  absl::StatusOr<TrackerInfo> Info() override { return TrackerInfo{}; }

 private:
  absl::Notification& finishing_;
};

class LoadSessionTest : public ::testing::Test {
 protected:
  LoadSessionTest() {
    options_.config.points = {{1, 5, 5}, {2, 9, 9}};
    options_.frames = std::make_shared<const std::vector<std::string>>(std::vector<std::string>{"a", "b", "c"});
    options_.fps = 10;
    options_.duration = absl::Seconds(2);
  }

  // Time passes where the session waits for it.
  template <typename MakeTracker>
  LoadResult Run(MakeTracker make) {
    const auto wait = [this](SteadyTime until) {
      const SteadyTime now = clock_.SteadyNow();
      if (until > now) clock_.Advance(Between(now, until));
      return !stopped_;
    };
    return LoadSession(options_, make, clock_, wait).Run();
  }
  LoadResult RunOnFake(const FakeTracker::Behaviour& behaviour = {Still}) {
    return Run([this, behaviour]() -> absl::StatusOr<std::unique_ptr<PointTracker>> {
      auto tracker = std::make_unique<FakeTracker>(behaviour);
      tracker_ = tracker.get();
      return std::unique_ptr<PointTracker>(std::move(tracker));
    });
  }

  LoadSession::Options options_;
  SimulatedClock clock_;
  FakeTracker* tracker_ = nullptr;
  bool stopped_ = false;
};

TEST_F(LoadSessionTest, AHealthyClientSendsAtItsPaceUntilTheTimeIsOver) {
  const LoadResult result = RunOnFake();
  EXPECT_THAT(result.errors, IsEmpty());
  EXPECT_EQ(result.sessions, 1);
  EXPECT_EQ(result.frames, 20);
  EXPECT_EQ(result.first.count(), 20u);
  EXPECT_EQ(result.final.count(), 20u);
  EXPECT_EQ(result.final_samples, 40);
  EXPECT_EQ(result.active, absl::Seconds(2));
  EXPECT_DOUBLE_EQ(result.FramesPerSecond(), 10);
  EXPECT_EQ(result.first.Percentile(100), absl::ZeroDuration()) << "answered at once";
  EXPECT_EQ(result.final.Percentile(100), absl::Seconds(2)) << "the first frame, at the end";
}

TEST_F(LoadSessionTest, TheFilmBeginsAgain) {
  std::vector<std::string> sent;
  options_.duration = absl::Milliseconds(450);
  Run([&]() -> absl::StatusOr<std::unique_ptr<PointTracker>> {
    FakeTracker::Behaviour behaviour{[&](const PointQuery& query, int64_t, int64_t frame) {
      if (query.id == 1 && static_cast<int64_t>(sent.size()) == frame) sent.push_back(tracker_->frames().back().bytes);
      return FakeEstimate{query.x, query.y};
    }};
    auto tracker = std::make_unique<FakeTracker>(behaviour);
    tracker_ = tracker.get();
    return std::unique_ptr<PointTracker>(std::move(tracker));
  });
  EXPECT_THAT(sent, ElementsAre("a", "b", "c", "a", "b"));
}

TEST_F(LoadSessionTest, ALostSessionIsAnErrorAndIsTriedAgain) {
  const LoadResult result = RunOnFake({Still, {512, 384}, /*fail_at_frame=*/5});
  EXPECT_THAT(result.errors, SizeIs(3));
  EXPECT_THAT(result.errors, ::testing::Each(StatusIs(absl::StatusCode::kUnavailable)));
  EXPECT_EQ(result.sessions, 4) << "of five frames each, and a last one";
}

TEST_F(LoadSessionTest, RefusedClientsComeBackWhenTheyWereToldButNotTogether) {
  options_.duration = absl::Seconds(20);
  std::vector<absl::Duration> pauses;
  for (options_.seed = 0; options_.seed < 2; ++options_.seed) {
    std::vector<SteadyTime> asked;
    const LoadResult result = Run([&]() -> absl::StatusOr<std::unique_ptr<PointTracker>> {
      return std::make_unique<FullTracker>(clock_, asked);
    });
    EXPECT_EQ(result.refused, static_cast<int64_t>(asked.size()));
    EXPECT_EQ(result.refusal.count(), asked.size());
    EXPECT_EQ(result.sessions, 0);
    EXPECT_THAT(result.errors, IsEmpty());
    for (size_t i = 1; i < asked.size(); ++i) pauses.push_back(Between(asked[i - 1], asked[i]));
  }
  EXPECT_THAT(pauses, SizeIs(::testing::Ge(2u * 6)));
  EXPECT_THAT(pauses,
              ::testing::Each(::testing::AllOf(::testing::Ge(absl::Seconds(2)), ::testing::Le(absl::Seconds(3)))));
  EXPECT_THAT(std::set<absl::Duration>(pauses.begin(), pauses.end()), SizeIs(pauses.size()));
}

TEST_F(LoadSessionTest, AClientBeginsAfterItsDelay) {
  options_.delay = absl::Milliseconds(1500);
  const LoadResult result = RunOnFake();
  EXPECT_EQ(result.frames, 5);
  EXPECT_EQ(result.active, absl::Milliseconds(500));
  stopped_ = true;
  EXPECT_EQ(RunOnFake().sessions, 0);
}

TEST_F(LoadSessionTest, ClientsThatGoAwayComeBack) {
  options_.kind = LoadKind::kCancel;
  options_.fps = 1000;
  const LoadResult result = RunOnFake();
  EXPECT_GT(result.sessions, 10);
  EXPECT_THAT(result.errors, IsEmpty());
}

TEST_F(LoadSessionTest, AClientThatReadsSlowlyIsLate) {
  options_.kind = LoadKind::kSlow;
  const LoadResult result = RunOnFake();
  EXPECT_THAT(result.errors, IsEmpty());
  EXPECT_EQ(result.frames, 2) << "a second for each answer, on the fake tracker's only thread";
}

TEST_F(LoadSessionTest, ServersThatCannotBeReachedAreErrors) {
  const LoadResult result =
      Run([]() -> absl::StatusOr<std::unique_ptr<PointTracker>> { return absl::UnavailableError("nobody is there"); });
  EXPECT_THAT(result.errors, ElementsAre(StatusIs(absl::StatusCode::kUnavailable)));
}

TEST_F(LoadSessionTest, AStoppedRunEndsWithWhatItHas) {
  stopped_ = true;
  const LoadResult result = RunOnFake();
  EXPECT_EQ(result.sessions, 1);
  EXPECT_EQ(result.frames, 0);
  EXPECT_THAT(result.errors, IsEmpty());
}

TEST_F(LoadSessionTest, AStoppedRunDoesNotWaitForTheEndOfASession) {
  absl::Notification finishing;
  std::atomic<bool> stopped = false;
  const auto connect = [&finishing]() -> absl::StatusOr<std::unique_ptr<PointTracker>> {
    return std::make_unique<EndlessTracker>(finishing);
  };
  const auto wait = [this, &stopped](SteadyTime until) {
    clock_.Advance(std::max(absl::ZeroDuration(), Between(clock_.SteadyNow(), until)));
    return !stopped;
  };
  LoadSession session(options_, connect, clock_, wait);
  LoadResult result;
  std::thread client([&] { result = session.Run(); });
  finishing.WaitForNotification();
  stopped = true;
  session.Stop();
  client.join();
  EXPECT_EQ(result.sessions, 1);
  EXPECT_THAT(result.errors, IsEmpty());
}

}  // namespace
}  // namespace holdfast
