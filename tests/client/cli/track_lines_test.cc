// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_lines.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

namespace holdfast {
namespace {

using nlohmann::json;

std::vector<json> Lines(const std::string& text) {
  std::vector<json> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(json::parse(line));
  return lines;
}

TEST(TrackLinesTest, EveryEstimateIsALineAtOnceAndTheLastOneSaysHowMuchThereIs) {
  std::ostringstream out;
  TrackLines lines({{{4, 0, 0}, 0, "nose \"x\""}}, out);
  EXPECT_TRUE(lines.Write({{{4, 7, {1.25f, 2}, {10, 20}, {1, 0}, {0.5f, 0.25f}, 1}}, 9, 8}, TrackTable({})));
  ASSERT_EQ(Lines(out.str()).size(), 2u);
  EXPECT_TRUE(lines.End({9, 8, 12, false}));
  const std::vector<json> all = Lines(out.str());
  ASSERT_EQ(all.size(), 3u);
  EXPECT_EQ(all[0], json::parse(R"({"id": 4, "name": "nose \"x\"", "frame": 7, "x": 1.25, "y": 10.0, "visible": true,
                                    "confidence": 0.5, "final": true})"));
  EXPECT_EQ(all[1], json::parse(R"({"id": 4, "name": "nose \"x\"", "frame": 8, "x": 2.0, "y": 20.0, "visible": false,
                                    "confidence": 0.25, "final": false})"));
  EXPECT_EQ(all[2], json::parse(R"({"complete": false, "frames": 9, "final_frames": 8, "expected_frames": 12})"));
}

TEST(TrackLinesTest, WhatJsonDoesNotKnowIsNull) {
  std::ostringstream out;
  TrackLines lines({{{1, 0, 0}, 0, "\xFF"}}, out);
  lines.Write({{{1, 0, {NAN}, {INFINITY}, {1}, {1}, 0}}, 1, 1}, TrackTable({}));
  const json line = Lines(out.str()).at(0);
  EXPECT_TRUE(line["x"].is_null());
  EXPECT_TRUE(line["y"].is_null());
}

TEST(TrackLinesTest, FramesHaveTheNumberAndTheCaptureTimeOfTheInput) {
  std::ostringstream out;
  TrackTable table({{{1, 0, 0}, 40, "1"}});
  table.AddFrame(40, absl::FromUnixMillis(1500));
  table.AddFrame(43);
  TrackLines lines({}, out);
  lines.Write({{{1, 0, {1, 2}, {3, 4}, {1, 1}, {1, 1}, 0}}, 2, 2}, table);
  const std::vector<json> all = Lines(out.str());
  EXPECT_EQ(all[0]["frame"], 40);
  EXPECT_EQ(all[0]["capture_time"], "1970-01-01T00:00:01.5+00:00");
  EXPECT_EQ(all[1]["frame"], 43);
  EXPECT_FALSE(all[1].contains("capture_time"));
}

TEST(TrackLinesTest, SaysWhenNobodyReads) {
  std::ostringstream out;
  out.setstate(std::ios::badbit);
  TrackLines lines({}, out);
  EXPECT_FALSE(lines.Write({}, TrackTable({})));
  EXPECT_FALSE(lines.End({}));
}

TEST(TrackLinesTest, AnObjectHasLinesOfItsOwn) {
  std::ostringstream out;
  TrackLines lines({}, out);
  TrackUpdate update{{{12, 7, {1}, {2}, {1}, {1}, 0}}, 9, 8};
  update.objects = {{1, 7, {{{3.5f, 4}, 1.25f, -0.5f, 0.75f, {{0, 0}}, {12, 13}, {268}}}, 1}};
  EXPECT_TRUE(lines.Write(update, TrackTable({})));
  const std::vector<json> all = Lines(out.str());
  ASSERT_EQ(all.size(), 2u);
  EXPECT_EQ(all[0]["name"], "12") << "a point that the server placed";
  EXPECT_EQ(all[1], json::parse(R"({"object": 1, "frame": 7, "x": 3.5, "y": 4.0, "scale": 1.25, "rotation": -0.5,
                                    "visible": 0.75, "left": [12, 13], "joined": [268], "final": true})"));
}

TEST(TrackLinesTest, AnObjectsFramesAreTheInputsToo) {
  std::ostringstream out;
  TrackTable table({});
  table.AddFrame(40, absl::FromUnixMillis(1500));
  TrackUpdate update;
  update.objects = {{1, 0, {{}}, 0}};
  TrackLines({}, out).Write(update, table);
  const json line = Lines(out.str()).at(0);
  EXPECT_EQ(line["frame"], 40);
  EXPECT_EQ(line["capture_time"], "1970-01-01T00:00:01.5+00:00");
}

}  // namespace
}  // namespace holdfast
