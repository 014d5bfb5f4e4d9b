// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <utility>

#include "tests/client/cli/track_command_fixture.h"
#include "tests/client/cli/written_video.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

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
  EXPECT_EQ(object["xy"][4], nlohmann::json::parse("[12.5, 2.5]"));
  EXPECT_EQ(object["outline"][0], nlohmann::json::parse("[[4.5, 0.5], [8.5, 4.5], [4.5, 4.5]]"));
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
  options_.hop = {5, 12};
  options_.iterations = 3;
  options_.processing_size = {64, 32};
  options_.max_frames = 4;
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  const SessionConfig& config = tracker.configs()[0];
  EXPECT_EQ(config.hop_frames, 5);
  EXPECT_EQ(config.max_hop_frames, 12);
  EXPECT_THAT(log_.str(), HasSubstr("a window every 12 frames\n")) << "of a tracker without time";
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
  EXPECT_EQ(tracker.configs()[0].points[0].x, 4.75f) << "(10 + 0.5) / 2 - 0.5";
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
  EXPECT_THAT(log_.str(), HasSubstr("1 points, final on all 6 frames"));
  EXPECT_EQ(Tracks()["points"][1]["frames"].size(), 0u);
}

TEST_F(TrackCommandTest, WhereNothingStartsBeforeTheEndNothingWasTracked) {
  Points("1,10,20,99\n");
  FakeTracker tracker(MovingRight());
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("starts at frame 99")));
}

// FFmpeg says that such a file has ended.
TEST_F(TrackCommandTest, AVideoThatIsCutOffIsNotComplete) {
  options_.input = dir_.File("12:30.avi");  // a colon names no protocol
  options_.overlay.video = dir_.File("12:31.mp4");
  WriteVideo(options_.input, "MJPG", 10, 60);
  FakeTracker whole(MovingRight());
  ASSERT_THAT(Run(whole), IsOk());
  EXPECT_EQ(Tracks()["frames"], 60);
  std::filesystem::resize_file(options_.input, std::filesystem::file_size(options_.input) / 2);
  FakeTracker tracker(MovingRight());
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("of 60 frames")));
  const auto json = Tracks();
  EXPECT_EQ(json["complete"], false);
  EXPECT_EQ(json["expected_frames"], 60);
  EXPECT_GT(json["final_frames"], 20);
  options_.max_frames = 20;
  FakeTracker shorter(MovingRight());
  EXPECT_THAT(Run(shorter), IsOk()) << "no more were wanted";
}

TEST_F(TrackCommandTest, ShapesOfCvatEndWhereTrackingDoesAndTheInputDoesNot) {
  const auto end_of = [this](int64_t max_frames) {
    options_.out = dir_.File("t.xml");
    options_.max_frames = max_frames;
    FakeTracker tracker(MovingRight());
    EXPECT_THAT(Run(tracker), IsOk());
    const std::string text = BytesOf(options_.out);
    return text.substr(text.rfind("<points frame="));
  };
  EXPECT_THAT(end_of(4), HasSubstr("frame=\"4\" keyframe=\"1\" outside=\"1\""));
  EXPECT_THAT(end_of(6), HasSubstr("frame=\"5\" keyframe=\"1\" outside=\"0\""));
  EXPECT_THAT(end_of(0), HasSubstr("frame=\"5\" keyframe=\"1\" outside=\"0\""));
}

// A container's length is that of its longest track, which may be one of sound.
TEST_F(TrackCommandTest, AVideoWhoseContainerIsLongerIsCompleteAndDoubted) {
  options_.input = dir_.File("sound.mkv");
  WriteVideo(options_.input, "MJPG", 10, 60);
  PatchMatroska(options_.input, "\x44\x89\x88", std::string("\x40\xD3\x88\0\0\0\0\0", 8));  // 20000 ms
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  EXPECT_EQ(Tracks()["complete"], true);
  EXPECT_EQ(Tracks()["frames"], 60);
  EXPECT_THAT(log_.str(), HasSubstr("warning: " + options_.input + ": its pictures end at 5.9 of 20.0 seconds"));
}

TEST_F(TrackCommandTest, ARateThatTheInputDoesNotSayIsAGuess) {
  options_.input = dir_.File("one.mkv");
  WriteVideo(options_.input, "MJPG", 10, 1);
  PatchMatroska(options_.input, "\x23\xE3\x83\x84", "", "\xEC\x86\x80\x80");  // no time of a frame, but padding
  Points("1,10,20\n");
  FakeTracker tracker(MovingRight());
  ASSERT_THAT(Run(tracker), IsOk());
  EXPECT_EQ(Tracks()["fps"], 30);
  EXPECT_THAT(log_.str(), HasSubstr("does not say how many frames a second it has; taken for 30"));
}

TEST_F(TrackCommandTest, NoOutputTakesThePlaceOfAnInputOrOfAnother) {
  FakeTracker tracker(MovingRight());
  const std::string out = options_.out;
  options_.out = options_.points.file;
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("is --points, too")));
  options_.out = out;
  options_.overlay.still = dir_.File("mask.png");
  options_.overlay.video = dir_.File("frames/../overlay.mp4");
  Mask();
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("is --mask, too")));
  options_.points.mask.clear();
  std::filesystem::create_symlink(options_.points.file, dir_.File("overlay.mp4"));
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("is --points, too")));
  options_.overlay.video.clear();
  options_.overlay.still.clear();
  options_.points.file = dir_.File("t.objects.csv");
  options_.out = dir_.File("t.csv");
  Points("1,10,20\n");
  Mask();
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kInvalidArgument,
                                     AllOf(HasSubstr("objects of --out"), HasSubstr("is --points, too"))));
  options_.points.file.clear();
  std::filesystem::remove(dir_.File("t.objects.csv"));
  std::filesystem::create_directory(dir_.File("t.objects.csv"));
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("t.objects.csv: is a directory")));
  EXPECT_EQ(connections_, 0);
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
  EXPECT_THAT(message([](auto& o) { o.iterations = -1; }), HasSubstr("--iterations"));
}

}  // namespace
}  // namespace holdfast
