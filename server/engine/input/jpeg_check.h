// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "api/types.h"

namespace holdfast {

// The size of the JPEG in 'bytes', after a walk over its segments and scans that decodes nothing, takes no memory and
// ends at the end marker. So limits hold before a decoder sees the picture: its work grows with its scans, and a scan
// may be a few bytes long. INVALID_ARGUMENT: broken or truncated structure, several pictures, too many scans or
// segments, too much metadata, or a process other than 8-bit baseline, extended or progressive with Huffman codes.
absl::StatusOr<ImageSize> CheckJpeg(absl::string_view bytes);

}  // namespace holdfast
