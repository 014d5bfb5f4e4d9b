// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "api/types.h"

namespace holdfast {

// The size of the PNG in 'bytes', after a walk over its chunks that inflates nothing and takes no memory.
// INVALID_ARGUMENT: broken or truncated structure, or too much metadata (everything that does not make the picture).
absl::StatusOr<ImageSize> CheckPng(absl::string_view bytes);

// INVALID_ARGUMENT: the picture's data inflates to more than the picture. libpng inflates all of it, and 16 MiB may
// hold 16 GiB, minutes of work. Inflates up to the picture's size and keeps nothing. REQUIRES: CheckPng is OK.
absl::Status CheckPngData(absl::string_view bytes);

// The picture alone. Decoders inflate texts and colour profiles and keep them until the picture is done, up to 8 MB
// from 8 kB, though nobody asks for them. An animation becomes its still picture. REQUIRES: CheckPng is OK.
std::string PngWithoutMetadata(absl::string_view bytes);

}  // namespace holdfast
