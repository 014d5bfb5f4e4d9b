// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <string>
#include <vector>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "training/data/synthetic/synthetic_dataset.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

// Small, quick, and without anything that changes colours.
SyntheticOptions Plain() {
  SyntheticOptions options;
  options.frames = 12;
  options.height = 96;
  options.width = 128;
  options.points = 48;
  options.photometric = false;
  options.motion_blur = false;
  options.shadows = false;
  return options;
}

Sample Clip(const SyntheticOptions& options, size_t index) {
  Rng unused(0);
  return (*SyntheticDataset::Create(options))->Get(index, unused).value();
}

cv::Vec3d ColourAt(const cv::Mat& frame, cv::Point2f at) {
  cv::Mat patch;
  cv::getRectSubPix(frame, {1, 1}, at, patch);
  return patch.at<cv::Vec3b>(0, 0);
}

double Largest(cv::Vec3d v) { return std::max({std::abs(v[0]), std::abs(v[1]), std::abs(v[2])}); }

bool Same(const Sample& a, const Sample& b) {
  for (size_t s = 0; s < a.frames.size(); ++s) {
    if (cv::norm(a.frames[s], b.frames[s], cv::NORM_INF) > 0 || cv::norm(a.masks[s], b.masks[s], cv::NORM_INF) > 0)
      return false;
  }
  return a.tracks == b.tracks && a.visible == b.visible && a.valid == b.valid && a.object_ids == b.object_ids;
}

// Backgrounds and round objects in waves of colour: steep enough that a track half a pixel off shows, smooth enough
// that interpolation does not.
void PaintSmoothPictures(const std::filesystem::path& root) {
  std::filesystem::create_directories(root / "objects");
  std::filesystem::create_directories(root / "backgrounds");
  const auto wave = [](double place) { return cv::saturate_cast<uint8_t>(128 + 90 * std::sin(place)); };
  for (int i = 0; i < 4; ++i) {
    cv::Mat picture(300, 400, CV_8UC3), object(120, 120, CV_8UC4);
    for (int y = 0; y < picture.rows; ++y) {
      for (int x = 0; x < picture.cols; ++x) {
        picture.at<cv::Vec3b>(y, x) = cv::Vec3b(wave(y * 0.08 + i), wave(x * 0.08), wave((y + x) * 0.05));
      }
    }
    for (int y = 0; y < object.rows; ++y) {
      for (int x = 0; x < object.cols; ++x) {
        const bool inside = std::hypot(y - 60, x - 60) < 55;
        object.at<cv::Vec4b>(y, x) =
            cv::Vec4b(wave(y * 0.08), wave(x * 0.08 + i), wave((y - x) * 0.05), inside ? 255 : 0);
      }
    }
    const std::string name = "picture" + std::to_string(i) + ".png";
    ASSERT_TRUE(cv::imwrite((root / "backgrounds" / name).string(), picture));
    ASSERT_TRUE(cv::imwrite((root / "objects" / name).string(), object));
  }
}

// Nothing but the point's own object as near as colours could mix, also where a near camera widens soft edges.
bool AwayFromEdges(const Sample& clip, int64_t s, int64_t n) {
  constexpr int kEdge = 5;  // pixels
  for (int dy = -kEdge; dy <= kEdge; ++dy) {
    for (int dx = -kEdge; dx <= kEdge; ++dx) {
      if (clip.IdAt(s, clip.Position(s, n) + cv::Point2f(cv::Point(dx, dy))) != clip.object_ids[static_cast<size_t>(n)])
        return false;
    }
  }
  return true;
}

// Largest difference from the first frame's colour at each (frame, point) where it can be seen for sure.
std::vector<double> ColourChanges(const Sample& clip) {
  std::vector<double> changes;
  for (int64_t n = 0; n < clip.num_points(); ++n) {
    if (!AwayFromEdges(clip, 0, n)) continue;
    const cv::Vec3d first = ColourAt(clip.frames[0], clip.Position(0, n));
    for (int64_t s = 1; s < clip.num_frames(); ++s) {
      if (!clip.Visible(s, n) || !AwayFromEdges(clip, s, n)) continue;
      changes.push_back(Largest(ColourAt(clip.frames[static_cast<size_t>(s)], clip.Position(s, n)) - first));
    }
  }
  return changes;
}

double Percentile(std::vector<double> values, double share) {
  const auto at = values.begin() + static_cast<int64_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

TEST(SyntheticTest, TheSameSeedAndIndexGiveTheSameClip) {
  SyntheticOptions options = Plain();
  options.photometric = options.motion_blur = options.shadows = true;
  for (size_t i = 0; i < 4; ++i) EXPECT_TRUE(Same(Clip(options, i), Clip(options, i))) << i;
}

TEST(SyntheticTest, AnotherSeedOrIndexGivesAnotherClip) {
  SyntheticOptions options = Plain();
  const Sample clip = Clip(options, 1);
  EXPECT_FALSE(Same(clip, Clip(options, 2)));
  options.seed = 1;
  EXPECT_FALSE(Same(clip, Clip(options, 1)));
}

TEST(SyntheticTest, ClipsKeepThePromisesOfASample) {
  for (size_t i = 0; i < 12; ++i) {
    const Sample clip = Clip(Plain(), i);
    EXPECT_THAT(clip.Validate(), IsOk());
    EXPECT_EQ(clip.num_frames(), 12);
    EXPECT_EQ(clip.num_points(), 48);
    EXPECT_EQ(clip.size(), (ImageSize{128, 96}));
    for (int64_t n = 0; n < clip.num_points(); ++n)
      EXPECT_TRUE(clip.Visible(0, n)) << i << ' ' << n << clip.Position(0, n);
  }
}

// Bent layers are part of this: about half of all objects and every seventh background are. So are limbs and layers of
// deep scenes.
TEST(SyntheticTest, TheColourUnderAVisiblePointStaysWhatItWas) {
  TempDir pictures;
  PaintSmoothPictures(pictures.path());
  SyntheticOptions options = Plain();
  options.height = 192;
  options.width = 256;
  options.pictures = pictures.path().string();
  options.picture_share = 1;
  options.plain_share = 0;  // repeated pictures have seams
  std::vector<double> changes;
  for (size_t i = 0; i < 40; ++i) {
    const std::vector<double> some = ColourChanges(Clip(options, i));
    changes.insert(changes.end(), some.begin(), some.end());
  }
  ASSERT_GT(changes.size(), 8000u);
  EXPECT_LE(Percentile(changes, 0.99), 2);  // grey levels
  EXPECT_LE(Percentile(changes, 1), 8);
}

TEST(SyntheticTest, WithoutMotionEvenFineTexturesStayExactlyWhereTheyWere) {
  SyntheticOptions options = Plain();
  options.motion_strength = 0;
  for (size_t i = 0; i < 5; ++i) {
    const Sample clip = Clip(options, i);
    for (size_t s = 1; s < clip.frames.size(); ++s) {
      // Occluders have nowhere to come from either.
      EXPECT_LE(cv::norm(clip.frames[s], clip.frames[0], cv::NORM_L1) / clip.frames[0].total(), 0.5) << i << ' ' << s;
    }
    for (int64_t n = 0; n < clip.num_points(); ++n) {
      EXPECT_LT(cv::norm(clip.Position(clip.num_frames() - 1, n) - clip.Position(0, n)), 0.1);
    }
  }
}

TEST(SyntheticTest, IdsAgreeWithTheMaskWhereverAPointIsVisible) {
  for (size_t i = 0; i < 12; ++i) {
    const Sample clip = Clip(Plain(), i);
    for (int64_t n = 0; n < clip.num_points(); ++n) {
      for (int64_t s = 0; s < clip.num_frames(); ++s) {
        if (!clip.Visible(s, n)) continue;
        EXPECT_EQ(clip.IdAt(s, clip.Position(s, n)), clip.object_ids[static_cast<size_t>(n)]);
      }
    }
  }
}

TEST(SyntheticTest, AHiddenPointIsHiddenByAnotherObjectOrTheFrame) {
  int64_t behind = 0, outside = 0;
  for (size_t i = 0; i < 30; ++i) {
    const Sample clip = Clip(Plain(), i);
    for (int64_t n = 0; n < clip.num_points(); ++n) {
      for (int64_t s = 0; s < clip.num_frames(); ++s) {
        if (clip.Visible(s, n)) continue;
        const cv::Point2f at = clip.Position(s, n);
        if (clip.Inside(at)) {
          EXPECT_NE(clip.IdAt(s, at), clip.object_ids[static_cast<size_t>(n)]);
          ++behind;
        } else {
          ++outside;
        }
      }
    }
  }
  EXPECT_GT(behind, 100);
  EXPECT_GT(outside, 100);
}

TEST(SyntheticTest, EveryPixelHasALabelAndAboutHalfOfThePointsAreOnObjects) {
  int64_t on_objects = 0, points = 0;
  for (size_t i = 0; i < 20; ++i) {
    const Sample clip = Clip(Plain(), i);
    for (const cv::Mat& mask : clip.masks) EXPECT_EQ(cv::countNonZero(mask), static_cast<int>(mask.total()));
    on_objects += std::count_if(clip.object_ids.begin(), clip.object_ids.end(), [](int32_t id) { return id > 1; });
    points += clip.num_points();
  }
  EXPECT_GE(static_cast<double>(on_objects) / static_cast<double>(points), 0.5);
  EXPECT_LE(static_cast<double>(on_objects) / static_cast<double>(points), 0.8);
}

// Mean distance from the start in the last frame, pixels.
double MeanMotion(const SyntheticOptions& options, size_t index) {
  const Sample clip = Clip(options, index);
  double sum = 0;
  for (int64_t n = 0; n < clip.num_points(); ++n) {
    sum += cv::norm(clip.Position(clip.num_frames() - 1, n) - clip.Position(0, n));
  }
  return sum / static_cast<double>(clip.num_points());
}

TEST(SyntheticTest, SomeClipsHaveNoMotionAtAll) {
  SyntheticOptions options = Plain();
  options.frames = 2;
  options.height = options.width = 32;
  options.points = 8;
  options.occluders = false;
  int still = 0;
  constexpr int kClips = 200;
  for (size_t i = 0; i < kClips; ++i) still += MeanMotion(options, i) < 1e-3;
  EXPECT_GE(still, kClips * 6 / 100);
  EXPECT_LE(still, kClips * 20 / 100);
}

TEST(SyntheticTest, MotionGrowsAlongTheRamp) {
  SyntheticOptions options = Plain();
  options.still_share = 0;
  options.motion_ramp_clips = 40;
  options.motion_ramp_start = 0;
  double early = 0, late = 0;
  for (size_t i = 1; i < 8; ++i) {
    early += MeanMotion(options, i);
    late += MeanMotion(options, 39 + i);
  }
  EXPECT_LT(4 * early, late);
}

TEST(SyntheticTest, PhotometricChangesLeaveTheLabelsAlone) {
  SyntheticOptions changed = Plain();
  changed.photometric = true;
  int different = 0;
  for (size_t i = 0; i < 8; ++i) {
    const Sample plain = Clip(Plain(), i), treated = Clip(changed, i);
    EXPECT_EQ(plain.tracks, treated.tracks);
    EXPECT_EQ(plain.visible, treated.visible);
    different += cv::norm(plain.frames[3], treated.frames[3], cv::NORM_INF) > 0;
  }
  EXPECT_GE(different, 6);
}

TEST(SyntheticTest, AnUnreadablePictureIsAnErrorThatNamesIt) {
  TempDir pictures;
  std::filesystem::create_directories(pictures.path() / "backgrounds");
  std::ofstream(pictures.File("backgrounds/broken.jpg")) << "this is no picture";
  SyntheticOptions options = Plain();
  options.pictures = pictures.path().string();
  options.picture_share = 1;
  Rng unused(0);
  EXPECT_THAT((*SyntheticDataset::Create(options))->Get(0, unused),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("broken.jpg")));
}

TEST(SyntheticTest, ADirectoryWithoutPicturesIsRefused) {
  TempDir empty;
  SyntheticOptions options = Plain();
  options.pictures = empty.path().string();
  EXPECT_THAT(SyntheticDataset::Create(options), StatusIs(absl::StatusCode::kNotFound));
}

TEST(SyntheticTest, OptionsOutsideTheirRangesAreRefused) {
  std::vector<SyntheticOptions> wrong(8, Plain());
  wrong[0].frames = 1;
  wrong[1].width = 8;
  wrong[2].points = 0;
  wrong[3].motion_strength = 1.5;
  wrong[4].still_share = std::nan("");
  wrong[5].count = 0;
  wrong[6].plain_share = -0.1;
  wrong[7].alike_share = 1.1;
  for (const SyntheticOptions& options : wrong) {
    EXPECT_THAT(SyntheticDataset::Create(options), StatusIs(absl::StatusCode::kInvalidArgument));
  }
}

}  // namespace
}  // namespace holdfast
