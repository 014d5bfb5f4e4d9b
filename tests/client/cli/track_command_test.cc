// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <sstream>
#include <thread>
#include <utility>

#include "absl/synchronization/notification.h"
#include "tests/support/fake_tracker.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// Hands a tracker that the test keeps to the command.
class Borrowed final : public PointTracker {
 public:
  explicit Borrowed(PointTracker& tracker) : tracker_(tracker) {}
  absl::StatusOr<std::unique_ptr<TrackStream>> Open(const SessionConfig& config, TrackObserver& observer) override {
    return tracker_.Open(config, observer);
  }
  absl::StatusOr<TrackerInfo> Info() override { return tracker_.Info(); }

 private:
  PointTracker& tracker_;
};

// A tracker whose points move one pixel of the sent frame to the right each frame.
FakeTracker::Behaviour MovingRight() {
  FakeTracker::Behaviour behaviour;
  behaviour.path = [](const PointQuery& query, int64_t query_frame, int64_t frame) {
    return FakeEstimate{query.x + static_cast<float>(frame - query_frame), query.y, true};
  };
  return behaviour;
}

class TrackCommandTest : public ::testing::Test {
 protected:
  TrackCommandTest() {
    std::filesystem::create_directory(dir_.File("frames"));
    for (int i = 0; i < 6; ++i) {
      cv::imwrite(dir_.File("frames/" + std::to_string(i) + ".png"), cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(i)));
    }
    options_.input = dir_.File("frames");
    options_.out = dir_.File("tracks.json");
    options_.points.file = dir_.File("points.csv");
    Points("1,10,20\n2,30,40,2\n");
  }

  void Points(const std::string& text) { std::ofstream(options_.points.file) << text; }

  void Mask() {
    cv::Mat mask(48, 64, CV_8UC1, cv::Scalar(0));
    mask(cv::Rect(4, 4, 10, 10)).setTo(255);
    options_.points.mask = dir_.File("mask.png");
    cv::imwrite(options_.points.mask, mask);
  }

  absl::Status Run(PointTracker& tracker) {
    const auto connect = [this, &tracker]() -> absl::StatusOr<std::unique_ptr<PointTracker>> {
      ++connections_;
      return std::make_unique<Borrowed>(tracker);
    };
    const auto open_view = [this](std::function<void()> quit) -> absl::StatusOr<std::unique_ptr<PictureView>> {
      if (!no_display_.ok()) return no_display_;
      quit_ = std::move(quit);
      return std::make_unique<View>(*this);
    };
    return RunTrack(options_, {connect, stop_, out_, log_, /*terminal=*/false, open_view});
  }

  nlohmann::json Tracks() { return nlohmann::json::parse(std::ifstream(options_.out)); }

  static int FramesOf(const std::string& video) {
    cv::VideoCapture capture(video, cv::CAP_FFMPEG);
    int frames = 0;
    for (cv::Mat frame; capture.read(frame);) ++frames;
    return frames;
  }

  // Remembers what it was shown.
  class View final : public PictureView {
   public:
    explicit View(TrackCommandTest& test) : test_(test) {}
    void Show(const cv::Mat& picture) override { test_.shown_.push_back(picture.clone()); }

   private:
    TrackCommandTest& test_;
  };

  TempDir dir_;
  absl::Status no_display_;
  std::function<void()> quit_;
  std::vector<cv::Mat> shown_;
  TrackOptions options_;
  StopSignal stop_;
  std::ostringstream out_;
  std::ostringstream log_;
  int connections_ = 0;
};

TEST_F(TrackCommandTest, WritesTracksOverlayAndStillOfAllFrames) {
  options_.overlay.video = dir_.File("overlay.mp4");
  options_.overlay.still = dir_.File("still.png");
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  const auto json = Tracks();
  EXPECT_EQ(json["frames"], 6);
  EXPECT_EQ(json["points"][0]["xy"][5], nlohmann::json::parse("[15.0, 20.0]"));
  EXPECT_EQ(json["points"][1]["frames"], nlohmann::json::parse("[2, 3, 4, 5]"));
  EXPECT_EQ(json["points"][1]["xy"][3], nlohmann::json::parse("[33.0, 40.0]"));
  EXPECT_EQ(cv::imread(options_.overlay.still).size(), cv::Size(64, 48));
  EXPECT_EQ(FramesOf(options_.overlay.video), 6);
  EXPECT_EQ(json["complete"], true);
  EXPECT_EQ(json["expected_frames"], 6);
  EXPECT_THAT(log_.str(), HasSubstr("6/6 frames"));
  EXPECT_THAT(log_.str(), HasSubstr("wrote " + options_.out));
}

TEST_F(TrackCommandTest, AMaskIsAnObjectWhosePointsFollowThoseOfTheFile) {
  Mask();
  options_.points.grid = 3;
  options_.points.query_frame = 1;
  options_.max_side = 32;  // half of it
  options_.overlay.still = dir_.File("still.png");
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  ASSERT_EQ(tracker.frames()[1].objects.size(), 1u);
  const std::string& png = tracker.frames()[1].objects[0].mask_png;
  EXPECT_EQ(cv::imdecode(std::vector<char>(png.begin(), png.end()), cv::IMREAD_GRAYSCALE).size(), cv::Size(32, 24));
  EXPECT_EQ(tracker.frames()[1].objects[0].points, 3);
  const auto json = Tracks();
  ASSERT_EQ(json["points"].size(), 5u);
  EXPECT_EQ(json["points"][2]["id"], 3);
  EXPECT_EQ(json["points"][2]["frames"][0], 1);
  const auto object = json["objects"][0];
  EXPECT_EQ(object["points"], nlohmann::json::parse("[3, 4, 5]"));
  EXPECT_EQ(object["frames"], nlohmann::json::parse("[1, 2, 3, 4, 5]"));
  EXPECT_EQ(object["xy"][4], nlohmann::json::parse("[12.0, 2.0]"));
  EXPECT_EQ(object["outline"][0], nlohmann::json::parse("[[4.0, 0.0], [8.0, 4.0], [4.0, 4.0]]"));
  EXPECT_EQ(object["left"][2], nlohmann::json::parse("[4]"));
  EXPECT_THAT(log_.str(), HasSubstr("5 points, final on all 6 frames"));
}

TEST_F(TrackCommandTest, AnObjectStartsOnItsFrameOfTheInputWhateverIsLeftOut) {
  Mask();
  options_.points.file.clear();
  options_.start_frame = 1;
  options_.every = 2;
  options_.points.query_frame = 4;  // besides 1, 3, 5
  options_.both = true;
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  ASSERT_EQ(tracker.configs().size(), 2u);
  const SessionConfig& back = tracker.configs()[1];
  EXPECT_TRUE(back.objects.empty());
  ASSERT_EQ(back.points.size(), 3u);
  EXPECT_EQ(back.points[1].x, 2) << "where the tracker has placed it";
  EXPECT_EQ(back.points[1].y, 1);
  const auto json = Tracks();
  EXPECT_EQ(json["complete"], true);
  EXPECT_EQ(json["objects"][0]["frames"], nlohmann::json::parse("[4, 5]"));
  EXPECT_EQ(json["objects"][0]["points"], nlohmann::json::parse("[1, 2, 3]"));
  EXPECT_EQ(json["points"][0]["frames"], nlohmann::json::parse("[1, 3, 4, 5]"));
  EXPECT_EQ(json["points"][0]["xy"], nlohmann::json::parse("[[3, 1], [2, 1], [1, 1], [2, 1]]"));
}

TEST_F(TrackCommandTest, AnObjectWithoutAFrameStartsOnTheFirstOneThatIsTracked) {
  Mask();
  options_.points.file.clear();
  options_.start_frame = 3;
  options_.out = "-";
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  EXPECT_EQ(tracker.configs()[0].objects.size(), 1u);
  EXPECT_THAT(out_.str(), HasSubstr("{\"object\": 1, \"frame\": 3, \"x\": 2.000, \"y\": 1.000"));
}

TEST_F(TrackCommandTest, ServersThatKnowNoObjectsAndInputsThatEndBeforeOneAreTold) {
  Mask();
  auto behaviour = MovingRight();
  behaviour.max_objects = 0;
  FakeTracker old(behaviour);
  EXPECT_THAT(Run(old), StatusIs(absl::StatusCode::kUnimplemented, HasSubstr("--mask: the server is too old")));
  options_.points.query_frame = 99;
  FakeTracker tracker(MovingRight());
  EXPECT_THAT(Run(tracker), IsOk());
  EXPECT_THAT(log_.str(), HasSubstr("warning: the object of --mask starts after the last frame"));
}

TEST_F(TrackCommandTest, EstimatesGoToStandardOutputAsTheyCome) {
  options_.out = "-";
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  std::istringstream lines(out_.str());
  std::map<std::pair<int, int>, nlohmann::json> final_ones;
  nlohmann::json last;
  for (std::string line; std::getline(lines, line);) {
    last = nlohmann::json::parse(line);
    if (last.value("final", false)) final_ones[{last["id"], last["frame"]}] = last;
  }
  EXPECT_EQ(final_ones.size(), 6u + 4u);
  EXPECT_EQ((final_ones[{1, 5}]["x"]), 15.0);
  EXPECT_EQ((final_ones[{2, 3}]["y"]), 40.0);
  EXPECT_EQ(last["complete"], true);
  EXPECT_EQ(last["frames"], 6);
  EXPECT_FALSE(std::filesystem::exists("-"));
  EXPECT_THAT(log_.str(), HasSubstr("final on all 6 frames"));
}

TEST_F(TrackCommandTest, WhenNobodyReadsTheLinesTheRunEnds) {
  options_.out = "-";
  out_.setstate(std::ios::badbit);
  FakeTracker tracker(MovingRight());
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("standard output")));
}

TEST_F(TrackCommandTest, PointsTravelWithTheirFrameAndOptionsWithTheConfig) {
  options_.hop_frames = 5;
  options_.iterations = 3;
  options_.processing_size = {64, 32};
  options_.max_frames = 4;
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  const SessionConfig& config = tracker.configs()[0];
  EXPECT_EQ(config.hop_frames, 5);
  EXPECT_EQ(config.iterations, 3);
  EXPECT_EQ(config.processing_size, (ImageSize{64, 32}));
  EXPECT_EQ(config.encoding, FrameEncoding::kJpeg);
  ASSERT_EQ(config.points.size(), 1u);
  ASSERT_EQ(tracker.frames().size(), 4u);
  EXPECT_TRUE(tracker.frames()[0].points.empty());
  ASSERT_EQ(tracker.frames()[2].points.size(), 1u);
  EXPECT_EQ(tracker.frames()[2].points[0].id, 2u);
}

TEST_F(TrackCommandTest, ResultsAreInTheSourcesPixelsWhateverIsSent) {
  options_.max_side = 32;
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  EXPECT_EQ(tracker.configs()[0].points[0].x, 5);
  const auto sent = tracker.frames()[0].bytes;
  EXPECT_EQ(cv::imdecode(std::vector<char>(sent.begin(), sent.end()), cv::IMREAD_COLOR).cols, 32);
  EXPECT_EQ(Tracks()["points"][0]["xy"][5], nlohmann::json::parse("[20.0, 20.0]"));
}

TEST_F(TrackCommandTest, ChosenFramesAreTrackedAndOutputsSpeakOfTheInputsFrames) {
  Points("1,10,20\n2,30,40,4\n");
  options_.start_frame = 1;
  options_.every = 2;  // 1, 3, 5, and 4 for the second point
  options_.overlay.video = dir_.File("overlay.mp4");
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  ASSERT_EQ(tracker.frames().size(), 4u);
  EXPECT_EQ(tracker.frames()[3].index, 3) << "the session's own count";
  ASSERT_EQ(tracker.frames()[2].points.size(), 1u);
  const auto json = Tracks();
  EXPECT_EQ(json["frames"], 4);
  EXPECT_EQ(json["expected_frames"], 4);
  EXPECT_EQ(json["points"][0]["frames"], nlohmann::json::parse("[1, 3, 4, 5]"));
  EXPECT_EQ(json["points"][0]["xy"][3], nlohmann::json::parse("[13.0, 20.0]"));
  EXPECT_EQ(json["points"][1]["frames"], nlohmann::json::parse("[4, 5]"));
  EXPECT_EQ(FramesOf(options_.overlay.video), 4);
  EXPECT_EQ(cv::VideoCapture(options_.overlay.video).get(cv::CAP_PROP_FPS), json["fps"].get<double>() / 2);
  EXPECT_THAT(log_.str(), HasSubstr("4/4 frames"));
}

TEST_F(TrackCommandTest, WhatIsMissingHasTheInputsNumbersToo) {
  Points("1,10,20\n");
  options_.start_frame = 1;
  options_.every = 2;
  auto behaviour = MovingRight();
  behaviour.fail_at_frame = 2;
  FakeTracker tracker(behaviour);
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_THAT(log_.str(), HasSubstr("frames 1..3, 2 of 3 (none final), 5 is missing"));
}

TEST_F(TrackCommandTest, PointsAndInputsThatEndBeforeTheFirstFrameAreRefused) {
  FakeTracker tracker(MovingRight());
  options_.start_frame = 3;
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kInvalidArgument,
                                     HasSubstr("line 2: frame is 2, expected --start_frame=3 or more")));
  options_.start_frame = 6;
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("has no frame 6")));
  EXPECT_EQ(connections_, 0);
}

TEST_F(TrackCommandTest, BothTracksThePastOfPointsInASecondSession) {
  Points("1,10,20\n2,30,40,3\n");
  options_.both = true;
  options_.overlay.video = dir_.File("overlay.mp4");
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  ASSERT_EQ(tracker.configs().size(), 2u);
  ASSERT_EQ(tracker.configs()[1].points.size(), 1u) << "the other point has no past";
  EXPECT_EQ(tracker.configs()[1].points[0].id, 2u);
  ASSERT_EQ(tracker.frames().size(), 4u);
  const auto json = Tracks();
  EXPECT_EQ(json["complete"], true);
  EXPECT_EQ(json["final_frames"], 6);
  EXPECT_EQ(json["points"][1]["frames"], nlohmann::json::parse("[0, 1, 2, 3, 4, 5]"));
  EXPECT_EQ(json["points"][1]["xy"],
            nlohmann::json::parse("[[33, 40], [32, 40], [31, 40], [30, 40], [31, 40], [32, 40]]"))
      << "this tracker's points move to the right whichever way the frames come";
  EXPECT_EQ(json["points"][0]["xy"][5], nlohmann::json::parse("[15.0, 20.0]"));
  EXPECT_EQ(FramesOf(options_.overlay.video), 6);
  EXPECT_THAT(log_.str(), HasSubstr("10/10 frames")) << "there and back";
}

TEST_F(TrackCommandTest, WhereNothingHasAPastTheProgressOfBothEndsWithTheFrames) {
  Points("1,10,20\n");
  options_.both = true;
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  EXPECT_EQ(tracker.configs().size(), 1u);
  EXPECT_THAT(log_.str(), HasSubstr("6/6 frames"));
}

// Opens its first session at one tracker and the next ones at another.
class TwoTrackers final : public PointTracker {
 public:
  TwoTrackers(PointTracker& first, PointTracker& second) : trackers_{&first, &second} {}
  absl::StatusOr<std::unique_ptr<TrackStream>> Open(const SessionConfig& config, TrackObserver& observer) override {
    return trackers_[std::min(opened_++, 1)]->Open(config, observer);
  }
  absl::StatusOr<TrackerInfo> Info() override { return TrackerInfo{}; }

 private:
  PointTracker* trackers_[2];
  int opened_ = 0;
};

TEST_F(TrackCommandTest, AWayBackThatIsLostLeavesTheWayThereAndSaysSo) {
  Points("1,10,20\n2,30,40,3\n");
  options_.both = true;
  auto behaviour = MovingRight();
  FakeTracker well(behaviour);
  behaviour.fail_at_frame = 2;
  FakeTracker lost(behaviour);
  TwoTrackers tracker(well, lost);
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kUnavailable));
  const auto json = Tracks();
  EXPECT_EQ(json["complete"], false);
  EXPECT_EQ(json["final_frames"], 0);
  EXPECT_EQ(json["points"][0]["frames"].size(), 6u);
  EXPECT_EQ(json["points"][1]["frames"], nlohmann::json::parse("[2, 3, 4, 5]"));
  EXPECT_THAT(log_.str(), HasSubstr("frames 0..5 of 6 (none final), none is missing"));
}

TEST_F(TrackCommandTest, TheOverlayIsShown) {
  options_.out.clear();
  options_.overlay.show = true;
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  ASSERT_EQ(shown_.size(), 6u);
  const cv::Vec3b at_point = shown_[5].at<cv::Vec3b>(20, 15), elsewhere = shown_[5].at<cv::Vec3b>(5, 60);
  EXPECT_GT(cv::norm(at_point, elsewhere), 100) << "the first point is at 15, 20";
}

TEST_F(TrackCommandTest, WithoutADisplayNothingBegins) {
  options_.overlay.show = true;
  no_display_ = absl::UnavailableError("--show: there is no display");
  FakeTracker tracker(MovingRight());
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kUnavailable, HasSubstr("--show")));
  EXPECT_EQ(connections_, 0);
}

TEST_F(TrackCommandTest, PointsAfterTheEndAreReported) {
  Points("1,10,20\n2,30,40,99\n");
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  EXPECT_THAT(log_.str(), HasSubstr("warning: 1 points start after the last frame"));
  EXPECT_EQ(Tracks()["points"][1]["frames"].size(), 0u);
}

TEST_F(TrackCommandTest, InputAndPointsAreCheckedBeforeTheServerIsAsked) {
  FakeTracker tracker(MovingRight());
  options_.out = dir_.File("nowhere/t.json");
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kNotFound, HasSubstr("nowhere")));
  options_.out = dir_.File("t.json");
  Points("1,64,20\n");
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("points.csv: line 1: x is 64")));
  options_.input = dir_.File("none.mp4");
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.mp4")));
  EXPECT_EQ(connections_, 0);
}

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
  absl::Notification eighth, written;
  std::thread camera([&] {
    std::ofstream pipe(options_.input, std::ios::binary);
    const auto write = [&pipe](int frames) {
      for (int i = 0; i < frames; ++i) pipe << "FRAME\n" << std::string(64 * 48 * 3 / 2, '\x50');
      pipe.flush();
    };
    pipe << "YUV4MPEG2 W64 H48 F30:1 Ip C420jpeg\n";
    while (!eighth.HasBeenNotified()) write(1);
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
    if (frame > 7) answer(observer, frame, frame);
    if (frame != 7) return absl::OkStatus();
    eighth.Notify();
    answers = std::thread([&] {
      written.WaitForNotification();
      answer(observer, 0, 7);
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

TEST(TrackOptionsTest, ValidateNamesWhatIsWrong) {
  TrackOptions good;
  good.points.grid = 9;
  good.out = "t.csv";
  EXPECT_THAT(good.Validate(), IsOk());
  const auto message = [&good](const std::function<void(TrackOptions&)>& spoil) {
    TrackOptions options = good;
    spoil(options);
    return std::string(options.Validate().message());
  };
  EXPECT_THAT(message([](auto& o) { o.out = ""; }), HasSubstr("nothing to write"));
  EXPECT_THAT(message([](auto& o) { o.out = "t.txt"; }), HasSubstr("t.txt"));
  EXPECT_THAT(message([](auto& o) { o.overlay.video = "t.gif"; }), HasSubstr("t.gif"));
  EXPECT_THAT(message([](auto& o) { o.points.grid = 0; }), HasSubstr("no points"));
  EXPECT_THAT(message([](auto& o) { o.jpeg_quality = 101; }), HasSubstr("--jpeg_quality"));
  EXPECT_THAT(message([](auto& o) { o.max_side = 5; }), HasSubstr("--max_side"));
  EXPECT_THAT(message([](auto& o) { o.max_frames = -1; }), HasSubstr("--max_frames"));
  EXPECT_THAT(message([](auto& o) { o.start_frame = -1; }), HasSubstr("--start_frame"));
  EXPECT_THAT(message([](auto& o) { o.every = 0; }), HasSubstr("--every"));
  EXPECT_THAT(message([](auto& o) { o.start_frame = 5, o.points.query_frame = 4; }), HasSubstr("--query_frame"));
  EXPECT_THAT(message([](auto& o) { o.start_frame = 5, o.overlay.still_frame = 4; }), HasSubstr("--still_frame"));
  EXPECT_THAT(message([](auto& o) { o.both = o.live = true; }), HasSubstr("--both: "));
  EXPECT_THAT(message([](auto& o) { o.both = o.overlay.show = true; }), HasSubstr("not with --show"));
  EXPECT_THAT(message([](auto& o) { o.hop_frames = -1; }), HasSubstr("--hop"));
  EXPECT_THAT(message([](auto& o) { o.iterations = -1; }), HasSubstr("--iterations"));
}

}  // namespace
}  // namespace holdfast
