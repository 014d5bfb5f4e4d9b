// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "absl/status/status.h"
#include "api/types.h"

namespace holdfast {

// What every command that sends a video asks for. INVALID_ARGUMENT names the flag. 'max_side': of the pictures that are
// sent, pixels; 0: as they are. 'processing_size': empty: the server's own. 'promise_fps': 0: none is to be promised.
absl::Status CheckSending(int max_side, int jpeg_quality, ImageSize processing_size, double promise_fps);

}  // namespace holdfast
