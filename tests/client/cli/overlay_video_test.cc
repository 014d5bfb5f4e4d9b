// SPDX-License-Identifier: Apache-2.0
#include "client/cli/overlay_video.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <string>
#include <vector>

#include "tests/client/cli/moving_points.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr VideoFacts kVideo{{320, 180}, 10};

// The frames of a video file, as a player gives them.
std::vector<cv::Mat> Frames(const std::string& path) {
  cv::VideoCapture video(path, cv::CAP_FFMPEG);
  std::vector<cv::Mat> frames;
  for (cv::Mat frame; video.read(frame);) frames.push_back(frame.clone());
  return frames;
}

// No file of this process grows beyond so many bytes while this lives, as on a full disk.
class SmallFiles {
 public:
  explicit SmallFiles(rlim_t bytes) {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit small{bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &small);
  }
  ~SmallFiles() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }

 private:
  rlimit before_{};
  void (*const handler_)(int) = std::signal(SIGXFSZ, SIG_IGN);  // writes fail instead
};

void AddBlack(int count, OverlayVideo& overlay) {
  for (int i = 0; i < count; ++i) ASSERT_THAT(overlay.Add(Black()), IsOk());
}

TEST(OverlayVideoTest, EachFrameShowsItsPointWhereItIs) {
  const TempDir dir;
  OverlayVideo overlay({dir.File("o.mp4"), "", -1, 0}, kVideo);
  const cv::Rect patch(180, 80, 100, 80);
  for (int t = 0; t < 5; ++t) {
    cv::Mat frame = Black();
    frame(patch).setTo(cv::Scalar::all(40 * t));
    ASSERT_THAT(overlay.Add(frame), IsOk());
  }
  ASSERT_THAT(overlay.Paint(MovingPoints(1, 5, 5, true), 5), IsOk());
  ASSERT_THAT(overlay.Close(), IsOk());
  EXPECT_EQ(cv::VideoCapture(dir.File("o.mp4"), cv::CAP_FFMPEG).get(cv::CAP_PROP_FPS), 10);
  const std::vector<cv::Mat> frames = Frames(dir.File("o.mp4"));
  ASSERT_THAT(frames, SizeIs(5));
  for (int t = 0; t < 5; ++t) {
    ASSERT_EQ(frames[t].size(), cv::Size(320, 180));
    for (int other = 0; other < 5; ++other) {
      const int brightness = Brightness(frames[t], 30 + 10 * other, 20);
      if (other == t) {
        EXPECT_GT(brightness, 80) << "frame " << t;
      } else {
        EXPECT_LT(brightness, 60) << "frame " << t << " shows where the point is in frame " << other;
      }
    }
    EXPECT_NEAR(Brightness(frames[t], 230, 120), 40 * t, 12) << "away from the point the frame is as it was";
  }
}

TEST(OverlayVideoTest, FramesArePaintedOnceWhenAskedForAndTheRestIsLeftOut) {
  const TempDir dir;
  OverlayVideo overlay({dir.File("o.mp4"), dir.File("s.png"), -1, 20}, kVideo);
  AddBlack(6, overlay);
  ASSERT_THAT(overlay.Paint(MovingPoints(1, 6, 2, true), 2), IsOk());
  ASSERT_THAT(overlay.Paint(MovingPoints(1, 6, 4, true), 4), IsOk());
  ASSERT_THAT(overlay.Close(), IsOk());
  const std::vector<cv::Mat> frames = Frames(dir.File("o.mp4"));
  ASSERT_THAT(frames, SizeIs(4));
  EXPECT_GT(Brightness(frames.back(), 60, 20), 80);  // where the point is in frame 3
  const cv::Mat still = cv::imread(dir.File("s.png"));
  ASSERT_EQ(still.size(), cv::Size(320, 180));
  EXPECT_GT(Brightness(still, 60, 20), 200);
  EXPECT_EQ(dir.Count(), 2u);
}

TEST(OverlayVideoTest, NoFrameIsPaintedBeforeItIsThereOrAskedFor) {
  const TempDir dir;
  OverlayVideo overlay({"", dir.File("s.png"), -1, 0}, kVideo);
  ASSERT_THAT(overlay.Paint(MovingPoints(1, 3, 3, true), 3), IsOk()) << "no frame is there yet";
  AddBlack(3, overlay);
  ASSERT_THAT(overlay.Paint(MovingPoints(1, 3, 3, true), 2), IsOk());
  ASSERT_THAT(overlay.Close(), IsOk());
  EXPECT_GT(Brightness(cv::imread(dir.File("s.png")), 40, 20), 200);
}

TEST(OverlayVideoTest, SidesMayBeOdd) {
  const TempDir dir;
  OverlayVideo overlay({dir.File("o.mp4"), "", -1, 0}, {{161, 91}, 25});
  for (int i = 0; i < 3; ++i) ASSERT_THAT(overlay.Add(Black(161, 91)), IsOk());
  ASSERT_THAT(overlay.Paint(MovingPoints(1, 3, 3, true), 3), IsOk());
  ASSERT_THAT(overlay.Close(), IsOk());
  const std::vector<cv::Mat> frames = Frames(dir.File("o.mp4"));
  ASSERT_THAT(frames, SizeIs(3));
  EXPECT_NEAR(frames[2].cols, 161, 1) << "encoders may want even sides";
  EXPECT_NEAR(frames[2].rows, 91, 1);
  EXPECT_GT(Brightness(frames[2], 50, 20), 80);
}

TEST(OverlayVideoTest, TheStillCanShowAnEarlierFrame) {
  const TempDir dir;
  OverlayVideo overlay({"", dir.File("s.png"), 1, 0}, kVideo);
  AddBlack(6, overlay);
  ASSERT_THAT(overlay.Paint(MovingPoints(1, 6, 6, true), 6), IsOk());
  ASSERT_THAT(overlay.Close(), IsOk());
  const cv::Mat still = cv::imread(dir.File("s.png"));
  EXPECT_GT(Brightness(still, 40, 20), 200);
  EXPECT_EQ(Brightness(still, 80, 20), 0);
}

TEST(OverlayVideoTest, WhatIsNotClosedLeavesNoFile) {
  const TempDir dir;
  {
    OverlayVideo overlay({dir.File("o.mp4"), dir.File("s.png"), -1, 20}, kVideo);
    AddBlack(1, overlay);
    EXPECT_EQ(dir.Count(), 1u) << "the video is open";
    EXPECT_FALSE(std::filesystem::exists(dir.File("o.mp4"))) << "but has not got its name";
    ASSERT_THAT(overlay.Paint(MovingPoints(1, 1, 1, true), 1), IsOk());
  }
  EXPECT_EQ(dir.Count(), 0u);
}

TEST(OverlayVideoTest, ProvisionalEstimatesArePaintedWhenAskedFor) {
  const TempDir dir;
  OverlayVideo overlay({"", dir.File("s.png"), -1, 0}, kVideo);
  AddBlack(3, overlay);
  ASSERT_THAT(overlay.Paint(MovingPoints(1, 3, 1, true), 3), IsOk());
  ASSERT_THAT(overlay.Close(), IsOk());
  EXPECT_GT(Brightness(cv::imread(dir.File("s.png")), 50, 20), 200);
}

TEST(OverlayVideoTest, WithoutAPaintedFrameTheOldFilesStay) {
  const TempDir dir;
  for (const char* name : {"o.mp4", "s.png"}) std::ofstream(dir.File(name)) << "old";
  {
    OverlayVideo overlay({dir.File("o.mp4"), dir.File("s.png"), -1, 20}, kVideo);
    AddBlack(1, overlay);
    ASSERT_THAT(overlay.Close(), IsOk());
  }
  EXPECT_EQ(std::filesystem::file_size(dir.File("o.mp4")), 3u);
  EXPECT_EQ(std::filesystem::file_size(dir.File("s.png")), 3u);
  EXPECT_EQ(dir.Count(), 2u);
}

TEST(OverlayVideoTest, AVideoThatCannotBeWrittenIsKnownAtTheFirstFrame) {
  const TempDir dir;
  for (const std::string& path : {std::string("/proc/o.mp4"), dir.File("no/o.mp4")}) {
    OverlayVideo overlay({path, "", -1, 20}, kVideo);
    EXPECT_THAT(overlay.Add(Black()), StatusIs(absl::StatusCode::kUnavailable, HasSubstr(path)));
  }
  EXPECT_EQ(dir.Count(), 0u);
}

TEST(OverlayVideoTest, AStillThatCannotBeWrittenIsNamedAndDoesNotCostTheVideo) {
  const TempDir dir;
  OverlayVideo overlay({dir.File("o.mp4"), dir.File("no/s.png"), -1, 20}, kVideo);
  AddBlack(2, overlay);
  ASSERT_THAT(overlay.Paint(MovingPoints(1, 2, 2, true), 2), IsOk());
  const absl::Status closed = overlay.Close();
  EXPECT_FALSE(closed.ok());
  EXPECT_THAT(closed.message(), HasSubstr("no/s.png"));
  EXPECT_THAT(Frames(dir.File("o.mp4")), SizeIs(2));
  EXPECT_EQ(dir.Count(), 1u);
}

TEST(OverlayVideoTest, AVideoWhoseNameIsTakenIsNamedAndLeavesNothing) {
  const TempDir dir;
  {
    OverlayVideo overlay({dir.File("o.mp4"), "", -1, 20}, kVideo);
    AddBlack(1, overlay);
    ASSERT_THAT(overlay.Paint(MovingPoints(1, 1, 1, true), 1), IsOk());
    std::filesystem::create_directory(dir.File("o.mp4"));
    const absl::Status closed = overlay.Close();
    EXPECT_FALSE(closed.ok());
    EXPECT_THAT(closed.message(), HasSubstr("o.mp4"));
  }
  EXPECT_EQ(dir.Count(), 1u) << "the directory alone";
}

TEST(OverlayVideoTest, AVideoThatIsNotWholeDoesNotTakeAnOldOnesPlace) {
  const TempDir dir;
  std::ofstream(dir.File("o.mp4")) << "old";
  OverlayVideo overlay({dir.File("o.mp4"), "", -1, 20}, kVideo);
  AddBlack(3, overlay);
  {
    const SmallFiles full(64);
    ASSERT_THAT(overlay.Paint(MovingPoints(1, 3, 3, true), 3), IsOk());
    EXPECT_THAT(overlay.Close(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("o.mp4: is not whole")));
  }
  EXPECT_EQ(std::filesystem::file_size(dir.File("o.mp4")), 3u);
  EXPECT_EQ(dir.Count(), 1u);
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
