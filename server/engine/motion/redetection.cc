// SPDX-License-Identifier: Apache-2.0
#include "server/engine/motion/redetection.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "server/engine/motion/alignment.h"

namespace holdfast {
namespace {

// Chosen on annotated real video and synthetic clips; lengths in pixels of a frame 512 wide.
constexpr float kMostWay = 150;                  // from where the point is thought to be
constexpr float kFoundAlike = 0.88f;             // correlation of what is found again
constexpr float kLead = 0.05f;                   // of that before any other place
constexpr float kSamePlace = 8;                  // closer places are one
constexpr size_t kPlaces = 6;                    // that are looked at closely
constexpr int kTurns[] = {-30, -15, 0, 15, 30};  // degrees
constexpr float kScales[] = {0.8f, 1, 1.25f};

// A coarse search comes first, on pictures of a quarter of the size, where it compares a disc.
constexpr float kQuarter = 4;
constexpr float kDiscRadius = 5.5f;
constexpr int kDiscReach = 5;
constexpr int kDiscSide = 2 * kDiscReach + 1;
constexpr int kPlacesApart = 3;
constexpr float kLeastDeviation = 2;  // of the disc's grey levels

// 1 within the disc, 0 around it.
const cv::Mat1f& Disc() {
  static const cv::Mat1f disc = [] {
    cv::Mat1f mask(kDiscSide, kDiscSide, 0.0f);
    for (int y = -kDiscReach; y <= kDiscReach; ++y) {
      for (int x = -kDiscReach; x <= kDiscReach; ++x) {
        if (std::hypot(x, y) <= kDiscRadius) mask(y + kDiscReach, x + kDiscReach) = 1;
      }
    }
    return mask;
  }();
  return disc;
}

float DiscPixels() { return static_cast<float>(cv::countNonZero(Disc())); }

// The sum of the products around each pixel.
cv::Mat1f Filtered(const cv::Mat1f& picture, const cv::Mat1f& kernel) {
  cv::Mat1f sums;
  cv::filter2D(picture, sums, CV_32F, kernel, {-1, -1}, 0, cv::BORDER_REPLICATE);
  return sums;
}

struct Shape {
  Deformation deformation;
  cv::Mat1f disc;  // [kDiscSide, kDiscSide], mean 0 and length 1: what a quarter of the picture would show
};

// Of a patch that is smoothed as halving a picture does; empty where it shows next to nothing.
cv::Mat1f DiscOf(const cv::Mat1f& smooth, FlowPoint at, float degrees, float scale) {
  const cv::Point2f middle(kDiscReach, kDiscReach), here(at.x, at.y);
  // From the disc to the patch: turned and scaled back, then from a quarter of the picture to half of it.
  cv::Mat1d map = cv::getRotationMatrix2D(middle, degrees, 2 / scale);
  map(0, 2) += here.x - middle.x;
  map(1, 2) += here.y - middle.y;
  cv::Mat1f disc;
  cv::warpAffine(smooth, disc, map, {kDiscSide, kDiscSide}, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                 cv::BORDER_REPLICATE);
  disc -= disc.dot(Disc()) / DiscPixels();
  disc = disc.mul(Disc());
  const double length = cv::norm(disc);
  return length < kLeastDeviation * std::sqrt(DiscPixels()) ? cv::Mat1f() : cv::Mat1f(disc / length);
}

std::vector<Shape> ShapesOf(const FlowPatch& patch) {
  const GrayView view = patch.view();
  cv::Mat1f smooth;
  cv::Mat(view.size.height, view.size.width, CV_8UC1, const_cast<uint8_t*>(view.pixels)).convertTo(smooth, CV_32F);
  cv::GaussianBlur(smooth, smooth, {5, 5}, 1, 1, cv::BORDER_REPLICATE);
  std::vector<Shape> shapes;
  for (const int degrees : kTurns) {
    for (const float scale : kScales) {
      const float angle = static_cast<float>(degrees) * static_cast<float>(CV_PI) / 180;
      const float along = scale * std::cos(angle), across = scale * std::sin(angle);
      Shape shape{{along, -across, across, along}, DiscOf(smooth, patch.at, static_cast<float>(degrees), scale)};
      if (!shape.disc.empty()) shapes.push_back(std::move(shape));
    }
  }
  return shapes;
}

struct Candidate {
  FlowPoint at;
  Deformation deformation;
};

float DistanceOf(FlowPoint a, FlowPoint b) { return std::hypot(a.x - b.x, a.y - b.y); }

// Looks for points in one picture. What all of them need of it is made once.
class Redetector {
 public:
  explicit Redetector(const FlowPyramid& picture);
  std::optional<FlowPoint> Find(const FlowPatch& patch, FlowPoint expected) const;

 private:
  std::vector<Candidate> Places(const FlowPatch& patch) const;
  float Pixels(float of_512) const { return FlowPixels(of_512, picture_.size()); }

  const FlowPyramid& picture_;
  cv::Mat1f quarter_;  // empty: the picture is tiny
  cv::Mat1f scale_;    // of each pixel: makes the length of the disc around it 1; 0 where that shows next to nothing
};

Redetector::Redetector(const FlowPyramid& picture) : picture_(picture) {
  const GrayView half = picture.half();
  if (std::min(half.size.width, half.size.height) < 2 * kDiscSide) return;
  cv::Mat quarter;
  cv::pyrDown(cv::Mat(half.size.height, half.size.width, CV_8UC1, const_cast<uint8_t*>(half.pixels),
                      static_cast<size_t>(half.stride)),
              quarter);
  quarter.convertTo(quarter_, CV_32F);
  const cv::Mat1f sums = Filtered(quarter_, Disc());
  const cv::Mat1f squares = Filtered(quarter_.mul(quarter_), Disc()) - sums.mul(sums) / DiscPixels();
  scale_.create(squares.size());
  std::transform(squares.begin(), squares.end(), scale_.begin(), [](float square) {
    return square < kLeastDeviation * kLeastDeviation * DiscPixels() ? 0 : 1 / std::sqrt(square);
  });
}

std::vector<Candidate> Redetector::Places(const FlowPatch& patch) const {
  const std::vector<Shape> shapes = ShapesOf(patch);
  cv::Mat1f best(quarter_.size(), 0.0f);
  cv::Mat1b which(quarter_.size(), uint8_t{0});
  for (size_t i = 0; i < shapes.size(); ++i) {
    const cv::Mat1f alike = Filtered(quarter_, shapes[i].disc).mul(scale_);
    const cv::Mat better = alike > best;
    alike.copyTo(best, better);
    which.setTo(static_cast<double>(i), better);
  }
  std::vector<Candidate> places;
  while (places.size() < kPlaces) {
    double most = 0;
    cv::Point at;
    cv::minMaxLoc(best, nullptr, &most, nullptr, &at);
    if (most <= 0) break;
    const FlowPoint place{kQuarter * static_cast<float>(at.x), kQuarter * static_cast<float>(at.y)};
    places.push_back({place, shapes[which(at)].deformation});
    cv::circle(best, at, kPlacesApart, 0, cv::FILLED);
  }
  return places;
}

std::optional<FlowPoint> Redetector::Find(const FlowPatch& patch, FlowPoint expected) const {
  if (quarter_.empty() || !std::isfinite(expected.x) || !std::isfinite(expected.y)) return std::nullopt;
  std::vector<Candidate> places = Places(patch);
  places.push_back({expected, {}});
  std::vector<Alignment> found;
  for (const Candidate& place : places) {
    if (auto alignment = AlignPatch(patch, picture_, place.at, place.deformation)) found.push_back(*alignment);
  }
  const auto best = std::max_element(
      found.begin(), found.end(), [](const Alignment& a, const Alignment& b) { return a.correlation < b.correlation; });
  if (best == found.end() || best->correlation < kFoundAlike) return std::nullopt;
  if (DistanceOf(best->at, expected) > Pixels(kMostWay)) return std::nullopt;
  const bool ambiguous = std::any_of(found.begin(), found.end(), [&](const Alignment& other) {
    return other.correlation > best->correlation - kLead && DistanceOf(other.at, best->at) > Pixels(kSamePlace);
  });
  return ambiguous ? std::nullopt : std::optional(best->at);
}

// From the last picture, which all chains end on, to the second one of each, as far as flow leads. Together, as
// pictures cost more than points.
void CarryBack(std::vector<LostChain*> chains, float max_round_trip) {
  for (size_t back = 1; true; ++back) {  // pictures before the last one
    const auto is_there = [&](const LostChain* chain) { return chain->points.size() < back + 2; };
    chains.erase(std::remove_if(chains.begin(), chains.end(), is_there), chains.end());
    if (chains.empty()) return;
    std::vector<FlowPoint> points;
    for (const LostChain* chain : chains) points.push_back(*(chain->points.end() - back));
    const auto pictures = chains[0]->pictures.end();
    const std::vector<FlowStep> steps =
        CarryPoints(**(pictures - back), **(pictures - back - 1), points, max_round_trip);
    std::vector<LostChain*> held;
    for (size_t i = 0; i < chains.size(); ++i) {
      if (!steps[i].held) continue;
      *(chains[i]->points.end() - back - 1) = steps[i].at;
      held.push_back(chains[i]);
    }
    chains = std::move(held);
  }
}

}  // namespace

void FindAgain(absl::Span<LostChain> chains, float max_round_trip) {
  if (chains.empty()) return;
  const Redetector redetector(*chains[0].pictures.back());
  std::vector<LostChain*> found;
  for (LostChain& chain : chains) {
    const std::optional<FlowPoint> place = redetector.Find(*chain.patch, chain.points.back());
    if (!place) continue;
    chain.points.back() = *place;
    chain.found = true;
    found.push_back(&chain);
  }
  CarryBack(std::move(found), max_round_trip);
}

}  // namespace holdfast
