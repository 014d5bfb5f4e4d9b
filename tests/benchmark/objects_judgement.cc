// SPDX-License-Identifier: Apache-2.0
#include "tests/benchmark/objects_judgement.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace holdfast {
namespace {

constexpr int64_t kSettled = 5;     // frames in a row off its object that make a point one that has left
constexpr double kRightPixels = 8;  // of a frame of 256x256: an estimate nearer to its true place is right

double Overlap(const std::vector<cv::Point2f>& a, const std::vector<cv::Point2f>& b) {
  std::vector<cv::Point2f> hull_a, hull_b, both;
  cv::convexHull(a, hull_a);
  cv::convexHull(b, hull_b);
  const double common = cv::intersectConvexConvex(hull_a, hull_b, both);
  const double all = cv::contourArea(hull_a) + cv::contourArea(hull_b) - common;
  return all > 0 ? common / all : 0;
}

struct Judged {
  bool seen = false, on = false, right = false, flagged = false;
};

// A point frame by frame; on those before its first, nothing.
std::vector<Judged> JudgePoint(const Clip& clip, const Followed& object, const PointRun& run) {
  const auto first = static_cast<size_t>(run.first_frame);
  const PlaneMap queried = clip.scene.MapAt(*object.layer, static_cast<double>(first));
  const cv::Point2d plane = queried.PlaneFromImage({run.x[0], run.y[0]});
  std::vector<Judged> judged(object.said.samples.size());
  for (size_t i = 0; i < run.x.size(); ++i) {
    const size_t t = first + i;
    const PlaneMap map = clip.scene.MapAt(*object.layer, static_cast<double>(t));
    const cv::Point2d texture = map.PlaneFromImage({run.x[i], run.y[i]}) + object.layer->Centre();
    const cv::Point pixel(cvRound(texture.x), cvRound(texture.y));
    const cv::Point2d apart = cv::Point2d(run.x[i], run.y[i]) - map.ImageFromPlane(plane);
    const std::vector<PointId>& left = object.said.samples[t].left;
    judged[t].seen = run.visible[i] != 0;
    judged[t].on = cv::Rect({0, 0}, object.solid.size()).contains(pixel) && object.solid.at<uint8_t>(pixel) != 0;
    judged[t].right = std::hypot(apart.x * 256 / kClipWidth, apart.y * 256 / kClipHeight) < kRightPixels;
    judged[t].flagged = std::binary_search(left.begin(), left.end(), run.id);
  }
  return judged;
}

// Where it was placed, of a point that was placed anew.
void JudgePlace(const Clip& clip, const Followed& object, const PointRun& run, const Judged& first, Tally& tally) {
  if (!IsPlacedAnew(run.id)) return;
  const cv::Mat& ids = clip.ids[static_cast<size_t>(run.first_frame)];
  tally.anew_in_sight.Add(ids.at<int32_t>(cvRound(run.y[0]), cvRound(run.x[0])) == object.layer->id);
  tally.anew_on.Add(first.on);
}

// 'counts': the frames that do.
void Count(const std::vector<Judged>& point, const std::vector<bool>& counts, Findings& findings) {
  int64_t off_in_a_row = 0;
  bool left = false, found = false, flagged = false;
  for (size_t t = 1; t < point.size(); ++t) {
    const Judged& now = point[t];
    if (!now.seen || !counts[t]) continue;
    flagged |= now.flagged;
    (now.on ? findings.on_flagged : findings.off_flagged).Add(now.flagged);
    if (now.on && now.flagged) findings.flagged_wrong.Add(!now.right);
    off_in_a_row = now.on ? 0 : off_in_a_row + 1;
    left |= off_in_a_row >= kSettled;
    found |= off_in_a_row >= kSettled && now.flagged;
  }
  if (left) {
    findings.left_found.Add(found);
  } else {
    findings.stayed_flagged.Add(flagged);
  }
}

void JudgePoints(const Clip& clip, const Followed& object, Tally& tally) {
  std::vector<std::vector<Judged>> points;
  for (const auto& [id, run] : object.runs) {
    points.push_back(JudgePoint(clip, object, run));
    JudgePlace(clip, object, run, points.back()[static_cast<size_t>(run.first_frame)], tally);
  }
  const size_t frames = points[0].size();
  std::vector<bool> held(frames), all(frames, true);
  for (size_t t = 0; t < frames; ++t) {
    Share on;
    for (const auto& point : points) {
      if (point[t].seen) on.Add(point[t].on);
    }
    held[t] = on.whole > 0 && 2 * on.part >= on.whole;
    if (t == 0 || t % 8 != 0) continue;
    Share seen, right;
    for (const auto& point : points) {
      if (!point[t].seen || point[t].flagged) continue;
      seen.Add(true);
      right.Add(point[t].on);
    }
    tally.seen[static_cast<int64_t>(t)].Add(static_cast<double>(seen.part) / object.query.points);
    if (right.whole > 0) tally.on[static_cast<int64_t>(t)].Add(static_cast<double>(right.part) / right.whole);
  }
  for (const auto& point : points) {
    Count(point, all, tally.all);
    Count(point, held, tally.held);
  }
}

void JudgeOutline(const Clip& clip, const Followed& object, Tally& tally) {
  const PlaneMap first = clip.scene.MapAt(*object.layer, 0);
  std::vector<cv::Point> hull;
  cv::convexHull(object.covered, hull);
  const double size = std::sqrt(static_cast<double>(object.covered.size()));
  cv::Point2d middle;
  for (const cv::Point& pixel : object.covered) middle += cv::Point2d(pixel);
  middle *= 1 / static_cast<double>(object.covered.size());
  for (size_t t = 8; t < object.said.samples.size(); t += 8) {
    // While a tenth of it is in sight.
    if (cv::countNonZero(clip.ids[t] == object.layer->id) * 10 < static_cast<int>(object.covered.size())) continue;
    const PlaneMap map = clip.scene.MapAt(*object.layer, static_cast<double>(t));
    const auto moved = [&](cv::Point2d pixel) { return map.ImageFromPlane(first.PlaneFromImage(pixel)); };
    std::vector<cv::Point2f> truth, said, points;
    for (const cv::Point& pixel : object.covered) truth.emplace_back(moved(cv::Point2d(pixel)));
    const ObjectSample& sample = object.said.samples[t];
    for (const Pixel& corner : sample.outline) said.emplace_back(corner.x, corner.y);
    for (const auto& [id, run] : object.runs) {
      const int64_t i = static_cast<int64_t>(t) - run.first_frame;
      if (i >= 0 && i < run.final_count) points.emplace_back(run.x[i], run.y[i]);
    }
    const auto frame = static_cast<int64_t>(t);
    tally.overlap[frame].Add(Overlap(truth, said));
    tally.points_overlap[frame].Add(Overlap(truth, points));
    const cv::Point2d apart = cv::Point2d(sample.centre.x, sample.centre.y) - moved(middle);
    tally.centre[frame].Add(std::hypot(apart.x, apart.y) / size);
  }
}

}  // namespace

void Judge(const Clip& clip, const Followed& object, Tally& tally) {
  ++tally.objects;
  tally.points += static_cast<int64_t>(object.runs.size());
  JudgePoints(clip, object, tally);
  JudgeOutline(clip, object, tally);
}

}  // namespace holdfast
