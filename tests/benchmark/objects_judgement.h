// SPDX-License-Identifier: Apache-2.0
// What was said of the objects of a synthetic clip, held against where the scene has them.
#pragma once

#include <cstdint>
#include <map>
#include <opencv2/core.hpp>
#include <vector>

#include "api/types.h"
#include "training/data/synthetic/scene.h"

namespace holdfast {

constexpr int kClipWidth = 512, kClipHeight = 384;  // of all clips

struct Clip {
  Scene scene;
  std::vector<cv::Mat> frames;  // RGB
  std::vector<cv::Mat> ids;
};

// An object, its points, and what was said about them.
struct Followed {
  const Layer* layer = nullptr;
  std::vector<cv::Point> covered;  // in the first frame
  cv::Mat solid;                   // of its texture: not zero where it has something, and a little around
  ObjectQuery query;
  std::map<PointId, PointRun> runs;
  ObjectRun said;
};

struct Share {
  int64_t part = 0, whole = 0;
  void Add(bool is_part) {
    ++whole;
    part += is_part ? 1 : 0;
  }
};

struct Mean {
  double sum = 0;
  int64_t count = 0;
  void Add(double value) {
    sum += value;
    ++count;
  }
};

// Of estimates that are visible by the tracker's word; "flagged": said to have left.
struct Findings {
  Share left_found;      // of points that left, those that were flagged then
  Share stayed_flagged;  // of the others, those that were flagged at all
  Share off_flagged;     // of estimates off their object
  Share on_flagged;      // of those on it
  Share flagged_wrong;   // of these flagged ones, those that are not at their true place
};

struct Tally {
  int64_t objects = 0, points = 0;
  Findings all;
  Findings held;        // on the frames where at least half of an object's estimates are on it
  Share anew_in_sight;  // of points that were placed anew, those that were where the object could be seen
  Share anew_on;        // and those on it, seen or not
  // By frame; of the centre, distances over the object's size. Of the points, those that have not left by the group's
  // word: how many of those asked for are visible by the tracker's word, and how many of them right.
  std::map<int64_t, Mean> overlap, points_overlap, centre, seen, on;
};

void Judge(const Clip& clip, const Followed& object, Tally& tally);

}  // namespace holdfast
