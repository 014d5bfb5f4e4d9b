// SPDX-License-Identifier: Apache-2.0
#include "server/engine/motion/alignment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>

namespace holdfast {
namespace {

// Chosen on annotated real video.
constexpr int kReach = 12;                // of the window, pixels of half a picture each way
constexpr float kWeightReach = 7.2f;      // standard deviation of the weights, which are largest at the point
constexpr int kMostSteps = 15;            // of the search
constexpr double kLastStep = 0.01;        // pixels that the window's corner moves in the last step
constexpr float kLeastContrast = 3;       // standard deviation of grey levels
constexpr double kRigidity = 0.03;        // what deforming costs, in units of the squares that are minimised
constexpr double kLeastCurvature = 1e-5;  // keeps equations solvable where nothing shows motion one way

constexpr int kAlignedSide = 2 * kReach + 1;
constexpr size_t kAlignedPixels = size_t{kAlignedSide} * kAlignedSide;
constexpr size_t kLanes = 8;
using Surroundings = std::array<float, (kAlignedPixels + kLanes - 1) / kLanes * kLanes>;  // row by row, then zeros

constexpr int kParameters = 6;  // x, y, and what xx, xy, yx, yy add at the window's edge
using Parameters = cv::Vec<double, kParameters>;
using Equations = cv::Matx<double, kParameters, kParameters>;

// The sum of products, in an order that does not hinder vector instructions.
float Dot(const Surroundings& a, const Surroundings& b) {
  std::array<float, kLanes> sums{};
  for (size_t i = 0; i < a.size(); i += kLanes) {
    for (size_t lane = 0; lane < kLanes; ++lane) sums[lane] += a[i + lane] * b[i + lane];
  }
  float sum = 0;
  for (const float lane : sums) sum += lane;
  return sum;
}

// Of the window's pixels; they sum to 1.
const Surroundings& Weights() {
  static const Surroundings weights = [] {
    Surroundings result{};
    double sum = 0;
    for (int y = -kReach, i = 0; y <= kReach; ++y) {
      for (int x = -kReach; x <= kReach; ++x, ++i) {
        result[i] = std::exp(static_cast<float>(-(x * x + y * y)) / (2 * kWeightReach * kWeightReach));
        sum += result[i];
      }
    }
    for (float& weight : result) weight = static_cast<float>(weight / sum);
    return result;
  }();
  return weights;
}

Surroundings Weighted(const Surroundings& window) {
  const Surroundings& weights = Weights();
  Surroundings result;
  for (size_t i = 0; i < window.size(); ++i) result[i] = window[i] * weights[i];
  return result;
}

// window += factor * other
void Add(Surroundings& window, float factor, const Surroundings& other) {
  for (size_t i = 0; i < window.size(); ++i) window[i] += factor * other[i];
}

// Makes the weighted mean 0.
void Centre(Surroundings& window) {
  const float mean = Dot(Weights(), window);
  for (size_t i = 0; i < kAlignedPixels; ++i) window[i] -= mean;
}

// Makes the weighted mean 0 and the weighted variance 1; what the standard deviation was.
float Normalize(Surroundings& window) {
  Centre(window);
  const float deviation = std::sqrt(Dot(Weighted(window), window)), scale = 1 / (deviation + 1e-3f);
  for (float& value : window) value *= scale;
  return deviation;
}

// Between pixels; beyond the edge as at it. REQUIRES: the place is finite, the picture has two pixels each way.
float Sample(const GrayView& picture, float x, float y) {
  x = std::clamp(x, 0.0f, static_cast<float>(picture.size.width - 1));
  y = std::clamp(y, 0.0f, static_cast<float>(picture.size.height - 1));
  const int left = std::min(static_cast<int>(x), picture.size.width - 2);
  const int top = std::min(static_cast<int>(y), picture.size.height - 2);
  const float right_part = x - static_cast<float>(left), lower_part = y - static_cast<float>(top);
  const uint8_t* const upper = picture.pixels + ptrdiff_t{top} * picture.stride + left;
  const uint8_t* const lower = upper + picture.stride;
  const float above = static_cast<float>(upper[0]) + right_part * static_cast<float>(upper[1] - upper[0]);
  const float below = static_cast<float>(lower[0]) + right_part * static_cast<float>(lower[1] - lower[0]);
  return above + lower_part * (below - above);
}

// What the picture shows around a place, as far as 'shape' says.
Surroundings Look(const GrayView& picture, FlowPoint at, const Deformation& shape) {
  Surroundings window{};
  for (int y = -kReach, i = 0; y <= kReach; ++y) {
    const float row_x = at.x + shape.xy * static_cast<float>(y), row_y = at.y + shape.yy * static_cast<float>(y);
    for (int x = -kReach; x <= kReach; ++x, ++i) {
      window[i] = Sample(picture, row_x + shape.xx * static_cast<float>(x), row_y + shape.yx * static_cast<float>(x));
    }
  }
  return window;
}

// The surroundings of a query, and what solving for their place in a picture takes.
struct Template {
  Surroundings values;                              // normalised
  std::array<Surroundings, kParameters> gradients;  // of 'values' for each parameter, weighted
  Equations inverse;                                // of the sums of their products
};

// What the patch shows, and how it changes along each parameter.
void Differentiate(const FlowPatch& patch, Template& query) {
  constexpr int kSamples = kAlignedSide + 2;  // a pixel more on all sides
  std::array<float, size_t{kSamples} * kSamples> samples;
  for (int y = 0, i = 0; y < kSamples; ++y) {
    for (int x = 0; x < kSamples; ++x, ++i) {
      samples[i] = Sample(patch.view(), patch.at.x + static_cast<float>(x - kReach - 1),
                          patch.at.y + static_cast<float>(y - kReach - 1));
    }
  }
  for (int y = -kReach, i = 0; y <= kReach; ++y) {
    for (int x = -kReach; x <= kReach; ++x, ++i) {
      const float* const sample = &samples[(y + kReach + 1) * kSamples + x + kReach + 1];
      const float along_x = (sample[1] - sample[-1]) / 2, along_y = (sample[kSamples] - sample[-kSamples]) / 2;
      const float across = static_cast<float>(x) / kReach, down = static_cast<float>(y) / kReach;
      query.values[i] = *sample;
      query.gradients[0][i] = along_x;
      query.gradients[1][i] = along_y;
      query.gradients[2][i] = along_x * across;
      query.gradients[3][i] = along_x * down;
      query.gradients[4][i] = along_y * across;
      query.gradients[5][i] = along_y * down;
    }
  }
}

// Of the weighted gradients with the unweighted ones, and what deforming costs.
Equations Products(const std::array<Surroundings, kParameters>& gradients) {
  Equations products;
  for (int row = 0; row < kParameters; ++row) {
    const Surroundings weighted = Weighted(gradients[row]);
    for (int column = 0; column <= row; ++column) {
      products(row, column) = products(column, row) = Dot(weighted, gradients[column]);
    }
    products(row, row) += row < 2 ? kLeastCurvature : kRigidity;
  }
  return products;
}

std::optional<Template> MakeTemplate(const FlowPatch& patch) {
  Template query{};
  Differentiate(patch, query);
  const float contrast = Normalize(query.values);
  if (contrast < kLeastContrast) return std::nullopt;
  const Surroundings weighted_values = Weighted(query.values);
  for (Surroundings& gradient : query.gradients) {
    for (float& value : gradient) value /= contrast;
    // What a change of brightness or contrast explains as well is no motion.
    Centre(gradient);
    Add(gradient, -Dot(weighted_values, gradient), query.values);
  }
  bool solvable = false;
  query.inverse = Products(query.gradients).inv(cv::DECOMP_CHOLESKY, &solvable);
  for (Surroundings& gradient : query.gradients) gradient = Weighted(gradient);
  return solvable ? std::optional(query) : std::nullopt;
}

// Takes 'step', of the query's window, off the way to the picture. False: the way is not plausible any more.
bool TakeOff(const Parameters& step, FlowPoint& at, Deformation& shape) {
  const double xx = 1 + step[2] / kReach, xy = step[3] / kReach, yx = step[4] / kReach, yy = 1 + step[5] / kReach;
  const double determinant = xx * yy - xy * yx;
  const auto divided = [determinant](double value) { return static_cast<float>(value / determinant); };
  shape = {divided(shape.xx * yy - shape.xy * yx), divided(shape.xy * xx - shape.xx * xy),
           divided(shape.yx * yy - shape.yy * yx), divided(shape.yy * xx - shape.yx * xy)};
  const auto dx = static_cast<float>(step[0]), dy = static_cast<float>(step[1]);
  at.x -= shape.xx * dx + shape.xy * dy;
  at.y -= shape.yx * dx + shape.yy * dy;
  return Plausible(shape) && std::isfinite(at.x) && std::isfinite(at.y);
}

double LengthOf(const Parameters& step) { return cv::norm(step, cv::NORM_L1); }

}  // namespace

std::optional<Alignment> AlignPatch(const FlowPatch& patch, const FlowPyramid& picture, FlowPoint start,
                                    const Deformation& deformation) {
  const GrayView half = picture.half();
  if (half.size.width < 2 || half.size.height < 2) return std::nullopt;
  if (!std::isfinite(start.x) || !std::isfinite(start.y) || !Plausible(deformation)) return std::nullopt;
  const std::optional<Template> query = MakeTemplate(patch);
  if (!query) return std::nullopt;
  FlowPoint at{start.x / 2, start.y / 2};
  Deformation shape = deformation;
  float correlation = 0;
  for (int i = 0; i < kMostSteps; ++i) {
    Surroundings difference = Look(half, at, shape);
    Normalize(difference);
    correlation = Dot(Weighted(difference), query->values);
    Add(difference, -1, query->values);
    Parameters sums;
    for (int k = 0; k < kParameters; ++k) sums[k] = Dot(query->gradients[k], difference);
    const Parameters step = query->inverse * sums;
    if (!TakeOff(step, at, shape)) return std::nullopt;
    if (LengthOf(step) < kLastStep) break;
  }
  return Alignment{{at.x * 2, at.y * 2}, shape, correlation};
}

}  // namespace holdfast
