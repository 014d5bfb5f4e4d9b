// SPDX-License-Identifier: Apache-2.0
#include "server/engine/objects/placement.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace holdfast {
namespace {

constexpr int kCandidatesAPoint = 24;  // about so many places are looked at for each point
constexpr int kTextureBlock = 7;       // pixels
constexpr int kMargin = 8;             // pixels around the object that its texture is computed from
constexpr float kPlain = 0.35f;        // what room on a plain surface counts, beside the same on texture

cv::Mat PictureView(const GrayImage& image) {
  // Only read.
  return cv::Mat(image.size.height, image.size.width, CV_8UC1, const_cast<uint8_t*>(image.pixels.data()));
}

struct Candidate {
  cv::Point at;
  float texture = 0;  // the lesser eigenvalue of the gradients around it
  float room = 0;     // how far it is from the border and from the points there are; twice as far from the border
};

// How far each pixel of the mask is from those that are not, [box] float32. The picture's edge is a border too.
cv::Mat Depth(const cv::Mat& mask, const cv::Rect& box) {
  cv::Mat framed, depth;
  cv::copyMakeBorder(mask(box), framed, 1, 1, 1, 1, cv::BORDER_CONSTANT | cv::BORDER_ISOLATED, cv::Scalar(0));
  cv::distanceTransform(framed != 0, depth, cv::DIST_L2, cv::DIST_MASK_5);
  return depth({1, 1, box.width, box.height});
}

// [box] float32
cv::Mat Texture(const cv::Mat& picture, const cv::Rect& box) {
  const cv::Rect around =
      (box - cv::Point(kMargin, kMargin) + cv::Size(2 * kMargin, 2 * kMargin)) & cv::Rect({0, 0}, picture.size());
  cv::Mat texture;
  cv::cornerMinEigenVal(picture(around), texture, kTextureBlock);
  return texture({box.x - around.x, box.y - around.y, box.width, box.height});
}

// The pixel with the most texture of each square that the object has a part in.
std::vector<Candidate> Candidates(const cv::Mat& picture, const cv::Mat& mask, int count) {
  std::vector<cv::Point> covered;
  cv::findNonZero(mask, covered);
  if (covered.empty()) return {};
  const cv::Rect box = cv::boundingRect(covered);
  const cv::Mat depth = Depth(mask, box), texture = Texture(picture, box);
  const double wanted = static_cast<double>(kCandidatesAPoint) * std::max(count, 1);
  const int side = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(covered.size()) / wanted)));
  const int columns = (box.width + side - 1) / side;
  std::vector<Candidate> best(static_cast<size_t>(columns) * ((box.height + side - 1) / side));
  for (const cv::Point& pixel : covered) {
    const cv::Point at = pixel - box.tl();
    Candidate& candidate = best[static_cast<size_t>(at.y / side) * columns + at.x / side];
    const float found = texture.at<float>(at);
    if (candidate.room > 0 && found <= candidate.texture) continue;
    candidate = {pixel, found, 2 * depth.at<float>(at)};
  }
  best.erase(std::remove_if(best.begin(), best.end(), [](const Candidate& c) { return c.room <= 0; }), best.end());
  return best;
}

// The texture that counts in full: what half of the places have.
float Median(const std::vector<Candidate>& candidates) {
  std::vector<float> textures;
  textures.reserve(candidates.size());
  for (const Candidate& candidate : candidates) textures.push_back(candidate.texture);
  const auto middle = textures.begin() + static_cast<std::ptrdiff_t>(textures.size() / 2);
  std::nth_element(textures.begin(), middle, textures.end());
  return *middle;
}

void TakeRoom(FlowPoint point, std::vector<Candidate>& candidates) {
  for (Candidate& candidate : candidates) {
    const float x = static_cast<float>(candidate.at.x) - point.x, y = static_cast<float>(candidate.at.y) - point.y;
    candidate.room = std::min(candidate.room, std::hypot(x, y));
  }
}

}  // namespace

std::vector<FlowPoint> PlacePoints(const GrayImage& picture, const GrayImage& mask, int count,
                                   absl::Span<const FlowPoint> kept) {
  std::vector<Candidate> candidates = Candidates(PictureView(picture), PictureView(mask), count);
  if (candidates.empty()) return {};
  const float full = Median(candidates);
  for (const FlowPoint& point : kept) TakeRoom(point, candidates);
  const auto worth = [full](const Candidate& c) {
    const float texture = full > 0 ? std::min(c.texture / full, 1.0f) : 0;
    return c.room * (kPlain + (1 - kPlain) * texture);
  };
  std::vector<FlowPoint> places;
  while (static_cast<int>(places.size()) < count) {
    const auto best = std::max_element(candidates.begin(), candidates.end(),
                                       [&worth](const auto& a, const auto& b) { return worth(a) < worth(b); });
    if (best->room < 1) break;  // every pixel is taken
    places.push_back({static_cast<float>(best->at.x), static_cast<float>(best->at.y)});
    TakeRoom(places.back(), candidates);
  }
  return places;
}

}  // namespace holdfast
