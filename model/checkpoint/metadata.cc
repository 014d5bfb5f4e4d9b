// SPDX-License-Identifier: Apache-2.0
#include "model/checkpoint/metadata.h"

#include <exception>

#include "absl/strings/str_cat.h"
#include "model/checkpoint/safetensors.h"

namespace holdfast {

absl::Status CopyWithMetadata(const std::string& from, const std::string& to, const std::string& key,
                              const std::string& value) {
  try {
    absl::StatusOr<TensorFile> file = ReadSafetensors(from);
    if (!file.ok()) return file.status();
    file->metadata[key] = value;
    return WriteSafetensors(to, *file);
  } catch (const std::exception& error) {  // LibTorch's and the allocator's
    return absl::ResourceExhaustedError(absl::StrCat("cannot copy '", from, "' to '", to, "': ", error.what()));
  }
}

}  // namespace holdfast
