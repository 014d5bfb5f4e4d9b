// SPDX-License-Identifier: Apache-2.0
// The safetensors file format: named tensors and a string map, no code. Every offset and size of a file is checked
// against the bytes there are before memory is taken, so a hostile file gives an error, never a crash.
#pragma once

#include <torch/types.h>

#include <map>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "io/file_io.h"

namespace holdfast {

struct TensorFile {
  std::map<std::string, std::string> metadata;
  std::map<std::string, torch::Tensor> tensors;  // contiguous, CPU; F32, F16, BF16, F64, I64, I32, U8, BOOL
};

// INVALID_ARGUMENT names the tensor and what is wrong: truncated, overlapping, out of bounds, unknown dtype, shape that
// does not match the bytes, duplicate name. 'bytes' is not needed afterwards.
absl::StatusOr<TensorFile> ParseSafetensors(absl::string_view bytes);
// As ReadFile or ParseSafetensors.
absl::StatusOr<TensorFile> ReadSafetensors(const std::string& path, int64_t max_bytes = int64_t{1} << 34);
absl::StatusOr<std::string> SerializeSafetensors(const TensorFile& file);
// Atomic, as WriteFileAtomically.
absl::Status WriteSafetensors(const std::string& path, const TensorFile& file);

}  // namespace holdfast
