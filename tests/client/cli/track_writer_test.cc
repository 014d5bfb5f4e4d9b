// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_writer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zip.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

// Two points on three frames: the first with a provisional end, the second from frame 1 on and once hidden.
TrackTable Example() {
  TrackTable table({{{4, 0, 0}, 0, "nose \"x\""}, {{9, 0, 0}, 1, "9"}});
  const PointRun first{4, 0, {1.25f, 2.0004f, 3}, {10, 20, 30}, {1, 1, 1}, {0.5f, 0.25f, 1}, 2};
  const PointRun second{9, 1, {7, 8}, {70, 80}, {0, 1}, {0.125f, 1}, 2};
  EXPECT_THAT(table.Apply({{first, second}, 3, 3}), IsOk());
  return table;
}

// Frames 7 and 9 of the input, with a point that starts on the second.
TrackTable OfChosenFrames() {
  TrackTable table({{{9, 0, 0}, 9, "\u00fc\u20ac\U0001f600"}});
  table.AddFrame(7, absl::FromUnixMillis(12500));
  table.AddFrame(9);
  EXPECT_THAT(table.Apply({{{9, 1, {7}, {70}, {1}, {1}, 1}}, 2, 2}), IsOk());
  return table;
}

constexpr VideoFacts kVideo{{64, 48}, 10};

constexpr TrackExtent Complete(int64_t frames) { return {frames, frames, frames, true}; }
constexpr TrackExtent kPartial{3, 2, 7, false};

std::string Content(const std::string& path) {
  std::stringstream out;
  out << std::ifstream(path, std::ios::binary).rdbuf();
  return out.str();
}

std::string ZipMember(const std::string& path, const std::string& name) {
  zip_t* archive = zip_open(path.c_str(), ZIP_RDONLY, nullptr);
  if (archive == nullptr) return "no archive";
  zip_file_t* file = zip_fopen(archive, name.c_str(), 0);
  std::string bytes(4096, '\0');
  bytes.resize(file == nullptr ? 0 : static_cast<size_t>(zip_fread(file, bytes.data(), bytes.size())));
  if (file != nullptr) zip_fclose(file);
  zip_discard(archive);
  return bytes;
}

TEST(TrackWriterTest, TheSuffixChoosesTheFormat) {
  EXPECT_THAT(TrackFormatOf("a/b.json"), IsOkAndHolds(TrackFormat::kJson));
  EXPECT_THAT(TrackFormatOf("b.CSV"), IsOkAndHolds(TrackFormat::kCsv));
  EXPECT_THAT(TrackFormatOf("b.npz"), IsOkAndHolds(TrackFormat::kNpz));
  EXPECT_THAT(TrackFormatOf("b.dlc.csv"), IsOkAndHolds(TrackFormat::kDeepLabCut));
  EXPECT_THAT(TrackFormatOf("b.xml"), IsOkAndHolds(TrackFormat::kCvat));
  EXPECT_THAT(TrackFormatOf("b.3de.txt"), IsOkAndHolds(TrackFormat::k3de));
  EXPECT_THAT(TrackFormatOf("b.npy"), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("b.npy")));
}

TEST(TrackWriterTest, JsonHoldsTheEstimatesOfEachPointAndSaysHowMuchThereIs) {
  const TempDir dir;
  ASSERT_THAT(WriteTracks(dir.File("t.json"), Example(), kVideo, kPartial), IsOk());
  const auto json = nlohmann::json::parse(Content(dir.File("t.json")));
  EXPECT_EQ(json["width"], 64);
  EXPECT_EQ(json["height"], 48);
  EXPECT_EQ(json["fps"], 10);
  EXPECT_EQ(json["frames"], 3);
  EXPECT_EQ(json["complete"], false);
  EXPECT_EQ(json["final_frames"], 2);
  EXPECT_EQ(json["expected_frames"], 7);
  ASSERT_EQ(json["points"].size(), 2u);
  EXPECT_EQ(json["points"][0], nlohmann::json::parse(R"({"id": 4, "name": "nose \"x\"",
      "frames": [0, 1, 2], "xy": [[1.25, 10], [2.0, 20], [3, 30]], "visible": [true, true, true],
      "confidence": [0.5, 0.25, 1]})"));
  EXPECT_EQ(json["points"][1]["frames"], nlohmann::json::parse("[1, 2]"));
  EXPECT_EQ(json["points"][1]["visible"], nlohmann::json::parse("[false, true]"));
}

TEST(TrackWriterTest, ACompleteFileSaysSo) {
  const TempDir dir;
  TrackTable table({{{4, 0, 0}, 0, "4"}});
  ASSERT_THAT(table.Apply({{{4, 0, {1, 2}, {3, 4}, {1, 1}, {1, 1}, 2}}, 2, 2}), IsOk());
  ASSERT_THAT(WriteTracks(dir.File("t.json"), table, kVideo, Complete(2)), IsOk());
  const auto json = nlohmann::json::parse(Content(dir.File("t.json")));
  EXPECT_EQ(json["complete"], true);
  for (const char* key : {"frames", "final_frames", "expected_frames"}) EXPECT_EQ(json[key], 2) << key;
  ASSERT_THAT(WriteTracks(dir.File("t.npz"), table, kVideo, Complete(2)), IsOk());
  EXPECT_EQ(ZipMember(dir.File("t.npz"), "complete.npy").back(), '\1');
}

template <typename T>
std::string Bytes(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

TEST(TrackWriterTest, FilesHoldTheObjectOnTheFramesOfTheInputThatItIsKnownOn) {
  const TempDir dir;
  StartObject object;
  object.query.id = 1;
  object.frame = 9;
  object.first_point = 5;
  TrackTable table({{{4, 0, 0}, 7, "4"}}, object);
  for (const int64_t number : {7, 9, 11}) table.AddFrame(number);
  TrackUpdate update{
      {{4, 0, {1, 2}, {3, 4}, {1, 1}, {1, 1}, 2}, {5, 1, {7}, {70}, {1}, {1}, 1}, {261, 2, {6}, {60}, {1}, {1}, 1}},
      3,
      3};
  update.objects = {{1, 1, {{{3.5f, 4}, 1.25f, -0.5f, 0.75f, {{0, 1}, {2, 3}}, {5}, {261}}}, 1}};
  ASSERT_THAT(table.Apply(update), IsOk());
  ASSERT_THAT(WriteTracks(dir.File("t.json"), table, kVideo, kPartial), IsOk());
  EXPECT_EQ(nlohmann::json::parse(Content(dir.File("t.json")))["objects"], nlohmann::json::parse(R"([{"id": 1,
      "points": [5, 261], "frames": [9], "xy": [[3.5, 4]], "scale": [1.25], "rotation": [-0.5], "visible": [0.75],
      "outline": [[[0, 1], [2, 3]]], "left": [[5]], "joined": [[261]]}])"));
  ASSERT_THAT(WriteTracks(dir.File("t.csv"), table, kVideo, kPartial), IsOk());
  EXPECT_THAT(Content(dir.File("t.csv")), HasSubstr("\n5,9,7.000,70.000,1,1.000\n"));
  EXPECT_EQ(Content(dir.File("t.objects.csv")),
            "object,frame,x,y,scale,rotation,visible,outline,left,joined\n"
            "1,9,3.500,4.000,1.2500,-0.5000,0.7500,0.000 1.000;2.000 3.000,5,261\n");
  std::filesystem::create_directory(dir.File("u.objects.csv"));
  EXPECT_FALSE(WriteTracks(dir.File("u.csv"), table, kVideo, kPartial).ok());
  EXPECT_EQ(Content(dir.File("u.csv")), Content(dir.File("t.csv"))) << "its object does not cost the tracks";
  ASSERT_THAT(WriteTracks(dir.File("t.npz"), table, kVideo, kPartial), IsOk());
  const auto array = [&](const char* name) { return ZipMember(dir.File("t.npz"), name).substr(128); };
  EXPECT_EQ(array("left.npy"), std::string("\0\0\0\0\1\0\0\0\0", 9));
  EXPECT_EQ(array("of_object.npy"), Bytes<int64_t>({-1, 1, 1}));
  EXPECT_EQ(array("replaces.npy"), Bytes<int64_t>({-1, -1, 1}));
  EXPECT_EQ(array("object_ids.npy"), Bytes<int64_t>({1}));
  EXPECT_EQ(array("object_centre.npy").substr(8, 8), Bytes<float>({3.5F, 4}));
  EXPECT_EQ(array("object_visible.npy"), Bytes<float>({0, 0.75F, 0}));
  EXPECT_EQ(array("object_outline.npy").substr(16, 16), Bytes<float>({0, 1, 2, 3}));
  EXPECT_THAT(ZipMember(dir.File("t.npz"), "object_outline.npy"),
              HasSubstr("'<f4', 'fortran_order': False, 'shape': (1, 3, 2, 2), }"));
  ASSERT_THAT(WriteTracks(dir.File("t.json"), Example(), kVideo, kPartial), IsOk());
  EXPECT_FALSE(nlohmann::json::parse(Content(dir.File("t.json"))).contains("objects"));
}

TEST(TrackWriterTest, CsvHasALineForEachEstimate) {
  const TempDir dir;
  ASSERT_THAT(WriteTracks(dir.File("t.csv"), Example(), kVideo, kPartial), IsOk());
  EXPECT_EQ(
      Content(dir.File("t.csv")),
      "id,frame,x,y,visible,confidence\n4,0,1.250,10.000,1,0.500\n4,1,2.000,20.000,1,0.250\n4,2,3.000,30.000,1,1.000\n"
      "9,1,7.000,70.000,0,0.125\n9,2,8.000,80.000,1,1.000\n");
}

TEST(TrackWriterTest, NpzHoldsArraysOverPointsAndFramesWithNanWhereThereIsNoEstimate) {
  const TempDir dir;
  ASSERT_THAT(WriteTracks(dir.File("t.npz"), Example(), kVideo, kPartial), IsOk());
  const std::string tracks = ZipMember(dir.File("t.npz"), "tracks.npy");
  EXPECT_THAT(tracks, HasSubstr("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3, 2), }"));
  ASSERT_EQ(tracks.size(), 128 + 12 * sizeof(float));
  float xy[12];
  std::memcpy(xy, tracks.data() + 128, sizeof(xy));
  EXPECT_EQ(xy[0], 1.25f);
  EXPECT_EQ(xy[3], 20.0f);
  EXPECT_EQ(xy[4], 3.0f);          // provisional
  EXPECT_TRUE(std::isnan(xy[6]));  // before the point's start
  EXPECT_EQ(xy[8], 7.0f);
  const std::string visible = ZipMember(dir.File("t.npz"), "visible.npy");
  EXPECT_THAT(visible, HasSubstr("'|b1'"));
  EXPECT_EQ(visible.substr(visible.size() - 6), std::string("\1\1\1\0\0\1", 6));
  EXPECT_THAT(ZipMember(dir.File("t.npz"), "ids.npy"), HasSubstr("'shape': (2,), }"));
}

TEST(TrackWriterTest, NumpyReadsTheNpz) {
  if (std::system("/usr/bin/python3 -c 'import numpy' 2>/dev/null") != 0) GTEST_SKIP() << "NumPy is not installed";
  const TempDir dir;
  ASSERT_THAT(WriteTracks(dir.File("t.npz"), Example(), kVideo, kPartial), IsOk());
  std::ofstream(dir.File("check.py")) << R"(
import numpy, sys
f = numpy.load(sys.argv[1])
assert f['tracks'].shape == (2, 3, 2) and f['tracks'].dtype == numpy.float32
assert f['tracks'][1, 1].tolist() == [7, 70] and numpy.isnan(f['tracks'][1, 0]).all()
assert f['visible'].dtype == bool and f['visible'].tolist() == [[True, True, True], [False, False, True]]
assert f['confidence'].dtype == numpy.float32 and f['confidence'].tolist() == [[.5, .25, 1], [0, .125, 1]]
assert f['complete'].dtype == bool and f['complete'].shape == () and not f['complete']
assert f['final_frames'].dtype == numpy.int64 and f['final_frames'] == 2 and f['expected_frames'] == 7
assert f['ids'].dtype == numpy.int64 and f['ids'].tolist() == [4, 9]
assert f['names'].tolist() == ['nose "x"', '9'] and f['query_frames'].tolist() == [0, 1]
assert f['frames'].tolist() == [0, 1, 2] and f['size'].tolist() == [64, 48] and f['fps'] == 10
assert 'capture_times' not in f
f = numpy.load(sys.argv[2])
assert f['frames'].tolist() == [7, 9] and f['query_frames'].tolist() == [9] and f['names'].tolist() == ['\u00fc\u20ac\U0001f600']
assert f['tracks'][0, 1].tolist() == [7, 70] and numpy.isnan(f['tracks'][0, 0]).all()
assert f['capture_times'][0] == 12.5 and numpy.isnan(f['capture_times'][1])
)";
  ASSERT_THAT(WriteTracks(dir.File("chosen.npz"), OfChosenFrames(), kVideo, Complete(2)), IsOk());
  const std::string files = " " + dir.File("t.npz") + " " + dir.File("chosen.npz");
  EXPECT_EQ(std::system(("/usr/bin/python3 " + dir.File("check.py") + files).c_str()), 0);
}

TEST(TrackWriterTest, FramesHaveTheNumbersOfTheInput) {
  const TempDir dir;
  ASSERT_THAT(WriteTracks(dir.File("t.json"), OfChosenFrames(), kVideo, Complete(2)), IsOk());
  const auto json = nlohmann::json::parse(Content(dir.File("t.json")));
  EXPECT_EQ(json["frames"], 2);
  EXPECT_EQ(json["points"][0]["frames"], nlohmann::json::parse("[9]"));
  EXPECT_EQ(json["capture_times"], nlohmann::json::parse(R"([[7, "1970-01-01T00:00:12.5+00:00"]])"));
  ASSERT_THAT(WriteTracks(dir.File("t.csv"), OfChosenFrames(), kVideo, Complete(2)), IsOk());
  EXPECT_THAT(Content(dir.File("t.csv")), HasSubstr("\n9,9,7.000,70.000,1,1.000\n"));
}

TEST(TrackWriterTest, ATableWithoutFramesIsWrittenToo) {
  const TempDir dir;
  const TrackTable table({{{1, 0, 0}, 0, "1"}});
  for (const char* name : {"t.json", "t.csv", "t.npz"})
    EXPECT_THAT(WriteTracks(dir.File(name), table, kVideo, Complete(0)), IsOk());
  EXPECT_THAT(ZipMember(dir.File("t.npz"), "tracks.npy"), HasSubstr("(1, 0, 2)"));
}

}  // namespace
}  // namespace holdfast
