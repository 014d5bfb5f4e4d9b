// SPDX-License-Identifier: Apache-2.0
// Runs of the command over six pictures, by a tracker that a test keeps.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "client/cli/track_command.h"
#include "tests/support/fake_tracker.h"
#include "tests/support/temp_dir.h"

namespace holdfast {

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
inline FakeTracker::Behaviour MovingRight() {
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

}  // namespace holdfast
