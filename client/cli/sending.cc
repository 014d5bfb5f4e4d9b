// SPDX-License-Identifier: Apache-2.0
#include "client/cli/sending.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "api/limits.h"

namespace holdfast {

absl::Status CheckSending(int max_side, int jpeg_quality, ImageSize processing_size, double promise_fps) {
  if (jpeg_quality < 1 || jpeg_quality > 100) return absl::InvalidArgumentError("--jpeg_quality: expected 1..100");
  if (max_side < 0 || (max_side > 0 && max_side < 32)) {
    return absl::InvalidArgumentError("--max_side: expected 0 or at least 32");
  }
  if (!processing_size.empty() && !IsProcessingSize(processing_size)) {
    return absl::InvalidArgumentError(absl::StrCat("--processing_size: expected multiples of ", kProcessingSizeStep,
                                                   ", such as 512x384; got ", ToString(processing_size)));
  }
  if (!std::isfinite(promise_fps) || promise_fps < 0) {
    return absl::InvalidArgumentError(absl::StrCat("--promise_fps: expected 0 or more, got ", promise_fps));
  }
  return absl::OkStatus();
}

}  // namespace holdfast
