// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "proto/types.h"

namespace holdfast {

// The size that a compressed picture says it has, read from its header without decoding anything and without looking
// past its end, so that limits hold before memory is taken. INVALID_ARGUMENT when there is no such header.
absl::StatusOr<ImageSize> JpegSize(absl::string_view bytes);
absl::StatusOr<ImageSize> PngSize(absl::string_view bytes);

}  // namespace holdfast
