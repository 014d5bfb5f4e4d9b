// SPDX-License-Identifier: Apache-2.0
#include "server/engine/objects/reseeding.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "api/limits.h"
#include "server/engine/objects/placement.h"
#include "server/engine/objects/similarity.h"

namespace holdfast {
namespace {

constexpr size_t kLeastHeld = 4;         // points that hold to the object; three tell of a motion
constexpr double kLeastHeldShare = 0.5;  // of all its points
constexpr size_t kNeighbours = 5;        // of a point that has left; most of them have to hold
constexpr size_t kShareAtOnce = 4;       // a quarter of its points may be placed anew at a time
constexpr float kReach = 0.5f;           // of the spacing: how far a new point may be from where the lost one belongs

constexpr uint32_t kMostIndex = std::numeric_limits<uint32_t>::max() - kMaxObjectPoints;  // that has a successor

// A point's part in the frame that is to be decided on.
struct Standing {
  const ObjectMember* member = nullptr;
  bool holds = false;  // visible, and moving with the others
  bool lost = false;
};

// Nobody else stands at its place any more, and somebody may.
bool LeavesItsPlace(const ObjectMember& member, const ObjectState& state) {
  if (ObjectPointIndex(member.id) > kMostIndex) return false;
  return std::none_of(state.members.begin(), state.members.end(), [&](const ObjectMember& other) {
    return &other != &member && ObjectPlace(other.id) == ObjectPlace(member.id) && other.end > state.next + 1;
  });
}

// Of the points that the object will have after this frame.
std::vector<Standing> StandingsOf(const ObjectState& state, int64_t covered) {
  std::vector<Standing> standings;
  for (size_t i = 0; i < state.members.size(); ++i) {
    const ObjectMember& member = state.members[i];
    const ObjectJudgement::Standing& judged = state.judgement.standings[i];
    if (member.end <= state.next + 1 || member.samples.empty()) continue;
    Standing& standing = standings.emplace_back();
    standing.member = &member;
    const bool sure = judged.contrary == 0;
    standing.holds = member.samples.front().visible && !judged.left && sure;
    standing.lost = judged.left && sure && member.end > covered && LeavesItsPlace(member, state);
  }
  return standings;
}

// Whether the object is in sight around where the point belongs.
bool IsSupported(const Standing& point, std::vector<Standing> others) {
  others.erase(std::remove_if(others.begin(), others.end(),
                              [&point](const Standing& other) { return other.member == point.member; }),
               others.end());
  const size_t count = std::min(kNeighbours, others.size());
  std::partial_sort(others.begin(), others.begin() + static_cast<std::ptrdiff_t>(count), others.end(),
                    [home = point.member->home](const Standing& a, const Standing& b) {
                      return Distance(a.member->home, home) < Distance(b.member->home, home);
                    });
  const auto held = std::count_if(others.begin(), others.begin() + static_cast<std::ptrdiff_t>(count),
                                  [](const Standing& other) { return other.holds; });
  return 2 * static_cast<size_t>(held) > count;
}

}  // namespace

Reseeding FindReseeding(const ObjectState& state, int64_t covered) {
  Reseeding reseeding;
  reseeding.frame = state.next;
  const std::vector<Standing> standings = StandingsOf(state, covered);
  const auto held = static_cast<size_t>(
      std::count_if(standings.begin(), standings.end(), [](const Standing& point) { return point.holds; }));
  if (held < kLeastHeld || static_cast<double>(held) < kLeastHeldShare * static_cast<double>(standings.size())) {
    return reseeding;
  }
  const Similarity& motion = state.judgement.motion;
  const size_t most = (standings.size() + kShareAtOnce - 1) / kShareAtOnce;
  for (const Standing& point : standings) {
    if (point.lost && reseeding.lost.size() < most && IsSupported(point, standings)) {
      reseeding.lost.push_back(point.member->id);
      reseeding.belong.push_back(motion.Map(point.member->home));
    } else if (!point.lost) {
      reseeding.kept.push_back(point.holds ? point.member->samples.front().at : motion.Map(point.member->home));
    }
  }
  for (const Pixel& corner : state.shape.outline) reseeding.outline.push_back(motion.Map(corner));
  reseeding.spacing = static_cast<float>(state.shape.size * motion.scale() / std::sqrt(standings.size()));
  return reseeding;
}

std::vector<Pixel> PlaceAnew(const Reseeding& reseeding, const GrayImage& picture, ImageSize frame) {
  const float scale_x = static_cast<float>(picture.size.width) / static_cast<float>(frame.width);
  const float scale_y = static_cast<float>(picture.size.height) / static_cast<float>(frame.height);
  const auto in_picture = [&](Pixel p) { return FlowPoint{p.x * scale_x, p.y * scale_y}; };
  // What lies far outside may lie anywhere there.
  const auto pixel = [](float at, int size) {
    return cvRound(std::clamp(at, -2.0f * static_cast<float>(size), 3.0f * static_cast<float>(size)));
  };
  const auto rounded = [&](Pixel p) {
    return cv::Point(pixel(p.x * scale_x, picture.size.width), pixel(p.y * scale_y, picture.size.height));
  };
  std::vector<cv::Point> corners;
  for (const Pixel& corner : reseeding.outline) corners.push_back(rounded(corner));
  cv::Mat inside(picture.size.height, picture.size.width, CV_8UC1, cv::Scalar(0)), near = inside.clone();
  cv::fillConvexPoly(inside, corners, cv::Scalar(255));
  const auto most = static_cast<float>(std::max(picture.size.width, picture.size.height));
  const int reach = cvRound(std::clamp(kReach * reseeding.spacing * std::sqrt(scale_x * scale_y), 1.0f, most));
  for (const Pixel& place : reseeding.belong) cv::circle(near, rounded(place), reach, cv::Scalar(255), cv::FILLED);
  GrayImage mask{picture.size, std::vector<uint8_t>(picture.pixels.size())};
  cv::Mat allowed(picture.size.height, picture.size.width, CV_8UC1, mask.pixels.data());
  cv::bitwise_and(inside, near, allowed);
  std::vector<FlowPoint> kept;
  for (const Pixel& point : reseeding.kept) kept.push_back(in_picture(point));
  std::vector<Pixel> places;
  for (const FlowPoint& at : PlacePoints(picture, mask, static_cast<int>(reseeding.lost.size()), kept)) {
    places.push_back({std::min(at.x / scale_x, static_cast<float>(frame.width - 1)),
                      std::min(at.y / scale_y, static_cast<float>(frame.height - 1))});
  }
  return places;
}

}  // namespace holdfast
