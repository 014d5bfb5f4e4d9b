// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <string>

#include "absl/status/statusor.h"

namespace holdfast {

// Shows pictures to somebody, one after the other.
class PictureView {
 public:
  virtual ~PictureView() = default;
  // Returns at once; pictures that come faster than they can be shown are left out.
  virtual void Show(const cv::Mat& picture) = 0;
};

// A window on the display. OpenCV's windows bring a graphical toolkit along, which a program that mostly runs without a
// display should not load each time, nor an image hold: the library is looked for when a window is opened.
//
// 'quit' is called, on a thread of the window, when Esc or q is pressed or the window is closed. UNAVAILABLE where
// there is no display, or no library; the text names --show.
absl::StatusOr<std::unique_ptr<PictureView>> OpenPictureWindow(const std::string& title, std::function<void()> quit);

}  // namespace holdfast
