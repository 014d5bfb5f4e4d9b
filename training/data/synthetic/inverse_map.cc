// SPDX-License-Identifier: Apache-2.0
#include "training/data/synthetic/inverse_map.h"

#include <algorithm>
#include <array>
#include <vector>

namespace holdfast {
namespace {

constexpr int kTaps = 4;

// Cubic Lagrange interpolation between nodes -1, 0, 1, 2 at the kCell places of [0, 1).
template <int kCell>
using Weights = std::array<std::array<float, kCell>, kTaps>;

template <int kCell>
Weights<kCell> CubicWeights() {
  Weights<kCell> weights;
  for (size_t p = 0; p < kCell; ++p) {
    const float u = static_cast<float>(p) / kCell;
    weights[0][p] = -u * (u - 1) * (u - 2) / 6;
    weights[1][p] = (u + 1) * (u - 1) * (u - 2) / 2;
    weights[2][p] = -(u + 1) * u * (u - 2) / 2;
    weights[3][p] = (u + 1) * u * (u - 1) / 6;
  }
  return weights;
}

// nodes: [rows / kCell + kTaps - 1, columns / kCell + kTaps - 1] -> map: [rows, columns], both multiples of kCell.
template <int kCell>
void Refine(const cv::Mat& nodes, cv::Mat& map) {
  static const Weights<kCell> weights = CubicWeights<kCell>();
  std::vector<float> line(static_cast<size_t>(nodes.cols));
  for (int y = 0; y < map.rows; ++y) {
    const size_t phase = static_cast<size_t>(y % kCell);
    for (int i = 0; i < nodes.cols; ++i) {
      float sum = 0;
      for (int k = 0; k < kTaps; ++k) sum += weights[static_cast<size_t>(k)][phase] * nodes.at<float>(y / kCell + k, i);
      line[static_cast<size_t>(i)] = sum;
    }
    float* out = map.ptr<float>(y);
    for (int i = 0; i + kTaps <= nodes.cols; ++i, out += kCell) {
      const float* from = line.data() + i;
      for (size_t p = 0; p < kCell; ++p) {
        out[p] = weights[0][p] * from[0] + weights[1][p] * from[1] + weights[2][p] * from[2] + weights[3][p] * from[3];
      }
    }
  }
}

int RoundUp(int length, int cell) { return (length + cell - 1) / cell * cell; }

// The map is solved every kCell pixels.
template <int kCell>
void SolveAndRefine(const PlaneMap& map, cv::Point2d centre, cv::Rect area, cv::Mat& map_x, cv::Mat& map_y) {
  const int width = RoundUp(area.width, kCell), height = RoundUp(area.height, kCell);
  cv::Mat nodes_x(height / kCell + kTaps - 1, width / kCell + kTaps - 1, CV_32FC1), nodes_y(nodes_x.size(), CV_32FC1);
  for (int j = 0; j < nodes_x.rows; ++j) {
    for (int i = 0; i < nodes_x.cols; ++i) {
      const cv::Point2d image(area.x + kCell * (i - 1), area.y + kCell * (j - 1));
      const cv::Point2d texture = map.PlaneFromImage(image) + centre;
      nodes_x.at<float>(j, i) = static_cast<float>(texture.x);
      nodes_y.at<float>(j, i) = static_cast<float>(texture.y);
    }
  }
  map_x.create(height, width, CV_32FC1);
  map_y.create(height, width, CV_32FC1);
  Refine<kCell>(nodes_x, map_x);
  Refine<kCell>(nodes_y, map_y);
}

// The largest of 8, 4, 2 and 1 pixels between solved places that keeps the error of the interpolation small.
int CellOf(const PlaneMap& map, cv::Rect area) {
  constexpr double kWorst = 0.04;       // pixels of the image
  constexpr double kCubic = 3 / 128.0;  // the error at worst, of the fourth derivative and a distance of 1
  double bend = 0;
  for (const cv::Point& corner :
       {area.tl(), area.br(), cv::Point(area.x, area.br().y), cv::Point(area.br().x, area.y)}) {
    bend = std::max(bend, map.InverseBend(corner));
  }
  int cell = 8;
  while (cell > 1 && kCubic * bend * cell * cell * cell * cell > kWorst) cell /= 2;
  return cell;
}

}  // namespace

void InverseMaps(const PlaneMap& map, cv::Point2d centre, cv::Rect area, cv::Mat& map_x, cv::Mat& map_y) {
  switch (CellOf(map, area)) {
    case 8:
      return SolveAndRefine<8>(map, centre, area, map_x, map_y);
    case 4:
      return SolveAndRefine<4>(map, centre, area, map_x, map_y);
    case 2:
      return SolveAndRefine<2>(map, centre, area, map_x, map_y);
    default:
      return SolveAndRefine<1>(map, centre, area, map_x, map_y);
  }
}

}  // namespace holdfast
