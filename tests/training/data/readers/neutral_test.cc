// SPDX-License-Identifier: Apache-2.0
#include "training/data/readers/neutral.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "absl/strings/str_cat.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "training/data/image_files.h"
#include "training/data/synthetic/synthetic_dataset.h"

namespace holdfast {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

Sample SyntheticClip() {
  SyntheticOptions options;
  options.frames = 6;
  options.height = 64;
  options.width = 80;
  options.points = 10;
  Rng unused(0);
  return (*SyntheticDataset::Create(options))->Get(4, unused).value();
}

class NeutralTest : public ::testing::Test {
 protected:
  // One clip of three 40 x 30 frames with these tracks.
  void WriteClip(const std::string& tracks) {
    fs::create_directories(root_.path() / "frames");
    for (const char* name : {"00000.jpg", "00001.jpg", "00002.jpg"}) {
      ASSERT_THAT(
          WriteFrame((root_.path() / "frames" / name).string(), cv::Mat(30, 40, CV_8UC3, cv::Scalar(9, 99, 199))),
          IsOk());
    }
    std::ofstream(root_.File("tracks.json")) << tracks;
  }
  NeutralOptions Options() {
    NeutralOptions options;
    options.root = root_.path().string();
    return options;
  }
  absl::StatusOr<Sample> Get(const NeutralOptions& options, size_t index = 0, uint64_t seed = 1) {
    Rng rng(seed);
    return (*Neutral::Create(options))->Get(index, rng);
  }
  TempDir root_;
};

TEST_F(NeutralTest, ReadsSparseAnnotations) {
  WriteClip(R"({"width": 40, "height": 30, "fps": 25, "points": [
      {"name": "ear", "frames": [0, 2], "xy": [[1.5, 2], [50, 3]], "visible": [true, true]},
      {"name": "nose", "object": 7, "frames": [1], "xy": [[10, 20]], "visible": [0]}]})");
  const absl::StatusOr<Sample> clip = Get(Options());
  ASSERT_THAT(clip, IsOk());
  EXPECT_THAT(clip->Validate(), IsOk());
  EXPECT_EQ(clip->num_frames(), 3);
  ASSERT_EQ(clip->num_points(), 2);
  EXPECT_EQ(clip->fps, 25);
  EXPECT_EQ(clip->Position(0, 0), cv::Point2f(1.5f, 2));
  EXPECT_TRUE(clip->Visible(0, 0));
  EXPECT_FALSE(clip->Valid(1, 0));
  EXPECT_TRUE(clip->Valid(2, 0) && !clip->Visible(2, 0)) << "outside of the frame";
  EXPECT_TRUE(clip->Valid(1, 1) && !clip->Visible(1, 1));
  EXPECT_EQ(clip->object_ids[1], 7);
  EXPECT_EQ(clip->QueryFrame(0), 0);
  EXPECT_EQ(clip->QueryFrame(1), -1);
  EXPECT_NEAR(clip->frames[0].at<cv::Vec3b>(5, 5)[2], 199, 4) << "red, green, blue";
}

TEST_F(NeutralTest, APointMayBeHiddenNobodyKnowsWhere) {
  WriteClip(R"({"width": 40, "height": 30, "points": [
      {"frames": [0, 1, 2], "xy": [[1, 2], null, [3, 4]], "visible": [true, false, true]},
      {"frames": [0], "xy": [[1, 2]], "visible": [true]}]})");
  NeutralOptions options = Options();
  const absl::StatusOr<Sample> clip = Get(options);
  ASSERT_THAT(clip, IsOk());
  EXPECT_THAT(clip->Validate(), IsOk());
  EXPECT_EQ(clip->hidden, (std::vector<uint8_t>{0, 0, 1, 0, 0, 0}));
  EXPECT_FALSE(clip->Valid(1, 0));
  ASSERT_THAT(WriteNeutral(*clip, (root_.path() / "again" / "00000").string()), IsOk());
  options.root = (root_.path() / "again").string();
  EXPECT_EQ(Get(options)->hidden, clip->hidden);
  options.points = 1;
  EXPECT_EQ(Get(options)->hidden.size(), 3);
  options.frames = 2;
  EXPECT_THAT(Get(options)->hidden, ::testing::IsEmpty()) << "training has no use for it";
  WriteClip(R"({"width": 40, "height": 30, "points": [{"frames": [0], "xy": [null], "visible": [true]}]})");
  EXPECT_THAT(Get(Options()), StatusIs(absl::StatusCode::kDataLoss)) << "seen, but where?";
}

TEST_F(NeutralTest, WhatIsWrittenIsReadBack) {
  const Sample clip = SyntheticClip();
  ASSERT_THAT(WriteNeutral(clip, (root_.path() / "00000").string()), IsOk());
  const absl::StatusOr<Sample> back = Get(Options());
  ASSERT_THAT(back, IsOk());
  EXPECT_EQ(back->visible, clip.visible);
  EXPECT_EQ(back->valid, clip.valid);
  EXPECT_EQ(back->object_ids, clip.object_ids);
  for (int64_t s = 0; s < clip.num_frames(); ++s) {
    const size_t i = static_cast<size_t>(s);
    EXPECT_EQ(cv::norm(back->masks[i], clip.masks[i], cv::NORM_INF), 0);
    EXPECT_LT(
        cv::norm(back->frames[i], clip.frames[i], cv::NORM_L1) / (3.0 * static_cast<double>(clip.frames[i].total())),
        16);  // noise loses most
    for (int64_t n = 0; n < clip.num_points(); ++n) {
      if (clip.Valid(s, n)) {
        EXPECT_LT(cv::norm(back->Position(s, n) - clip.Position(s, n)), 1e-3);
      }
    }
  }
}

TEST_F(NeutralTest, AShorterClipReplacesALongerOne) {
  Sample clip = SyntheticClip();
  ASSERT_THAT(WriteNeutral(clip, root_.path().string()), IsOk());
  std::ofstream(root_.File("frames/cover.jpg")) << "of somebody else";
  clip.frames.resize(2);
  clip.masks.clear();
  clip.AllocatePoints(1);
  ASSERT_THAT(WriteNeutral(clip, root_.path().string()), IsOk());
  const absl::StatusOr<Sample> back = Get(Options());
  ASSERT_THAT(back, IsOk());
  EXPECT_EQ(back->num_frames(), 2);
  EXPECT_FALSE(back->has_masks());
  EXPECT_TRUE(fs::exists(root_.File("frames/cover.jpg")));
}

TEST_F(NeutralTest, TakesStretchesFromPlacesThatTheRngDraws) {
  ASSERT_THAT(WriteNeutral(SyntheticClip(), root_.path().string()), IsOk());
  const Sample whole = Get(Options()).value();
  NeutralOptions options = Options();
  options.frames = 3;
  std::vector<bool> seen(4, false);
  for (uint64_t seed = 0; seed < 40; ++seed) {
    const absl::StatusOr<Sample> part = Get(options, 0, seed);
    ASSERT_THAT(part, IsOk());
    ASSERT_EQ(part->num_frames(), 3);
    const size_t first = static_cast<size_t>(part->source.back() - '0');
    ASSERT_LT(first, 4u);
    EXPECT_EQ(cv::norm(part->frames[0], whole.frames[first], cv::NORM_INF), 0);
    EXPECT_EQ(cv::norm(part->masks[2], whole.masks[first + 2], cv::NORM_INF), 0);
    for (int64_t s = 0; s < 3; ++s) {
      EXPECT_EQ(part->Position(s, 1), whole.Position(static_cast<int64_t>(first) + s, 1));
      EXPECT_EQ(part->Visible(s, 1), whole.Visible(static_cast<int64_t>(first) + s, 1));
    }
    seen[first] = true;
  }
  EXPECT_EQ(std::count(seen.begin(), seen.end(), true), 4);
  options.frames = 7;
  EXPECT_THAT(Get(options), StatusIs(absl::StatusCode::kFailedPrecondition));
}

TEST_F(NeutralTest, ReadsNoPictureOutsideOfAStretch) {
  ASSERT_THAT(WriteNeutral(SyntheticClip(), root_.path().string()), IsOk());
  NeutralOptions options = Options();
  options.frames = 2;
  const std::string source = Get(options)->source;
  const int first = source.back() - '0';
  for (int s = 0; s < 6; ++s) {
    if (s == first || s == first + 1) continue;
    std::ofstream(root_.File(absl::StrCat("frames/0000", s, ".jpg"))) << "half";
    std::ofstream(root_.File(absl::StrCat("masks/0000", s, ".png"))) << "half";
  }
  const absl::StatusOr<Sample> part = Get(options);
  ASSERT_THAT(part, IsOk());
  EXPECT_EQ(part->source, source);
}

TEST_F(NeutralTest, ReadsNoMoreFramesAndPointsThanAskedFor) {
  ASSERT_THAT(WriteNeutral(SyntheticClip(), root_.path().string()), IsOk());
  NeutralOptions options = Options();
  options.max_frames = 2;
  options.points = 5;
  const absl::StatusOr<Sample> clip = Get(options);
  ASSERT_THAT(clip, IsOk());
  EXPECT_THAT(clip->Validate(), IsOk());
  EXPECT_EQ(clip->num_frames(), 2);
  EXPECT_EQ(clip->num_points(), 5);
}

TEST_F(NeutralTest, MalformedTracksAreErrorsThatNameTheFile) {
  const std::string head = R"({"width": 40, "height": 30, "points": )";
  for (const std::string& text : {
           std::string("no json"),
           std::string("[1, 2]"),
           std::string("{}"),
           std::string(R"({"points": []})"),
           std::string(R"({"width": "40", "height": 30, "points": []})"),
           std::string(R"({"width": 41, "height": 30, "points": []})"),
           head + "3}",
           head + "[3]}",
           head + R"([{"frames": [0], "xy": [], "visible": [1]}]})",
           head + R"([{"frames": [0], "xy": [[1]], "visible": [1]}]})",
           head + R"([{"frames": [0], "xy": [["a", 2]], "visible": [1]}]})",
           head + R"([{"frames": [0], "xy": [[1e30, 2]], "visible": [1]}]})",
           head + R"([{"frames": [-1], "xy": [[1, 2]], "visible": [1]}]})",
           head + R"([{"frames": [1, 1], "xy": [[1, 2], [1, 2]], "visible": [1, 1]}]})",
           head + R"([{"frames": [0], "xy": [[1, 2]], "visible": ["yes"]}]})",
           head + R"([{"frames": [0], "xy": [[1, 2]]}]})",
       }) {
    WriteClip(text);
    EXPECT_THAT(Get(Options()), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("tracks.json"))) << text;
  }
}

TEST_F(NeutralTest, MissingAndDamagedPicturesAreErrors) {
  const std::string tracks = R"({"width": 40, "height": 30, "points": []})";
  WriteClip(tracks);
  std::ofstream(root_.path() / "frames" / "00001.jpg") << "half";
  EXPECT_THAT(Get(Options()), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("00001.jpg")));
  WriteClip(tracks);
  fs::create_directories(root_.path() / "masks");
  ASSERT_THAT(WriteMask(root_.File("masks/00000.png"), cv::Mat(30, 40, CV_32SC1, cv::Scalar(1))), IsOk());
  EXPECT_THAT(Get(Options()), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("masks for some frames only")));
  fs::remove_all(root_.path() / "frames");
  EXPECT_THAT(Get(Options()), StatusIs(absl::StatusCode::kNotFound));
}

TEST_F(NeutralTest, AMissingFrameIsAnErrorThatNamesIt) {
  const std::string tracks = R"({"width": 40, "height": 30, "points": [
      {"frames": [0, 2], "xy": [[1, 2], [3, 4]], "visible": [true, true]}]})";
  WriteClip(tracks);
  fs::remove(root_.File("frames/00001.jpg"));
  EXPECT_THAT(Get(Options()), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("frames/00001.jpg is missing")));
  NeutralOptions options = Options();
  options.max_frames = 1;
  EXPECT_THAT(Get(options), IsOk()) << "what is read is complete";
  WriteClip(tracks);
  fs::remove(root_.File("frames/00002.jpg"));
  EXPECT_THAT(Get(Options()), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("frames/00002.jpg is missing")));
  options.max_frames = 2;
  EXPECT_THAT(Get(options), IsOk());
  options.max_frames = 3;
  EXPECT_THAT(Get(options), StatusIs(absl::StatusCode::kDataLoss));
}

// As where it may not be read: what there is behind it cannot be told.
TEST_F(NeutralTest, AnEntryThatCannotBeLookedIntoIsNoClip) {
  fs::create_symlink("loop", root_.path() / "loop");
  EXPECT_THAT(Neutral::Create(Options()).status(), StatusIs(absl::StatusCode::kNotFound));
  fs::create_directories(root_.path() / "clip");
  std::ofstream(root_.path() / "clip" / "tracks.json") << R"({"width": 40, "height": 30, "points": []})";
  ASSERT_THAT(Neutral::Create(Options()), IsOk());
  EXPECT_EQ((*Neutral::Create(Options()))->size(), 1u);
  fs::create_symlink("frames", root_.path() / "clip" / "frames");
  EXPECT_THAT(Get(Options()).status(), StatusIs(absl::StatusCode::kNotFound, HasSubstr("no frames")));
  NeutralOptions options;
  options.root = std::string(300, 'x');
  EXPECT_THAT(Neutral::Create(options).status(), StatusIs(absl::StatusCode::kNotFound));
}

TEST_F(NeutralTest, ADirectoryWithoutClipsIsRefused) {
  EXPECT_THAT(Neutral::Create(Options()), StatusIs(absl::StatusCode::kNotFound));
}

TEST_F(NeutralTest, AFullOrForbiddenDirectoryIsAnErrorOfTheWriter) {
  std::ofstream(root_.File("taken")) << "a file";
  EXPECT_THAT(WriteNeutral(SyntheticClip(), root_.File("taken")), StatusIs(absl::StatusCode::kUnavailable));
}

}  // namespace
}  // namespace holdfast
