// SPDX-License-Identifier: Apache-2.0
// Where the layers of a synthetic scene get their looks: pictures with alpha, cut-outs of pictures, or procedures.
#pragma once

#include <opencv2/core.hpp>

#include "absl/status/statusor.h"
#include "training/data/rng.h"
#include "training/data/synthetic/picture_library.h"

namespace holdfast {

// Made for one scene. 'library' (may be null) and 'rng' are borrowed.
class LayerTextures {
 public:
  LayerTextures(const PictureLibrary* library, double picture_share, Rng& rng)
      : library_(library), picture_share_(picture_share), rng_(rng) {}

  // [size] CV_8UC3 RGB
  absl::StatusOr<cv::Mat> Background(cv::Size size);
  // A background with large irregular openings, about 'cover' of it left: [size] CV_8UC4, RGBA, colours times alpha.
  absl::StatusOr<cv::Mat> Cover(cv::Size size, double cover);
  // What limbs are cut from: [h, w] CV_8UC3 RGB.
  absl::StatusOr<cv::Mat> Skin(int side);
  // A bar with round ends, lying along x: [size] CV_8UC4, RGBA, colours times alpha.
  cv::Mat Limb(const cv::Mat& skin, cv::Size size);
  // [h, w] CV_8UC4, RGBA with colours multiplied by alpha, with a transparent rim; longest side about 'side' pixels.
  absl::StatusOr<cv::Mat> Object(int side);

  // From now on all objects are cut from one picture or are copies of one object. Until one has been made, none is.
  void ShareOne() { sharing_ = true; }
  // From now on backgrounds, and some of what is cut out, are faint, blurred or repeat themselves.
  void TurnPlain() { plain_ = true; }
  // From now on all objects are cut from this picture ([h, w] CV_8UC3 RGB).
  void ShareThis(const cv::Mat& picture);

 private:
  bool UsePicture(bool available) { return available && rng_.Chance(picture_share_); }
  absl::StatusOr<cv::Mat> Source(int side);  // RGBA with alpha of its own, or RGB to be cut out
  absl::StatusOr<cv::Mat> BackgroundPicture();
  absl::StatusOr<cv::Mat> ProceduralOrPicture(cv::Size size);
  cv::Mat CutOut(const cv::Mat& picture, const cv::Mat& mask);

  const PictureLibrary* const library_;
  const double picture_share_;
  Rng& rng_;
  bool sharing_ = false;
  bool plain_ = false;
  cv::Mat shared_;
};

}  // namespace holdfast
