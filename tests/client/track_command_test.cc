// SPDX-License-Identifier: Apache-2.0
#include "client/track_command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

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

  absl::Status Run(PointTracker& tracker) {
    const auto connect = [this, &tracker]() -> absl::StatusOr<std::unique_ptr<PointTracker>> {
      ++connections_;
      return std::make_unique<Borrowed>(tracker);
    };
    return RunTrack(options_, {connect, stop_, log_, /*terminal=*/false});
  }

  nlohmann::json Tracks() { return nlohmann::json::parse(std::ifstream(options_.out)); }

  TempDir dir_;
  TrackOptions options_;
  StopSignal stop_;
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
  EXPECT_GT(std::filesystem::file_size(options_.overlay.video), 0u);
  EXPECT_THAT(log_.str(), HasSubstr("6/6 frames"));
  EXPECT_THAT(log_.str(), HasSubstr("wrote " + options_.out));
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

TEST_F(TrackCommandTest, AnErrorBeforeAnythingIsFinalWritesNothing) {
  auto behaviour = MovingRight();
  behaviour.fail_at_frame = 3;
  FakeTracker tracker(behaviour);
  options_.overlay.video = dir_.File("overlay.mp4");
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kUnavailable, HasSubstr("went away")));
  EXPECT_EQ(dir_.Count(), 2u) << "only the frames and the points";
}

// Makes frame 'frame' final as soon as it is pushed, and stops the command after 'last' frames.
class StoppingTracker final : public PointTracker {
 public:
  StoppingTracker(StopSignal& stop, int64_t last) : stop_(stop), last_(last) {}
  absl::StatusOr<std::unique_ptr<TrackStream>> Open(const SessionConfig&, TrackObserver& observer) override {
    return std::make_unique<Stream>(*this, observer);
  }
  absl::StatusOr<TrackerInfo> Info() override { return TrackerInfo{}; }
  bool cancelled() const { return cancelled_; }

 private:
  class Stream final : public TrackStream {
   public:
    Stream(StoppingTracker& tracker, TrackObserver& observer) : tracker_(tracker), observer_(observer) {}
    absl::Status PushFrame(Frame frame) override {
      observer_.OnTracks({{{1, frame.index, {5}, {6}, {1}, {1}, 1}}, frame.index + 1, frame.index + 1});
      if (frame.index + 1 == tracker_.last_) tracker_.stop_.Stop();
      return absl::OkStatus();
    }
    absl::Status AddPoints(std::vector<PointQuery>) override { return absl::OkStatus(); }
    absl::Status RemovePoints(std::vector<PointId>) override { return absl::OkStatus(); }
    absl::Status Finish() override { return absl::InternalError("a stopped session is not finished"); }
    void Cancel() override { tracker_.cancelled_ = true; }

   private:
    StoppingTracker& tracker_;
    TrackObserver& observer_;
  };

  StopSignal& stop_;
  const int64_t last_;
  bool cancelled_ = false;
};

TEST_F(TrackCommandTest, AnInterruptCancelsTheSessionAndKeepsWhatIsFinal) {
  Points("1,10,20\n");
  options_.overlay.still = dir_.File("still.png");
  StoppingTracker tracker(stop_, 3);
  EXPECT_THAT(Run(tracker), StatusIs(absl::StatusCode::kCancelled, HasSubstr("interrupted")));
  EXPECT_TRUE(tracker.cancelled());
  EXPECT_EQ(Tracks()["points"][0]["frames"], nlohmann::json::parse("[0, 1, 2]"));
  EXPECT_FALSE(cv::imread(options_.overlay.still).empty());
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
  EXPECT_THAT(message([](auto& o) { o.out = "t.xml"; }), HasSubstr("t.xml"));
  EXPECT_THAT(message([](auto& o) { o.overlay.video = "t.gif"; }), HasSubstr("t.gif"));
  EXPECT_THAT(message([](auto& o) { o.points.grid = 0; }), HasSubstr("no points"));
  EXPECT_THAT(message([](auto& o) { o.jpeg_quality = 101; }), HasSubstr("--jpeg_quality"));
  EXPECT_THAT(message([](auto& o) { o.max_side = 5; }), HasSubstr("--max_side"));
  EXPECT_THAT(message([](auto& o) { o.max_frames = -1; }), HasSubstr("--max_frames"));
  EXPECT_THAT(message([](auto& o) { o.hop_frames = -1; }), HasSubstr("--hop"));
  EXPECT_THAT(message([](auto& o) { o.iterations = -1; }), HasSubstr("--iterations"));
}

}  // namespace
}  // namespace holdfast
