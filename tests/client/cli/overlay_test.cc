// SPDX-License-Identifier: Apache-2.0
#include "client/cli/overlay.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include "client/cli/overlay_video.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

// Points 0, 1, ... move 10 px to the right a frame, each on a row of its own, y = 20 + 40 * id.
TrackTable Moving(int points, int64_t frames, int64_t final_count, bool visible) {
  std::vector<StartPoint> starts;
  TrackUpdate update{{}, frames, frames};
  for (int id = 0; id < points; ++id) {
    starts.push_back({{static_cast<PointId>(id), 0, 0}, 0, ""});
    PointRun run;
    run.id = id;
    run.final_count = final_count;
    for (int64_t t = 0; t < frames; ++t) {
      run.x.push_back(30.0f + 10.0f * static_cast<float>(t));
      run.y.push_back(20.0f + 40.0f * static_cast<float>(id));
    }
    run.visible.assign(frames, visible ? 1 : 0);
    run.confidence.assign(frames, 1);
    update.runs.push_back(run);
  }
  TrackTable table(starts);
  EXPECT_THAT(table.Apply(update), IsOk());
  return table;
}

cv::Mat Black() { return cv::Mat::zeros(180, 320, CV_8UC3); }
int Brightness(const cv::Mat& picture, int x, int y) {
  const cv::Vec3b p = picture.at<cv::Vec3b>(y, x);
  return std::max({p[0], p[1], p[2]});
}

int Brightest(const cv::Mat& picture) {
  double largest = 0;
  cv::minMaxLoc(picture.clone().reshape(1), nullptr, &largest);
  return static_cast<int>(largest);
}

TEST(OverlayPainterTest, AVisiblePointIsADiscAndAHiddenOneARing) {
  cv::Mat disc = Black(), ring = Black();
  OverlayPainter(0).Paint(Moving(1, 1, 1, true), 0, disc);
  OverlayPainter(0).Paint(Moving(1, 1, 1, false), 0, ring);
  EXPECT_GT(Brightness(disc, 30, 20), 200);
  EXPECT_LT(Brightness(ring, 30, 20), 60);
  EXPECT_GT(Brightest(ring.row(20)), 150);
  EXPECT_EQ(Brightness(disc, 40, 20), 0) << "no trail was asked for";
}

TEST(OverlayPainterTest, ATrailFadesWithAgeAndEnds) {
  cv::Mat picture = Black();
  OverlayPainter(20).Paint(Moving(1, 28, 28, true), 26, picture);  // the point is at x = 290
  EXPECT_GT(Brightness(picture, 275, 20), 200);
  EXPECT_GT(Brightness(picture, 275, 20), Brightness(picture, 175, 20));
  EXPECT_GT(Brightness(picture, 175, 20), Brightness(picture, 105, 20));
  EXPECT_GT(Brightness(picture, 105, 20), 0);
  EXPECT_EQ(Brightness(picture, 60, 20), 0);
}

TEST(OverlayPainterTest, NeighboursHaveDifferentColoursThatStay) {
  const TrackTable table = Moving(2, 2, 2, true);
  cv::Mat first = Black(), second = Black();
  OverlayPainter(0).Paint(table, 0, first);
  OverlayPainter(0).Paint(table, 1, second);
  EXPECT_NE(first.at<cv::Vec3b>(20, 30), first.at<cv::Vec3b>(60, 30));
  EXPECT_EQ(first.at<cv::Vec3b>(20, 30), second.at<cv::Vec3b>(20, 40));
}

TEST(OverlayPainterTest, PositionsFarOutsideAndNotANumberAreNotDrawn) {
  TrackTable table({{{1, 0, 0}, 0, ""}, {{2, 0, 0}, 0, ""}});
  const float nan = std::numeric_limits<float>::quiet_NaN();
  ASSERT_THAT(
      table.Apply(
          {{{1, 0, {nan, 1e30f}, {5, 5}, {1, 1}, {1, 1}, 2}, {2, 0, {-9, -9}, {5, 5}, {1, 1}, {1, 1}, 2}}, 2, 2}),
      IsOk());
  cv::Mat picture = Black();
  OverlayPainter(20).Paint(table, 1, picture);
  EXPECT_EQ(cv::countNonZero(picture.reshape(1)), 0);
}

TEST(OverlayVideoTest, FramesArePaintedOnceWhenAskedForAndTheRestIsLeftOut) {
  const TempDir dir;
  OverlayVideo overlay({dir.File("o.mp4"), dir.File("s.png"), -1, 20}, {{320, 180}, 10});
  for (int i = 0; i < 6; ++i) ASSERT_THAT(overlay.Add(Black()), IsOk());
  ASSERT_THAT(overlay.Paint(Moving(1, 6, 2, true), 2), IsOk());
  ASSERT_THAT(overlay.Paint(Moving(1, 6, 4, true), 4), IsOk());
  ASSERT_THAT(overlay.Close(), IsOk());
  cv::VideoCapture video(dir.File("o.mp4"), cv::CAP_FFMPEG);
  cv::Mat frame, last;
  int frames = 0;
  for (; video.read(frame); ++frames) last = frame.clone();
  EXPECT_EQ(frames, 4);
  EXPECT_EQ(video.get(cv::CAP_PROP_FPS), 10);
  EXPECT_GT(Brightness(last, 60, 20), 80);  // where the point is in frame 3
  const cv::Mat still = cv::imread(dir.File("s.png"));
  ASSERT_EQ(still.size(), cv::Size(320, 180));
  EXPECT_GT(Brightness(still, 60, 20), 200);
  EXPECT_EQ(dir.Count(), 2u);
}

TEST(OverlayVideoTest, TheStillCanShowAnEarlierFrame) {
  const TempDir dir;
  OverlayVideo overlay({"", dir.File("s.png"), 1, 0}, {{320, 180}, 10});
  for (int i = 0; i < 6; ++i) ASSERT_THAT(overlay.Add(Black()), IsOk());
  ASSERT_THAT(overlay.Paint(Moving(1, 6, 6, true), 6), IsOk());
  ASSERT_THAT(overlay.Close(), IsOk());
  const cv::Mat still = cv::imread(dir.File("s.png"));
  EXPECT_GT(Brightness(still, 40, 20), 200);
  EXPECT_EQ(Brightness(still, 80, 20), 0);
}

TEST(OverlayVideoTest, WhatIsNotClosedLeavesNoFile) {
  const TempDir dir;
  {
    OverlayVideo overlay({dir.File("o.mp4"), dir.File("s.png"), -1, 20}, {{320, 180}, 10});
    ASSERT_THAT(overlay.Add(Black()), IsOk());
    ASSERT_THAT(overlay.Paint(Moving(1, 1, 1, true), 1), IsOk());
  }
  EXPECT_EQ(dir.Count(), 0u);
}

TEST(OverlayVideoTest, ProvisionalEstimatesArePaintedWhenAskedFor) {
  const TempDir dir;
  OverlayVideo overlay({"", dir.File("s.png"), -1, 0}, {{320, 180}, 10});
  for (int i = 0; i < 3; ++i) ASSERT_THAT(overlay.Add(Black()), IsOk());
  ASSERT_THAT(overlay.Paint(Moving(1, 3, 1, true), 3), IsOk());
  ASSERT_THAT(overlay.Close(), IsOk());
  EXPECT_GT(Brightness(cv::imread(dir.File("s.png")), 50, 20), 200);
}

TEST(OverlayVideoTest, WithoutAPaintedFrameTheOldFilesStay) {
  const TempDir dir;
  for (const char* name : {"o.mp4", "s.png"}) std::ofstream(dir.File(name)) << "old";
  {
    OverlayVideo overlay({dir.File("o.mp4"), dir.File("s.png"), -1, 20}, {{320, 180}, 10});
    ASSERT_THAT(overlay.Add(Black()), IsOk());
    ASSERT_THAT(overlay.Close(), IsOk());
  }
  EXPECT_EQ(std::filesystem::file_size(dir.File("o.mp4")), 3u);
  EXPECT_EQ(std::filesystem::file_size(dir.File("s.png")), 3u);
  EXPECT_EQ(dir.Count(), 2u);
}

TEST(OverlayVideoTest, AVideoThatCannotBeWrittenIsKnownAtTheFirstFrame) {
  OverlayVideo overlay({"/proc/o.mp4", "", -1, 20}, {{320, 180}, 10});
  EXPECT_THAT(overlay.Add(Black()), StatusIs(absl::StatusCode::kUnavailable, HasSubstr("/proc/o.mp4")));
}

TEST(OverlayVideoTest, OtherSuffixesAreRefusedAtOnce) {
  EXPECT_THAT((OverlayVideo::Options{"a.gif", "", -1, 20}.Validate()),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("a.gif")));
  EXPECT_THAT((OverlayVideo::Options{"", "a.webp", -1, 20}.Validate()),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("a.webp")));
  EXPECT_THAT((OverlayVideo::Options{"a.MP4", "a.JPG", -1, 20}.Validate()), IsOk());
}

}  // namespace
}  // namespace holdfast
