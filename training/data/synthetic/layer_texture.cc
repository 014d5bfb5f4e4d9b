// SPDX-License-Identifier: Apache-2.0
#include "training/data/synthetic/layer_texture.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "training/data/synthetic/scene_mix.h"
#include "training/data/synthetic/texture.h"

namespace holdfast {
namespace {

constexpr int kRim = 3;  // transparent pixels around an object, so that its edge is interpolated, not cut

cv::Mat Rgb(const cv::Mat& rgba) {
  cv::Mat rgb;
  cv::cvtColor(rgba, rgb, cv::COLOR_RGBA2RGB);
  return rgb;
}

cv::Mat Resized(const cv::Mat& picture, cv::Size size) {
  cv::Mat out;
  cv::resize(picture, out, size, 0, 0, size.area() < picture.size().area() ? cv::INTER_AREA : cv::INTER_LINEAR);
  return out;
}

// A random part of 'picture' with the shape of 'size', at most 'zoom' times as large as it, as large as fits.
cv::Mat RandomPart(const cv::Mat& picture, cv::Size size, double zoom, Rng& rng) {
  const double fit =
      std::min(picture.cols / static_cast<double>(size.width), picture.rows / static_cast<double>(size.height));
  const double scale = std::min(fit, rng.Uniform(0.7, zoom));
  const int width = std::max(1, static_cast<int>(size.width * scale));
  const int height = std::max(1, static_cast<int>(size.height * scale));
  const int y = static_cast<int>(rng.Below(picture.rows - height + 1));
  const int x = static_cast<int>(rng.Below(picture.cols - width + 1));
  return Resized(picture(cv::Rect(x, y, width, height)), size);
}

// Semi-transparent insides become solid, so that a point on them has one owner; edges stay soft.
void Harden(cv::Mat& alpha) { alpha.convertTo(alpha, CV_8U, 2, -128); }

cv::Mat Premultiplied(const cv::Mat& rgb, const cv::Mat& alpha) {
  cv::Mat alpha3, colour, rgba;
  cv::cvtColor(alpha, alpha3, cv::COLOR_GRAY2RGB);
  cv::multiply(rgb, alpha3, colour, 1 / 255.0);
  cv::Mat planes[] = {colour, alpha};
  cv::merge(planes, 2, rgba);
  return rgba;
}

cv::Mat AlphaObject(const cv::Mat& picture, int side, Rng& rng) {
  const double scale = static_cast<double>(side) / std::max(picture.cols, picture.rows);
  const cv::Size size(std::max(8, static_cast<int>(picture.cols * scale)),
                      std::max(8, static_cast<int>(picture.rows * scale)));
  cv::Mat small = Resized(picture, size), alpha, object;
  if (rng.Chance(0.5)) cv::flip(small, small, 1);
  cv::extractChannel(small, alpha, 3);
  Harden(alpha);
  cv::copyMakeBorder(Premultiplied(Rgb(small), alpha), object, kRim, kRim, kRim, kRim, cv::BORDER_CONSTANT);
  return object;
}

cv::Size CutOutSize(int side, Rng& rng) {
  const double aspect = std::exp(rng.Uniform(-0.7, 0.7));
  return {std::max(12, static_cast<int>(side * std::min(1.0, aspect))),
          std::max(12, static_cast<int>(side * std::min(1.0, 1 / aspect)))};
}

}  // namespace

// A part of 'picture' in the shape and size of 'mask'.
cv::Mat LayerTextures::CutOut(const cv::Mat& picture, const cv::Mat& mask) {
  cv::Mat part = RandomPart(picture, mask.size(), 2, rng_);
  if (plain_ && rng_.Chance(mix::kPlainObject)) part = Plain(part, rng_);
  return Premultiplied(part, mask);
}

void LayerTextures::ShareThis(const cv::Mat& picture) {
  sharing_ = true;
  shared_ = picture;
}

absl::StatusOr<cv::Mat> LayerTextures::BackgroundPicture() {
  const auto& paths = library_->backgrounds();
  absl::StatusOr<cv::Mat> picture =
      library_->Load(paths[static_cast<size_t>(rng_.Below(static_cast<int64_t>(paths.size())))]);
  if (!picture.ok()) return picture;
  return Rgb(*picture);
}

// A whole picture of the library, or a made-up one of 'size'.
absl::StatusOr<cv::Mat> LayerTextures::ProceduralOrPicture(cv::Size size) {
  if (UsePicture(library_ != nullptr && !library_->backgrounds().empty())) return BackgroundPicture();
  return ProceduralTexture(size, rng_);
}

absl::StatusOr<cv::Mat> LayerTextures::Background(cv::Size size) {
  absl::StatusOr<cv::Mat> picture = ProceduralOrPicture(size);
  if (!picture.ok()) return picture;
  if (picture->size() != size) picture = RandomPart(*picture, size, 3, rng_);
  return plain_ ? Plain(*picture, rng_) : *picture;
}

absl::StatusOr<cv::Mat> LayerTextures::Cover(cv::Size size, double cover) {
  absl::StatusOr<cv::Mat> picture = Background(size);
  if (!picture.ok()) return picture;
  return Premultiplied(*picture, CoverMask(size, cover, rng_));
}

absl::StatusOr<cv::Mat> LayerTextures::Skin(int side) {
  if (shared_.channels() == 3) return shared_;
  return ProceduralOrPicture({side, side});
}

cv::Mat LayerTextures::Limb(const cv::Mat& skin, cv::Size size) { return CutOut(skin, LimbMask(size)); }

absl::StatusOr<cv::Mat> LayerTextures::Source(int side) {
  const bool objects = library_ != nullptr && !library_->objects().empty();
  if (UsePicture(objects) && rng_.Chance(0.7)) {
    return library_->Load(
        library_->objects()[static_cast<size_t>(rng_.Below(static_cast<int64_t>(library_->objects().size())))]);
  }
  return ProceduralOrPicture({side, side});
}

absl::StatusOr<cv::Mat> LayerTextures::Object(int side) {
  cv::Mat source = shared_;
  if (source.empty()) {
    absl::StatusOr<cv::Mat> fresh = Source(side);
    if (!fresh.ok()) return fresh;
    source = *fresh;
    if (sharing_) shared_ = source;
  }
  return source.channels() == 4 ? AlphaObject(source, side, rng_)
                                : CutOut(source, CutOutMask(CutOutSize(side, rng_), rng_));
}

}  // namespace holdfast
