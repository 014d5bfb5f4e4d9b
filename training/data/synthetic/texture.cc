// SPDX-License-Identifier: Apache-2.0
#include "training/data/synthetic/texture.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "training/data/synthetic/scene_mix.h"

namespace holdfast {
namespace {

using mix::kPi;

cv::Scalar RandomColour(Rng& rng) { return {rng.Uniform(0, 255), rng.Uniform(0, 255), rng.Uniform(0, 255)}; }

// Smooth noise: random values every 'cell' pixels, interpolated. [size] float32, [-1, 1]
cv::Mat NoiseOctave(cv::Size size, double cell, Rng& rng) {
  cv::Mat coarse(static_cast<int>(size.height / cell) + 2, static_cast<int>(size.width / cell) + 2, CV_32FC1);
  for (int i = 0; i < coarse.rows * coarse.cols; ++i) coarse.ptr<float>()[i] = static_cast<float>(rng.Uniform(-1, 1));
  cv::Mat fine;
  cv::resize(coarse, fine, size, 0, 0, cell > 3 ? cv::INTER_CUBIC : cv::INTER_LINEAR);
  return fine;
}

// Each of the following gives a field [size] float32, about [0, 1], for a palette.
cv::Mat NoiseField(cv::Size size, Rng& rng) {
  cv::Mat sum(size, CV_32FC1, cv::Scalar(0.5));
  double cell = std::max(size.width, size.height) * rng.Uniform(0.1, 0.5), amplitude = 0.45;
  const double persistence = rng.Uniform(0.45, 0.8);
  for (int octave = 0; octave < 5 && cell >= 2; ++octave, cell /= 2.5, amplitude *= persistence) {
    cv::scaleAdd(NoiseOctave(size, cell, rng), amplitude, sum, sum);
  }
  return sum;
}

cv::Mat StripesField(cv::Size size, Rng& rng) {
  const double length = std::exp(rng.Uniform(std::log(6.0), std::log(60.0))), angle = rng.Uniform(0, kPi);
  const float kx = static_cast<float>(2 * kPi / length * std::cos(angle));
  const float ky = static_cast<float>(2 * kPi / length * std::sin(angle));
  const bool checks = rng.Chance(0.4);
  const double depth = rng.Uniform(0, 4);
  cv::Mat bend = NoiseOctave(size, rng.Uniform(30, 90), rng) * depth;
  for (int y = 0; y < size.height; ++y) {
    float* row = bend.ptr<float>(y);
    for (int x = 0; x < size.width; ++x) {
      const float along = std::sin(kx * x + ky * y + row[x]);
      row[x] = 0.5f + 0.5f * along * (checks ? std::sin(kx * y - ky * x) : 1.f);
    }
  }
  return bend;
}

cv::Mat CellsField(cv::Size size, Rng& rng) {
  cv::Mat seeds(size, CV_8UC1, cv::Scalar(255)), distance, labels;
  const double pitch = rng.Uniform(12, 50);
  const int count = std::max(4, static_cast<int>(size.area() / (pitch * pitch)));
  for (int i = 0; i < count; ++i) {
    const int x = static_cast<int>(rng.Below(size.width)), y = static_cast<int>(rng.Below(size.height));
    seeds.at<uint8_t>(y, x) = 0;
  }
  cv::distanceTransform(seeds, distance, labels, cv::DIST_L2, cv::DIST_MASK_5, cv::DIST_LABEL_PIXEL);
  std::vector<float> values(static_cast<size_t>(count) + 1);
  for (float& value : values) value = static_cast<float>(rng.Uniform());
  const float rim = static_cast<float>(rng.Uniform(0, 0.8) / pitch);
  for (int i = 0; i < size.area(); ++i) {
    float& cell = distance.ptr<float>()[i];
    cell = values[static_cast<size_t>(labels.ptr<int32_t>()[i])] + rim * cell;
  }
  return distance;
}

cv::Mat GradientField(cv::Size size, Rng& rng) {
  cv::Mat field(size, CV_32FC1);
  const bool radial = rng.Chance(0.5);
  const double angle = rng.Uniform(0, 2 * kPi), reach = size.width + size.height;
  const double cx = rng.Uniform(0, size.width), cy = rng.Uniform(0, size.height);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const double along = (x - cx) * std::cos(angle) + (y - cy) * std::sin(angle);
      field.at<float>(y, x) = static_cast<float>(radial ? 2 * std::hypot(x - cx, y - cy) / reach : 0.5 + along / reach);
    }
  }
  return field;
}

// [1, 256] CV_8UC3: a walk through a few random colours.
cv::Mat RandomPalette(Rng& rng) {
  const int stops = static_cast<int>(rng.Integer(2, 5));
  std::vector<cv::Scalar> colours;
  colours.reserve(static_cast<size_t>(stops));
  for (int i = 0; i < stops; ++i) colours.push_back(RandomColour(rng));
  cv::Mat palette(1, 256, CV_8UC3);
  for (int i = 0; i < 256; ++i) {
    const double place = i / 255.0 * (stops - 1);
    const int at = std::min(static_cast<int>(place), stops - 2);
    const cv::Scalar mix = colours[at] * (at + 1 - place) + colours[at + 1] * (place - at);
    palette.at<cv::Vec3b>(0, i) = cv::Vec3b(cv::saturate_cast<uint8_t>(mix[0]), cv::saturate_cast<uint8_t>(mix[1]),
                                            cv::saturate_cast<uint8_t>(mix[2]));
  }
  return palette;
}

cv::Mat Colour(const cv::Mat& field, Rng& rng) {
  cv::Mat index, colour;
  field.convertTo(index, CV_8U, 255);
  cv::cvtColor(index, colour, cv::COLOR_GRAY2RGB);
  cv::LUT(colour, RandomPalette(rng), colour);
  return colour;
}

void ScatterShape(cv::Mat& picture, Rng& rng) {
  const int y = static_cast<int>(rng.Below(picture.rows)), x = static_cast<int>(rng.Below(picture.cols));
  const int reach = std::max(3, static_cast<int>(rng.Uniform(0.02, 0.12) * std::max(picture.cols, picture.rows)));
  const int down = static_cast<int>(rng.Integer(-reach, reach)), right = static_cast<int>(rng.Integer(-reach, reach));
  const cv::Point at(x, y), to(x + right, y + down);
  const cv::Scalar colour = RandomColour(rng);
  switch (rng.Below(4)) {
    case 0:
      return cv::circle(picture, at, reach / 2 + 1, colour, rng.Chance(0.6) ? cv::FILLED : 2, cv::LINE_AA);
    case 1:
      return cv::rectangle(picture, at, to, colour, rng.Chance(0.6) ? cv::FILLED : 2, cv::LINE_AA);
    case 2:
      return cv::line(picture, at, to, colour, static_cast<int>(rng.Integer(1, 4)), cv::LINE_AA);
    default: {
      const char letter[2] = {static_cast<char>(rng.Integer('!', '~')), 0};
      cv::putText(picture, letter, at, cv::FONT_HERSHEY_SIMPLEX, reach / 20.0, colour, 2, cv::LINE_AA);
    }
  }
}

// Fine grain: surfaces without any are rare, and nothing can be tracked on them.
void AddGrain(cv::Mat& picture, Rng& rng) {
  cv::Mat grain = NoiseOctave(picture.size(), rng.Uniform(2, 5), rng), grain8, grain24;
  grain.convertTo(grain8, CV_8U, 64, 128);
  cv::cvtColor(grain8, grain24, cv::COLOR_GRAY2RGB);
  const double weight = rng.Uniform(0, 0.5);
  cv::addWeighted(picture, 1, grain24, weight, -128 * weight, picture);
}

// Radius of an outline over the angle, relative to 1.
struct Outline {
  explicit Outline(Rng& rng) : polygon(rng.Chance(0.3)), corners(static_cast<int>(rng.Integer(3, 8))) {
    for (int i = 0; i < 4; ++i) {
      weight[i] = rng.Uniform(0, 0.3) / (i + 1);
      phase[i] = rng.Uniform(0, 2 * kPi);
    }
  }
  double Radius(double angle) const {
    double radius = 1;
    for (int i = 0; i < 4; ++i) radius += weight[i] * std::sin((i + 1) * angle + phase[i]);
    return radius;
  }
  int Vertices() const { return polygon ? corners : 64; }

  bool polygon;
  int corners;
  double weight[4], phase[4];
};

std::vector<cv::Point> OutlinePoints(cv::Size size, int shift_bits, Rng& rng) {
  const Outline outline(rng);
  double largest = 0;
  for (int i = 0; i < outline.Vertices(); ++i)
    largest = std::max(largest, outline.Radius(2 * kPi * i / outline.Vertices()));
  std::vector<cv::Point> points;
  const double unit = 1 << shift_bits;
  for (int i = 0; i < outline.Vertices(); ++i) {
    const double angle = 2 * kPi * i / outline.Vertices(), radius = outline.Radius(angle) / largest;
    points.emplace_back(
        static_cast<int>(unit * (size.width / 2.0 + (size.width / 2.0 - 3) * radius * std::cos(angle))),
        static_cast<int>(unit * (size.height / 2.0 + (size.height / 2.0 - 3) * radius * std::sin(angle))));
  }
  return points;
}

// Contrast lowered about the mean colour.
cv::Mat Faint(const cv::Mat& picture, double contrast) {
  cv::Mat out;
  const cv::Scalar mean = cv::mean(picture);
  cv::addWeighted(picture, contrast, cv::Mat(picture.size(), CV_8UC3, mean), 1 - contrast, 0, out);
  return out;
}

// Without details smaller than about 'cell' pixels.
cv::Mat Blurred(const cv::Mat& picture, int cell) {
  cv::Mat coarse, out;
  const cv::Size size(picture.cols / cell + 2, picture.rows / cell + 2);
  cv::resize(picture, coarse, size, 0, 0, cv::INTER_AREA);
  cv::resize(coarse, out, picture.size(), 0, 0, cv::INTER_CUBIC);
  return out;
}

// One tile of 'picture' over and over, mirrored or not.
cv::Mat Repeated(const cv::Mat& picture, cv::Size tile, Rng& rng) {
  tile = {std::min(tile.width, picture.cols), std::min(tile.height, picture.rows)};
  const int y = static_cast<int>(rng.Below(picture.rows - tile.height + 1));
  const int x = static_cast<int>(rng.Below(picture.cols - tile.width + 1));
  const int border = rng.Chance(0.5) ? cv::BORDER_REFLECT : cv::BORDER_WRAP;
  cv::Mat out;
  cv::copyMakeBorder(picture(cv::Rect({x, y}, tile)).clone(), out, 0, picture.rows - tile.height, 0,
                     picture.cols - tile.width, border);
  return out;
}

}  // namespace

cv::Mat ProceduralTexture(cv::Size size, Rng& rng) {
  cv::Mat picture;
  switch (rng.Below(5)) {
    case 0:
    case 1:
      picture = Colour(NoiseField(size, rng), rng);
      break;
    case 2:
      picture = Colour(StripesField(size, rng), rng);
      break;
    case 3:
      picture = Colour(CellsField(size, rng), rng);
      break;
    default:
      picture = Colour(GradientField(size, rng), rng);
  }
  const int shapes = rng.Chance(0.5) ? static_cast<int>(rng.Integer(10, 60)) : 0;
  for (int i = 0; i < shapes; ++i) ScatterShape(picture, rng);
  AddGrain(picture, rng);
  return picture;
}

cv::Mat CutOutMask(cv::Size size, Rng& rng) {
  constexpr int kShiftBits = 4;
  cv::Mat mask(size, CV_8UC1, cv::Scalar(0));
  const std::vector<cv::Point> outline = OutlinePoints(size, kShiftBits, rng);
  cv::fillPoly(mask, std::vector<std::vector<cv::Point>>{outline}, cv::Scalar(255), cv::LINE_AA, kShiftBits);
  if (rng.Chance(0.15)) {  // a hole, so that what lies behind an object shows inside its outline
    const cv::Point centre(size.width / 2, size.height / 2);
    const int radius = static_cast<int>(rng.Uniform(0.1, 0.25) * std::min(size.width, size.height));
    cv::circle(mask, centre, radius, cv::Scalar(0), cv::FILLED, cv::LINE_AA);
  }
  return mask;
}

cv::Mat CoverMask(cv::Size size, double cover, Rng& rng) {
  cv::Mat field = NoiseOctave(size, rng.Uniform(0.08, 0.4) * size.width, rng);
  const double detail = rng.Uniform(0, 0.5);
  cv::scaleAdd(NoiseOctave(size, rng.Uniform(8, 30), rng), detail, field, field);
  const float slope = static_cast<float>(rng.Chance(0.5) ? rng.Uniform(1, 4) / size.height : 0);  // hills: more below
  for (int y = 0; y < size.height; ++y) field.row(y) += cv::Scalar(slope * static_cast<float>(y));
  cv::Mat sorted = field.clone().reshape(1, 1);
  const int above = static_cast<int>((1 - cover) * (sorted.cols - 1));
  std::nth_element(sorted.ptr<float>(), sorted.ptr<float>() + above, sorted.ptr<float>() + sorted.cols);
  cv::Mat mask = field > sorted.at<float>(0, above);
  cv::medianBlur(mask, mask, 5);  // no specks
  cv::blur(mask, mask, {3, 3});
  return mask;
}

cv::Mat LimbMask(cv::Size size) {
  constexpr int kMargin = 2;
  cv::Mat mask(size, CV_8UC1, cv::Scalar(0));
  const int radius = std::max(1, size.height / 2 - kMargin), y = size.height / 2;
  cv::line(mask, {size.height / 2, y}, {size.width - 1 - size.height / 2, y}, cv::Scalar(255), 2 * radius - 1);
  cv::circle(mask, {size.height / 2, y}, radius - 1, cv::Scalar(255), cv::FILLED);
  cv::circle(mask, {size.width - 1 - size.height / 2, y}, radius - 1, cv::Scalar(255), cv::FILLED);
  cv::blur(mask, mask, {3, 3});
  return mask;
}

cv::Mat Plain(const cv::Mat& picture, Rng& rng) {
  switch (rng.Below(4)) {
    case 0:
      return Faint(picture, rng.Uniform(0.05, 0.3));
    case 1:
      return Blurred(picture, static_cast<int>(rng.Integer(8, 40)));
    default: {
      const int side = static_cast<int>(rng.Integer(10, 50));
      return Repeated(picture, {side, static_cast<int>(side * rng.Uniform(0.7, 1.4))}, rng);
    }
  }
}

}  // namespace holdfast
