// SPDX-License-Identifier: Apache-2.0
// TensorBoard's event files: records with checksums (TFRecord), each an encoded `Event` message. Scalars only.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/string_view.h"

namespace holdfast {

// CRC-32C (Castagnoli).
uint32_t Crc32c(absl::string_view bytes);
// length, its masked checksum, the bytes, their masked checksum.
std::string FrameRecord(absl::string_view bytes);

using Scalars = std::vector<std::pair<std::string, float>>;  // by tag
// The first record of a file.
std::string EncodeVersionEvent(double wall_seconds);
std::string EncodeScalarEvent(double wall_seconds, int64_t step, const Scalars& scalars);

}  // namespace holdfast
