// SPDX-License-Identifier: Apache-2.0
// Tracks to paint, and what a painted picture shows.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "client/cli/track_table.h"
#include "tests/support/status_matchers.h"

namespace holdfast {

// Points 0, 1, ... move 10 px to the right a frame from x = 30, each on a row of its own, y = 20 + 40 * id.
inline TrackTable MovingPoints(int points, int64_t frames, int64_t final_count, bool visible) {
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

inline cv::Mat Black(int width = 320, int height = 180) { return cv::Mat::zeros(height, width, CV_8UC3); }

// Of the brightest channel.
inline int Brightness(const cv::Mat& picture, int x, int y) {
  const auto& p = picture.at<cv::Vec3b>(y, x);
  return std::max({p[0], p[1], p[2]});
}

}  // namespace holdfast
