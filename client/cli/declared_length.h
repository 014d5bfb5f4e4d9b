// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace holdfast {

// Whether a video file has fewer bytes than its container says, as one has whose recording or copying was cut off: MP4
// and QuickTime, Matroska and WebM, AVI. False for other files, and where the container does not say.
bool LacksItsEnd(const std::string& path);

}  // namespace holdfast
