// SPDX-License-Identifier: Apache-2.0
// Where the points of a synthetic clip start.
#pragma once

#include <opencv2/core.hpp>

#include <cstdint>
#include <vector>

#include "training/data/rng.h"

namespace holdfast {

// 'count' places (sub-pixel, inside) in a frame, each with the id under its nearest pixel: half on objects (ids above
// 'background', every object as likely), where there are any, half anywhere. Places at the edge of an id or on plain
// surfaces are avoided, not excluded.
std::vector<cv::Point2d> ChoosePoints(const cv::Mat& frame, const cv::Mat& ids, int32_t background, int64_t count,
                                      Rng& rng);

}  // namespace holdfast
