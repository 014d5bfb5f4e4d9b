// SPDX-License-Identifier: Apache-2.0
// Which place of a layer's texture each pixel of the frame shows.
#pragma once

#include <opencv2/core.hpp>

#include "training/data/synthetic/motion.h"

namespace holdfast {

// [h, w] CV_32FC1: the texture coordinates of every pixel of 'area', and perhaps of a few more to the right and below.
// They are map.PlaneFromImage(pixel) + 'centre', solved at some of the pixels and interpolated between them so closely
// that colours are within about 0.05 pixels of the image of where the forward map has them.
void InverseMaps(const PlaneMap& map, cv::Point2d centre, cv::Rect area, cv::Mat& map_x, cv::Mat& map_y);

}  // namespace holdfast
