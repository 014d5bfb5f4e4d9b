// SPDX-License-Identifier: Apache-2.0
#include "training/data/synthetic/renderer.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "training/data/synthetic/inverse_map.h"

namespace holdfast {
namespace {

// The part of the frame the layer can reach, from where its outline goes.
cv::Rect Reach(const Layer& layer, const PlaneMap& map, cv::Size frame) {
  const cv::Rect all({0, 0}, frame);
  if (layer.endless) return all;
  constexpr int kSteps = 8;
  constexpr double kFar = 1e6;  // pixels; keeps the conversion to int defined
  cv::Point2d low(kFar, kFar), high(-kFar, -kFar);
  const cv::Point2d centre = layer.Centre();
  for (int i = 0; i <= kSteps; ++i) {
    const double along = 2.0 * i / kSteps - 1;
    for (const cv::Point2d side : {cv::Point2d(along, -1), {along, 1}, {-1, along}, {1, along}}) {
      const cv::Point2d at = map.ImageFromPlane({side.x * centre.x, side.y * centre.y});
      low = {std::min(low.x, at.x), std::min(low.y, at.y)};
      high = {std::max(high.x, at.x), std::max(high.y, at.y)};
    }
  }
  const cv::Point from(static_cast<int>(std::max(low.x, -kFar)) - 3, static_cast<int>(std::max(low.y, -kFar)) - 3);
  const cv::Point to(static_cast<int>(std::min(high.x, kFar)) + 4, static_cast<int>(std::min(high.y, kFar)) + 4);
  return cv::Rect(from, to) & all;
}

// Draws 'layer' [h, w] RGBA, colours times alpha, over the area of the same size.
void Compose(const cv::Mat& layer, cv::Mat area) {
  for (int y = 0; y < layer.rows; ++y) {
    const uint8_t* from = layer.ptr<uint8_t>(y);
    uint8_t* to = area.ptr<uint8_t>(y);
    for (int x = 0; x < layer.cols; ++x, from += 4, to += 3) {
      if (from[3] == 0) continue;
      const int rest = 255 - from[3];
      for (int c = 0; c < 3; ++c) to[c] = static_cast<uint8_t>(std::min(255, from[c] + (to[c] * rest + 127) / 255));
    }
  }
}

void MarkIds(const cv::Mat& layer, int32_t id, cv::Mat area) {
  for (int y = 0; y < layer.rows; ++y) {
    const uint8_t* from = layer.ptr<uint8_t>(y);
    int32_t* to = area.ptr<int32_t>(y);
    for (int x = 0; x < layer.cols; ++x) {
      if (from[4 * x + 3] >= 128) to[x] = id;
    }
  }
}

// Darkens what lies under the layer's shifted and softened outline.
void CastShadow(const cv::Mat& layer, cv::Rect area, const Scene& scene, cv::Mat& shade, cv::Mat& frame) {
  cv::extractChannel(layer, shade, 3);
  cv::blur(shade, shade, {9, 9}, {-1, -1}, cv::BORDER_CONSTANT);
  const cv::Rect shadow = (area + scene.shadow_shift) & cv::Rect({0, 0}, frame.size());
  const cv::Point from = shadow.tl() - area.tl() - scene.shadow_shift;
  const int strength = static_cast<int>(256 * scene.shadow);
  for (int y = 0; y < shadow.height; ++y) {
    const uint8_t* dark = shade.ptr<uint8_t>(y + from.y) + from.x;
    uint8_t* to = frame.ptr<uint8_t>(y + shadow.y, shadow.x);
    for (int x = 0; x < shadow.width; ++x, to += 3) {
      const int keep = 65536 - strength * dark[x];
      for (int c = 0; c < 3; ++c) to[c] = static_cast<uint8_t>(to[c] * keep >> 16);
    }
  }
}

}  // namespace

void Renderer::DrawLayer(const Layer& layer, double time, cv::Mat& frame, cv::Mat* ids) {
  const PlaneMap map = scene_.MapAt(layer, time);
  const cv::Rect area = Reach(layer, map, scene_.size);
  if (area.empty()) return;
  InverseMaps(map, layer.Centre(), area, map_x_, map_y_);
  const cv::Rect used({0, 0}, area.size());
  if (layer.texture.channels() == 3) {
    cv::remap(layer.texture, frame, map_x_(used), map_y_(used), cv::INTER_LINEAR, cv::BORDER_REFLECT_101);
    if (ids != nullptr) ids->setTo(layer.id);
    return;
  }
  cv::remap(layer.texture, warped_, map_x_(used), map_y_(used), cv::INTER_LINEAR,
            layer.endless ? cv::BORDER_REFLECT_101 : cv::BORDER_CONSTANT);
  // What is endless is scenery, too far from what lies behind it for a shadow.
  if (scene_.shadow > 0 && !layer.endless) CastShadow(warped_, area, scene_, shade_, frame);
  Compose(warped_, frame(area));
  if (ids != nullptr) MarkIds(warped_, layer.id, (*ids)(area));
}

void Renderer::RenderMoment(double time, cv::Mat& frame, cv::Mat* ids) {
  frame.create(scene_.size, CV_8UC3);
  if (ids != nullptr) ids->create(scene_.size, CV_32SC1);
  for (const Layer& layer : scene_.layers) DrawLayer(layer, time, frame, ids);
}

void Renderer::Render(double time, cv::Mat& frame, cv::Mat& ids) {
  RenderMoment(time, frame, &ids);
  if (scene_.shutter <= 0) return;
  frame.convertTo(sum_, CV_16U);
  for (const double side : {-0.5, -0.25, 0.25, 0.5}) {
    RenderMoment(time + side * scene_.shutter, moment_, nullptr);
    cv::add(sum_, moment_, sum_, cv::noArray(), CV_16U);
  }
  sum_.convertTo(frame, CV_8U, 1 / 5.0);
}

}  // namespace holdfast
