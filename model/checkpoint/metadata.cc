// SPDX-License-Identifier: Apache-2.0
#include "model/checkpoint/metadata.h"

#include <exception>

#include "absl/strings/str_cat.h"
#include "model/checkpoint/safetensors.h"

namespace holdfast {
namespace {

absl::Status Named(const std::string& path, const absl::Status& status) {
  if (status.ok()) return status;
  return absl::Status(status.code(), absl::StrCat("checkpoint '", path, "': ", status.message()));
}

}  // namespace

absl::Status CopyWithMetadata(const std::string& from, const std::string& to, const std::string& key,
                              const std::string& value) {
  try {
    absl::StatusOr<TensorFile> file = ReadSafetensors(from);
    if (!file.ok()) return Named(from, file.status());
    file->metadata[key] = value;
    return Named(to, WriteSafetensors(to, *file));
  } catch (const std::exception& error) {  // LibTorch's and the allocator's
    return absl::ResourceExhaustedError(absl::StrCat("cannot copy '", from, "' to '", to, "': ", error.what()));
  }
}

}  // namespace holdfast
