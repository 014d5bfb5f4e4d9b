// SPDX-License-Identifier: Apache-2.0
// Pictures of samples for people to look at.
#pragma once

#include <opencv2/core.hpp>

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "training/data/sample.h"

namespace holdfast {

// Frame s [H, W] CV_8UC3 RGB with the valid points drawn, each in a colour of its own: filled where visible, rings
// where hidden, with a short tail of where they came from.
cv::Mat DrawPoints(const Sample& sample, int64_t frame);

// All frames as a motion-JPEG video.
absl::Status WritePreviewVideo(const Sample& sample, const std::string& path);

// Some frames side by side, from first to last: those drawn above, their masks below if there are any.
absl::Status WriteContactSheet(const Sample& sample, int columns, const std::string& path);

}  // namespace holdfast
