// SPDX-License-Identifier: Apache-2.0
#include "client/cli/video.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/client/cli/remuxed_video.h"
#include "tests/client/cli/written_video.h"
#include "tests/support/source_tree.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

cv::Mat Flat(int width, int height, int value) { return {height, width, CV_8UC3, cv::Scalar::all(value)}; }

absl::StatusOr<int> FramesLeft(FrameSource& source) {
  for (int frames = 0;; ++frames) {
    const absl::StatusOr<bool> passed = source.Skip();
    if (!passed.ok()) return passed.status();
    if (!*passed) return frames;
  }
}

TEST(FrameSourceTest, ADirectoryGivesItsPicturesInTheOrderOfTheirNames) {
  const TempDir dir;
  cv::imwrite(dir.File("b.png"), Flat(8, 6, 20));
  cv::imwrite(dir.File("a.PNG"), Flat(8, 6, 10));
  cv::imwrite(dir.File("c.jpg"), Flat(8, 6, 30));
  std::ofstream(dir.File("notes.txt")) << "not a frame";
  std::ofstream(dir.File("._a.png")) << "what macOS keeps of it";
  const auto source = FrameSource::Open(dir.path().string());
  ASSERT_THAT(source, IsOk());
  EXPECT_EQ((*source)->size(), (ImageSize{8, 6}));
  EXPECT_EQ((*source)->frames(), 3);
  for (int value : {10, 20, 30}) {
    const auto frame = (*source)->Next();
    ASSERT_THAT(frame, IsOk());
    ASSERT_FALSE(frame->empty());
    EXPECT_NEAR(frame->at<cv::Vec3b>(3, 3)[0], value, 2);
  }
  EXPECT_TRUE((*source)->Next()->empty());
}

TEST(FrameSourceTest, NumbersInNamesCountByTheirWorth) {
  const TempDir dir;
  const std::vector<std::string> ordered = {"1.png",    "002.png",   "2.png",  "10.png",
                                            "a1b2.png", "a1b10.png", "a2.png", "b.png"};
  for (size_t i = 0; i < ordered.size(); ++i) cv::imwrite(dir.File(ordered[i]), Flat(8, 6, static_cast<int>(i)));
  const auto source = FrameSource::Open(dir.path().string());
  ASSERT_THAT(source, IsOk());
  for (size_t i = 0; i < ordered.size(); ++i) {
    const auto frame = (*source)->Next();
    ASSERT_THAT(frame, IsOk());
    EXPECT_EQ(frame->at<cv::Vec3b>(3, 3)[0], i) << ordered[i];
  }
}

TEST(FrameSourceTest, FramesOfAnotherSizeAreErrorsThatNameTheFrame) {
  const TempDir dir;
  cv::imwrite(dir.File("0.png"), Flat(8, 6, 0));
  cv::imwrite(dir.File("1.png"), Flat(8, 7, 0));
  const auto source = FrameSource::Open(dir.path().string());
  ASSERT_THAT(source, IsOk());
  EXPECT_THAT((*source)->Next(), IsOk());
  EXPECT_THAT((*source)->Next(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("frame 1 is 8x7")));
}

TEST(FrameSourceTest, APictureThatDoesNotDecodeIsNamed) {
  const TempDir dir;
  cv::imwrite(dir.File("0.png"), Flat(8, 6, 0));
  std::ofstream(dir.File("1.png")) << "broken";
  const auto source = FrameSource::Open(dir.path().string());
  ASSERT_THAT(source, IsOk());
  EXPECT_THAT((*source)->Next(), IsOk());
  EXPECT_THAT((*source)->Next(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("1.png")));
}

TEST(FrameSourceTest, AVideoFileGivesAllItsFrames) {
  const auto source = FrameSource::Open(InSourceTree("media/pedestrians.mp4"));
  ASSERT_THAT(source, IsOk());
  EXPECT_EQ((*source)->size(), (ImageSize{768, 576}));
  EXPECT_EQ((*source)->fps(), 10);
  EXPECT_EQ((*source)->frames(), 160);
  int frames = 0;
  while (!(*source)->Next()->empty()) ++frames;
  EXPECT_EQ(frames, 160);
}

// Of frames that are stored out of order the last ones have no time.
TEST(FrameSourceTest, AFileThatIsCutOffIsAnError) {
  const TempDir dir;
  for (const auto& [name, codec] : std::vector<std::pair<std::string, const char*>>{
           {"a.avi", "MJPG"}, {"b.mkv", "avc1"}, {"c.mkv", "MJPG"}, {"d.mkv", "mp4v"}}) {
    const std::string path = dir.File(name);
    WriteVideo(path, codec, 10, 60);
    const auto whole = FrameSource::Open(path);
    ASSERT_THAT(whole, IsOk());
    EXPECT_THAT(FramesLeft(**whole), IsOkAndHolds(60)) << name;
    EXPECT_EQ((*whole)->doubt(), "") << name;
    std::filesystem::resize_file(path, std::filesystem::file_size(path) * 2 / 3);
    const auto source = FrameSource::Open(path);
    ASSERT_THAT(source, IsOk());
    EXPECT_THAT(FramesLeft(**source), StatusIs(absl::StatusCode::kDataLoss, HasSubstr(name + ": is cut off"))) << name;
  }
}

// Writes zeros over a picture of MJPEG, but for the marks that it is found by.
void DamageJpeg(const std::string& path, int number) {
  std::string bytes = BytesOf(path);
  size_t begin = 0;
  for (int i = 0; i <= number; ++i) begin = bytes.find("\xFF\xD8\xFF", begin) + 2;
  begin += 2;
  const size_t end = bytes.find("\xFF\xD9", begin);
  std::fill(bytes.begin() + static_cast<ptrdiff_t>(begin), bytes.begin() + static_cast<ptrdiff_t>(end), '\0');
  std::ofstream(path, std::ios::binary) << bytes;
}

TEST(FrameSourceTest, AFrameOfAFileThatDoesNotDecodeIsNamed) {
  const TempDir dir;
  WriteVideo(dir.File("a.avi"), "MJPG", 10, 60);
  DamageJpeg(dir.File("a.avi"), 50);
  const auto source = FrameSource::Open(dir.File("a.avi"));
  ASSERT_THAT(source, IsOk());
  for (int i = 0; i < 50; ++i) ASSERT_THAT((*source)->Skip(), IsOkAndHolds(true));
  EXPECT_THAT((*source)->Next(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("a.avi: is damaged: frame 50")));
}

// Nothing follows it, and files may end in what is no frame.
TEST(FrameSourceTest, ALastFrameThatDoesNotDecodeIsMissed) {
  const TempDir dir;
  WriteVideo(dir.File("a.avi"), "MJPG", 10, 60);
  DamageJpeg(dir.File("a.avi"), 59);
  const auto source = FrameSource::Open(dir.File("a.avi"));
  ASSERT_THAT(source, IsOk());
  EXPECT_THAT(FramesLeft(**source), IsOkAndHolds(59));
  EXPECT_THAT((*source)->doubt(), HasSubstr("a.avi: gave 59 of 60 frames"));
}

void WriteJpegs(const std::string& path, int frames) {
  std::ofstream file(path, std::ios::binary);
  for (int i = 0; i < frames; ++i) {
    std::vector<uint8_t> jpeg;
    cv::imencode(".jpg", Flat(64, 48, i), jpeg);
    file << std::string(jpeg.begin(), jpeg.end());
  }
}

// Opens what a pipe gives, which has to hold all of it.
absl::StatusOr<std::unique_ptr<FrameSource>> OpenThroughPipe(const std::string& bytes) {
  int ends[2];
  if (pipe(ends) != 0) return absl::InternalError("no pipe");
  const auto written = write(ends[1], bytes.data(), bytes.size());
  close(ends[1]);
  auto source = FrameSource::Open(absl::StrCat("/dev/fd/", ends[0]));
  close(ends[0]);
  if (written != static_cast<ssize_t>(bytes.size())) return absl::InternalError("does not fit into a pipe");
  return source;
}

TEST(FrameSourceTest, AFrameOfALiveInputThatDoesNotDecodeIsLeftOut) {
  const TempDir dir;
  WriteJpegs(dir.File("a.mjpg"), 20);
  DamageJpeg(dir.File("a.mjpg"), 10);
  const auto source = OpenThroughPipe(BytesOf(dir.File("a.mjpg")));
  ASSERT_THAT(source, IsOk());
  EXPECT_TRUE((*source)->live());
  EXPECT_EQ((*source)->doubt(), "");
  EXPECT_THAT(FramesLeft(**source), IsOkAndHolds(19));
  EXPECT_THAT((*source)->doubt(), HasSubstr("is damaged, at 1 place"));
}

// It waits for whoever reads it, and its frames have numbers.
TEST(FrameSourceTest, AFileThatDoesNotSayHowLongItIsIsNotLive) {
  const TempDir dir;
  WriteJpegs(dir.File("a.mjpg"), 20);
  const auto whole = FrameSource::Open(dir.File("a.mjpg"));
  ASSERT_THAT(whole, IsOk());
  EXPECT_FALSE((*whole)->live());
  EXPECT_EQ((*whole)->frames(), 0);
  EXPECT_THAT(FramesLeft(**whole), IsOkAndHolds(20));
  EXPECT_EQ((*whole)->doubt(), "");
  DamageJpeg(dir.File("a.mjpg"), 10);
  const auto damaged = FrameSource::Open(dir.File("a.mjpg"));
  ASSERT_THAT(damaged, IsOk());
  EXPECT_THAT(FramesLeft(**damaged), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("frame 10 cannot be decoded")));
}

TEST(FrameSourceTest, JpegsOneAfterTheOtherSayNoRate) {
  const TempDir dir;
  WriteJpegs(dir.File("a.mjpg"), 3);
  const auto source = FrameSource::Open(dir.File("a.mjpg"));
  ASSERT_THAT(source, IsOk());
  EXPECT_EQ((*source)->fps(), 30);
  EXPECT_TRUE((*source)->fps_is_guess());
}

TEST(FrameSourceTest, AnMp4WithoutItsEndIsAnErrorWhereItsIndexComesFirst) {
  const TempDir dir;
  const std::string bytes = WithIndexFirst(BytesOf(InSourceTree("media/pedestrians.mp4")));
  std::ofstream(dir.File("whole.mp4"), std::ios::binary) << bytes;
  EXPECT_THAT(FramesLeft(**FrameSource::Open(dir.File("whole.mp4"))), IsOkAndHolds(160));
  std::ofstream(dir.File("cut.mp4"), std::ios::binary) << bytes.substr(0, bytes.size() / 2);
  const auto source = FrameSource::Open(dir.File("cut.mp4"));
  ASSERT_THAT(source, IsOk());
  EXPECT_THAT(FramesLeft(**source), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("of 160 frames")));
}

TEST(FrameSourceTest, SoundHasNoSayInWhereAVideoEnds) {
  const TempDir dir;
  for (const char* name : {"long.mkv", "long.mov"}) {
    Remux(InSourceTree("media/pedestrians.mp4"), dir.File(name), {}, /*sounds=*/5000);
    const auto source = FrameSource::Open(dir.File(name));
    ASSERT_THAT(source, IsOk()) << name;
    EXPECT_THAT(FramesLeft(**source), IsOkAndHolds(160)) << name;
  }
}

// An MP4 counts the frames of its first fragment alone.
TEST(FrameSourceTest, AllFragmentsOfAnMp4AreRead) {
  const TempDir dir;
  Remux(InSourceTree("media/pedestrians.mp4"), dir.File("a.mp4"), {{"frag_duration", "2000000"}});
  const auto whole = FrameSource::Open(dir.File("a.mp4"));
  ASSERT_THAT(whole, IsOk());
  EXPECT_LT((*whole)->frames(), 160);
  EXPECT_THAT(FramesLeft(**whole), IsOkAndHolds(160));
  EXPECT_EQ((*whole)->doubt(), "");
  std::filesystem::resize_file(dir.File("a.mp4"), std::filesystem::file_size(dir.File("a.mp4")) * 3 / 4);
  const auto cut = FrameSource::Open(dir.File("a.mp4"));
  ASSERT_THAT(cut, IsOk());
  EXPECT_THAT(FramesLeft(**cut), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("a.mp4: is cut off")));
}

TEST(FrameSourceTest, FramesThatAreMissingWithinAVideoAreDoubted) {
  const TempDir dir;
  Remux(InSourceTree("media/pedestrians.mp4"), dir.File("a.mkv"), {}, /*sounds=*/0, /*from=*/70, /*to=*/100);
  const auto source = FrameSource::Open(dir.File("a.mkv"));
  ASSERT_THAT(source, IsOk());
  EXPECT_THAT(FramesLeft(**source), IsOk());
  EXPECT_THAT((*source)->doubt(), HasSubstr("a.mkv: no frame comes for"));
}

// 64x48, with a red upper left corner, and the matrix {a, b, u, c, d, v, x, y, w} of its track replaced: what it is
// worth is behind 40 bytes of the track's header.
void WriteTurnedVideo(const std::string& path, const std::vector<int>& matrix) {
  cv::VideoWriter writer(path, cv::CAP_FFMPEG, cv::VideoWriter::fourcc('a', 'v', 'c', '1'), 10, {64, 48});
  cv::Mat picture(48, 64, CV_8UC3, cv::Scalar::all(0));
  picture(cv::Rect(0, 0, 32, 24)).setTo(cv::Scalar(0, 0, 255));
  for (int i = 0; i < 3; ++i) writer.write(picture);
  writer.release();
  std::string bytes = BytesOf(path);
  const size_t at = bytes.find("tkhd") + 4 + 40;
  for (size_t i = 0; i < 4; ++i) {
    const size_t entry = std::vector<size_t>{0, 1, 3, 4}[i];
    const auto value = static_cast<uint32_t>(matrix[i] * 65536);
    for (size_t byte = 0; byte < 4; ++byte) bytes[at + 4 * entry + byte] = static_cast<char>(value >> (24 - 8 * byte));
  }
  std::ofstream(path, std::ios::binary) << bytes;
}

// What phones write for a picture that was taken upright, upside down, or by a camera that sees its owner.
TEST(FrameSourceTest, VideosAreTurnedAsTheirTrackSays) {
  struct Case {
    std::string name;
    std::vector<int> matrix;  // {a, b, c, d}
    cv::Point red;            // the corner it comes to, of two by two
  };
  const TempDir dir;
  for (const Case& turn : std::vector<Case>{{"as stored", {1, 0, 0, 1}, {0, 0}},
                                            {"90 degrees clockwise", {0, 1, -1, 0}, {1, 0}},
                                            {"180 degrees", {-1, 0, 0, -1}, {1, 1}},
                                            {"270 degrees clockwise", {0, -1, 1, 0}, {0, 1}},
                                            {"left is right", {-1, 0, 0, 1}, {1, 0}},
                                            {"top is bottom", {1, 0, 0, -1}, {0, 1}},
                                            {"transposed", {0, 1, 1, 0}, {0, 0}},
                                            {"transposed the other way", {0, -1, -1, 0}, {1, 1}}}) {
    WriteTurnedVideo(dir.File("a.mp4"), turn.matrix);
    const auto source = FrameSource::Open(dir.File("a.mp4"));
    ASSERT_THAT(source, IsOk()) << turn.name;
    const bool sides_change = turn.matrix[0] == 0;
    EXPECT_EQ((*source)->size(), sides_change ? (ImageSize{48, 64}) : (ImageSize{64, 48})) << turn.name;
    const auto frame = (*source)->Next();
    ASSERT_THAT(frame, IsOk()) << turn.name;
    for (int y = 0; y < 2; ++y) {
      for (int x = 0; x < 2; ++x) {
        const int value =
            frame->at<cv::Vec3b>(frame->rows / 4 + y * frame->rows / 2, frame->cols / 4 + x * frame->cols / 2)[2];
        EXPECT_EQ(value > 127, turn.red == cv::Point(x, y)) << turn.name << ", at " << x << ", " << y;
      }
    }
  }
}

TEST(FrameSourceTest, RatesOfHighSpeedCamerasAreTaken) {
  const TempDir dir;
  for (const double fps : {999.0, 1000.0, 4000.0}) {
    WriteVideo(dir.File("fast.avi"), "MJPG", fps, 40);
    const auto source = FrameSource::Open(dir.File("fast.avi"));
    ASSERT_THAT(source, IsOk());
    EXPECT_EQ((*source)->fps(), fps);
    EXPECT_FALSE((*source)->fps_is_guess());
  }
}

TEST(FrameSourceTest, NotAllBelowDevIsACamera) {
  const std::string name = absl::StrCat("/dev/shm/holdfast-", getpid(), ".avi");
  if (access("/dev/shm", W_OK) == 0) {
    WriteVideo(name, "MJPG", 10, 3);
    const auto source = FrameSource::Open(name);
    std::filesystem::remove(name);
    EXPECT_THAT(source, IsOk());
  }
  const TempDir dir;
  WriteVideo(dir.File("a.avi"), "MJPG", 10, 3);
  const auto piped = OpenThroughPipe(BytesOf(dir.File("a.avi")));
  ASSERT_THAT(piped, IsOk());
  EXPECT_THAT(FramesLeft(**piped), IsOkAndHolds(3));
  EXPECT_THAT(FrameSource::Open("/dev/video987"), StatusIs(absl::StatusCode::kNotFound, HasSubstr("no such file")));
}

TEST(FrameSourceTest, BeginsAtAnyFrameAndPassesOverOthers) {
  const std::string video = InSourceTree("media/pedestrians.mp4");
  const auto whole = FrameSource::Open(video);
  const auto source = FrameSource::Open(video, 5);
  ASSERT_THAT(source, IsOk());
  std::vector<cv::Mat> frames;
  for (int i = 0; i < 8; ++i) frames.push_back(*(*whole)->Next());
  const auto same = [](const absl::StatusOr<cv::Mat>& a, const cv::Mat& b) { return cv::norm(*a, b) == 0; };
  EXPECT_TRUE(same((*source)->Next(), frames[5]));
  EXPECT_THAT((*source)->Skip(), IsOkAndHolds(true));
  EXPECT_TRUE(same((*source)->Next(), frames[7]));
  EXPECT_FALSE((*source)->live());
}

TEST(FrameSourceTest, AnInputThatEndsBeforeItsFirstFrameIsNamed) {
  const TempDir dir;
  for (const char* name : {"a.png", "b.png"}) cv::imwrite(dir.File(name), cv::Mat(4, 4, CV_8UC3, cv::Scalar::all(0)));
  EXPECT_THAT(FrameSource::Open(dir.path().string(), 2),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("has no frame 2, it ends after 2 frames")));
  const auto last = FrameSource::Open(dir.path().string(), 1);
  ASSERT_THAT(last, IsOk());
  EXPECT_THAT((*last)->Skip(), IsOkAndHolds(true));
  EXPECT_THAT((*last)->Skip(), IsOkAndHolds(false));
}

TEST(FrameSourceTest, InputsThatAreNoVideoAreNamed) {
  const TempDir dir;
  EXPECT_THAT(FrameSource::Open(dir.File("none.mp4")), StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.mp4")));
  EXPECT_THAT(FrameSource::Open(dir.path().string()), StatusIs(absl::StatusCode::kNotFound, HasSubstr("no .jpg")));
  std::ofstream(dir.File("text.mp4")) << "not a video";
  EXPECT_THAT(FrameSource::Open(dir.File("text.mp4")),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("text.mp4")));
  EXPECT_THAT(FrameSource::Open("camera:first"), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("camera:0")));
  EXPECT_THAT(FrameSource::Open("camera:987"), StatusIs(absl::StatusCode::kNotFound, HasSubstr("camera:987")));
}

TEST(FrameEncoderTest, LargeFramesAreSentSmallerAndPositionsFollow) {
  const FrameEncoder encoder({200, 100}, 50, 90);
  EXPECT_EQ(encoder.sent_size(), (ImageSize{50, 25}));
  const auto bytes = encoder.Encode(Flat(200, 100, 7));
  ASSERT_THAT(bytes, IsOk());
  const cv::Mat decoded = cv::imdecode(std::vector<char>(bytes->begin(), bytes->end()), cv::IMREAD_COLOR);
  EXPECT_EQ(decoded.size(), cv::Size(50, 25));
  EXPECT_NEAR(decoded.at<cv::Vec3b>(9, 9)[1], 7, 2);
  const PointQuery sent = encoder.ToSent({3, 41.5f, 9.5f});  // amid columns 40..43 and rows 8..11
  EXPECT_EQ(sent.x, 10);
  EXPECT_EQ(sent.y, 2);
  EXPECT_EQ(encoder.ToSent({3, 199, 99}).x, 49) << "the last column stays inside";
  EXPECT_EQ(encoder.ToSent({3, 0, 0}).y, 0) << "so does the first row";
  PointRun run;
  run.x = {10};
  run.y = {2};
  encoder.FromSent(run);
  EXPECT_EQ(run.x[0], 41.5f);
  EXPECT_EQ(run.y[0], 9.5f);
}

// The middle of what is bright in the first row.
double MiddleOfRow(const cv::Mat& gray) {
  int sum = 0;
  int count = 0;
  for (int x = 0; x < gray.cols; ++x) {
    if (gray.at<uint8_t>(0, x) <= 127) continue;
    sum += x;
    ++count;
  }
  return static_cast<double>(sum) / count;
}

cv::Mat Decoded(const std::string& bytes) {
  return cv::imdecode(std::vector<char>(bytes.begin(), bytes.end()), cv::IMREAD_GRAYSCALE);
}

TEST(FrameEncoderTest, NoPartOfAMaskIsTooThinToBeSent) {
  const FrameEncoder encoder({3840, 160}, 96, 90);  // a fortieth
  cv::Mat mask(160, 3840, CV_8UC1, cv::Scalar(0));
  mask(cv::Rect(410, 0, 1, 160)).setTo(1);
  mask.at<uint8_t>(85, 3003) = 1;
  std::vector<uint8_t> png;
  cv::imencode(".png", mask, png);
  const auto sent = encoder.ToSent(ObjectQuery{1, std::string(png.begin(), png.end())});
  ASSERT_THAT(sent, IsOk());
  const cv::Mat small = Decoded(sent->mask_png);
  ASSERT_EQ(small.size(), cv::Size(96, 4));
  EXPECT_EQ(cv::countNonZero(small), 4 + 1);
  EXPECT_EQ(cv::countNonZero(small.col(10)), 4);
  EXPECT_GT(small.at<uint8_t>(2, 75), 0);
}

TEST(FrameEncoderTest, WhatAPictureAndAMaskShowIsSentWherePointsOnItAre) {
  const FrameEncoder encoder({160, 80}, 32, 100);  // a fifth
  cv::Mat picture = Flat(160, 80, 0);
  picture.colRange(61, 76).setTo(cv::Scalar::all(255));
  cv::Mat mask;
  cv::cvtColor(picture, mask, cv::COLOR_BGR2GRAY);
  ObjectQuery object;
  std::vector<uint8_t> png;
  cv::imencode(".png", mask, png);
  object.mask_png.assign(png.begin(), png.end());
  const auto jpeg = encoder.Encode(picture);
  const auto sent = encoder.ToSent(object);
  ASSERT_THAT(jpeg, IsOk());
  ASSERT_THAT(sent, IsOk());
  const float middle = encoder.ToSent({1, 68, 0}).x;  // of columns 61..75
  EXPECT_NEAR(MiddleOfRow(Decoded(*jpeg)), middle, 0.5);
  EXPECT_NEAR(MiddleOfRow(Decoded(sent->mask_png)), middle, 0.5);
}

TEST(FrameEncoderTest, APartOfAnObjectIsWhereItsPixelsAre) {
  ObjectRun run;
  run.samples.resize(1);
  run.samples[0].centre = {10, 2};
  run.samples[0].outline = {{0, 0}, {49, 24}};
  FrameEncoder({200, 100}, 50, 90).FromSent(run);
  EXPECT_EQ(run.samples[0].centre.x, 41.5f);
  EXPECT_EQ(run.samples[0].outline[0].y, 1.5f);
  EXPECT_EQ(run.samples[0].outline[1].x, 197.5f);
}

TEST(FrameEncoderTest, SmallFramesAreSentAsTheyAre) {
  EXPECT_EQ(FrameEncoder({200, 100}, 0, 90).sent_size(), (ImageSize{200, 100}));
  EXPECT_EQ(FrameEncoder({200, 100}, 200, 90).sent_size(), (ImageSize{200, 100}));
  EXPECT_EQ(FrameEncoder({4000, 1}, 40, 90).sent_size(), (ImageSize{40, 1}));
}

}  // namespace
}  // namespace holdfast
