// SPDX-License-Identifier: Apache-2.0
// What remains of runs that end otherwise than with their input.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <thread>
#include <utility>

#include "absl/synchronization/notification.h"
#include "tests/client/cli/track_command_fixture.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST_F(TrackCommandTest, ALostSessionKeepsProvisionalEstimatesAndSaysWhatIsMissing) {
  auto behaviour = MovingRight();
  behaviour.fail_at_frame = 4;
  FakeTracker tracker(behaviour);
  options_.overlay.video = dir_.File("overlay.mp4");
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kUnavailable, HasSubstr("went away")));
  EXPECT_TRUE(tracker.configs()[0].send_provisional);
  const auto json = Tracks();
  EXPECT_EQ(json["complete"], false);
  EXPECT_EQ(json["frames"], 4);
  EXPECT_EQ(json["final_frames"], 0);
  EXPECT_EQ(json["expected_frames"], 6);
  EXPECT_EQ(json["points"][0]["frames"], nlohmann::json::parse("[0, 1, 2, 3]"));
  EXPECT_EQ(json["points"][1]["frames"], nlohmann::json::parse("[2, 3]"));
  EXPECT_EQ(FramesOf(options_.overlay.video), 4);
  EXPECT_THAT(log_.str(), HasSubstr("kept in " + options_.out + ", " + options_.overlay.video +
                                    ": frames 0..3 of 6 (none final), 4..5 are missing\n"));
}

TEST_F(TrackCommandTest, ABrokenInputStillMakesEveryFrameBeforeItFinal) {
  std::ofstream(dir_.File("frames/4.png")) << "broken";
  FakeTracker tracker(MovingRight());
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("4.png")));
  const auto json = Tracks();
  EXPECT_EQ(json["complete"], false);
  EXPECT_EQ(json["final_frames"], 4);
  EXPECT_EQ(json["points"][0]["xy"][3], nlohmann::json::parse("[13.0, 20.0]"));
  EXPECT_THAT(log_.str(), HasSubstr("frames 0..3 of 6 (all final), 4..5 are missing"));
}

TEST_F(TrackCommandTest, ASessionThatEndsWellBeforeEverythingIsFinalIsNotComplete) {
  auto behaviour = MovingRight();
  behaviour.final_frames_missing = 1;
  FakeTracker tracker(behaviour);
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kInternal, HasSubstr("before every estimate was final")));
  EXPECT_EQ(Tracks()["complete"], false);
  EXPECT_EQ(Tracks()["final_frames"], 5);
}

// A session of one point, 1, whose answers and end the test writes down.
class ScriptedTracker final : public PointTracker {
 public:
  using Push = std::function<absl::Status(TrackObserver&, int64_t frame)>;
  explicit ScriptedTracker(Push push) : push_(std::move(push)) {}
  absl::StatusOr<std::unique_ptr<TrackStream>> Open(const SessionConfig&, TrackObserver& observer) override {
    return std::make_unique<Stream>(*this, observer);
  }
  absl::StatusOr<TrackerInfo> Info() override { return TrackerInfo{}; }
  bool cancelled() const { return cancelled_; }

 private:
  class Stream final : public TrackStream {
   public:
    Stream(ScriptedTracker& tracker, TrackObserver& observer) : tracker_(tracker), observer_(observer) {}
    absl::Status PushFrame(Frame frame) override { return tracker_.push_(observer_, frame.index); }
    absl::Status AddPoints(std::vector<PointQuery>) override { return absl::OkStatus(); }
    absl::Status RemovePoints(std::vector<PointId>) override { return absl::OkStatus(); }
    absl::Status Finish() override {
      return tracker_.cancelled_ ? absl::CancelledError("the session was cancelled") : absl::OkStatus();
    }
    void Cancel() override { tracker_.cancelled_ = true; }

   private:
    ScriptedTracker& tracker_;
    TrackObserver& observer_;
  };

  const Push push_;
  bool cancelled_ = false;
};

// Frames first .. newest of point 1 at x = 10 + frame, the first of them final.
TrackUpdate Window(int64_t first, int64_t newest) {
  PointRun run;
  run.id = 1;
  run.first_frame = first;
  run.final_count = 1;
  for (int64_t frame = first; frame <= newest; ++frame) run.x.push_back(10.0f + static_cast<float>(frame));
  run.y.assign(run.x.size(), 20);
  run.visible.assign(run.x.size(), 1);
  run.confidence.assign(run.x.size(), 0.5f);
  return {{run}, newest + 1, newest + 1};
}

TEST_F(TrackCommandTest, EveryFormatKeepsFinalAndProvisionalEstimates) {
  Points("1,10,20\n");
  ScriptedTracker tracker([](TrackObserver& observer, int64_t frame) {
    if (frame == 5) return absl::UnavailableError("gone");
    observer.OnTracks(Window(std::max<int64_t>(0, frame - 2), frame));
    return absl::OkStatus();
  });
  for (const char* name : {"t.json", "t.csv", "t.npz"}) {
    options_.out = dir_.File(name);
    EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kUnavailable)) << name;
    EXPECT_THAT(log_.str(), HasSubstr("kept in " + options_.out + ": frames 0..4 of 6 (0..2 are final), 5 is missing"));
  }
  options_.out = dir_.File("t.json");
  EXPECT_EQ(Tracks()["points"][0]["xy"], nlohmann::json::parse("[[10,20],[11,20],[12,20],[13,20],[14,20]]"));
  std::ifstream csv(dir_.File("t.csv"));
  EXPECT_EQ(std::count(std::istreambuf_iterator<char>(csv), {}, '\n'), 6) << "a header and five frames";
}

TEST_F(TrackCommandTest, ALostServerThatIsReplacedIsTwoLinesInTheLogAndNothingInTheTracks) {
  Points("1,10,20\n");
  ScriptedTracker tracker([](TrackObserver& observer, int64_t frame) {
    observer.OnTracks(Window(frame, frame));
    if (frame != 3) return absl::OkStatus();
    observer.OnReconnecting(absl::UnavailableError("holdfast: server at a:1 is unavailable: Socket closed"));
    SessionAccepted accepted;
    accepted.first_frame = 2;
    accepted.server = "b:2";
    observer.OnResumed(accepted);
    return absl::OkStatus();
  });
  EXPECT_THAT(Run(tracker), IsOk());
  EXPECT_EQ(Tracks()["complete"], true);
  EXPECT_EQ(Tracks()["frames"], 6);
  EXPECT_THAT(log_.str(),
              HasSubstr("server at a:1 is unavailable: Socket closed; reconnecting\nresumed at frame 2 on b:2\n"));
  EXPECT_THAT(log_.str(), Not(HasSubstr("holdfast: server")));
}

TEST_F(TrackCommandTest, WithoutAnyEstimateOldFilesStay) {
  options_.overlay.video = dir_.File("overlay.mp4");
  for (const std::string& path : {options_.out, options_.overlay.video}) std::ofstream(path) << "old";
  ScriptedTracker tracker([](TrackObserver&, int64_t frame) {
    return frame < 3 ? absl::OkStatus() : absl::DeadlineExceededError("too slow");
  });
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kDeadlineExceeded));
  for (const std::string& path : {options_.out, options_.overlay.video}) {
    EXPECT_EQ(std::filesystem::file_size(path), 3u) << path;
  }
  EXPECT_EQ(dir_.Count(), 4u) << "the frames, the points and the two old files";
  EXPECT_THAT(log_.str(), HasSubstr("no estimate came, no file is written"));
}

TEST_F(TrackCommandTest, ALiveInputThatComesTooFastIsNotQueued) {
  // A pipe does not say how long it is, and takes no more than is read of it. The tracker answers its first frames when
  // hundreds have gone through.
  Points("1,10,20\n");
  options_.live = true;
  options_.input = dir_.File("pipe.y4m");
  ASSERT_EQ(mkfifo(options_.input.c_str(), 0600), 0);
  absl::Notification second, written;
  std::thread camera([&] {
    std::ofstream pipe(options_.input, std::ios::binary);
    const auto write = [&pipe](int frames) {
      for (int i = 0; i < frames; ++i) pipe << "FRAME\n" << std::string(64 * 48 * 3 / 2, '\x50');
      pipe.flush();
    };
    pipe << "YUV4MPEG2 W64 H48 F30:1 Ip C420jpeg\n";
    while (!second.HasBeenNotified()) write(1);
    write(200);
    written.Notify();
  });
  const auto answer = [](TrackObserver& observer, int64_t first, int64_t newest) {
    TrackUpdate update = Window(first, newest);
    update.runs[0].final_count = newest - first + 1;
    observer.OnTracks(update);
  };
  int64_t sent = 0;
  std::thread answers;
  ScriptedTracker tracker([&](TrackObserver& observer, int64_t frame) {
    sent = frame + 1;
    if (frame > 1) answer(observer, frame, frame);
    if (frame != 1) return absl::OkStatus();
    second.Notify();
    answers = std::thread([&] {
      written.WaitForNotification();
      answer(observer, 0, 1);
    });
    return absl::OkStatus();
  });
  EXPECT_THAT(Run(tracker), IsOk());
  camera.join();
  answers.join();
  const auto json = Tracks();
  EXPECT_LT(sent, 100);
  EXPECT_EQ(json["points"][0]["frames"].size(), static_cast<size_t>(sent));
  EXPECT_GT(json["points"][0]["frames"].back(), sent) << "a frame's number counts those that were left out";
  EXPECT_EQ(json["capture_times"].size(), static_cast<size_t>(sent));
  EXPECT_THAT(log_.str(), HasSubstr(" frames came faster than answers and were left out"));
}

TEST_F(TrackCommandTest, FramesThatWereNeverSentAreNotBelieved) {
  ScriptedTracker tracker([](TrackObserver& observer, int64_t) {
    observer.OnTracks({{}, int64_t{1} << 40, 1});
    return absl::OkStatus();
  });
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kInternal, HasSubstr("speaks of 1099511627776 frames")));
}

TEST_F(TrackCommandTest, AnInterruptCancelsTheSessionAndKeepsWhatIsThere) {
  Points("1,10,20\n");
  options_.overlay.still = dir_.File("still.png");
  ScriptedTracker tracker([this](TrackObserver& observer, int64_t frame) {
    observer.OnTracks(Window(frame, frame));
    if (frame == 2) stop_.Stop();
    return absl::OkStatus();
  });
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kCancelled, HasSubstr("interrupted")));
  EXPECT_TRUE(tracker.cancelled());
  EXPECT_EQ(Tracks()["points"][0]["frames"], nlohmann::json::parse("[0, 1, 2]"));
  EXPECT_FALSE(cv::imread(options_.overlay.still).empty());
  EXPECT_THAT(log_.str(), HasSubstr("frames 0..2 of 6 (all final), 3..5 are missing"));
}

TEST_F(TrackCommandTest, QuittingTheWindowIsAnInterrupt) {
  Points("1,10,20\n");
  options_.overlay.show = true;
  ScriptedTracker tracker([this](TrackObserver& observer, int64_t frame) {
    observer.OnTracks(Window(frame, frame));
    if (frame == 2) quit_();
    return absl::OkStatus();
  });
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kCancelled, HasSubstr("interrupted")));
  EXPECT_EQ(Tracks()["frames"], 3);
}

TEST_F(TrackCommandTest, AnInterruptDoesNotWaitForAnInputThatStalls) {
  std::filesystem::remove(dir_.File("frames/3.png"));
  ASSERT_EQ(mkfifo(dir_.File("frames/3.png").c_str(), 0600), 0);  // nobody ever writes to it
  Points("1,10,20\n");
  absl::Notification sent;
  ScriptedTracker tracker([&sent](TrackObserver& observer, int64_t frame) {
    observer.OnTracks(Window(frame, frame));
    if (frame == 2) sent.Notify();
    return absl::OkStatus();
  });
  std::thread interrupt([this, &sent] {
    sent.WaitForNotification();
    stop_.Stop();
  });
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kCancelled, HasSubstr("interrupted")));
  interrupt.join();
  EXPECT_EQ(Tracks()["frames"], 3);
}

}  // namespace
}  // namespace holdfast
