// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "io/descriptor.h"

namespace holdfast {

// Encoded frames in a temporary file, to be read again in any order: memory stays small however many they are. The file
// has no name and goes away with this object, or with the program. Not thread-safe.
class FrameSpool {
 public:
  // Below $TMPDIR, or /var/tmp, which is no memory on the machines that have one there for /tmp.
  static absl::StatusOr<FrameSpool> Create();

  absl::Status Append(absl::string_view bytes);
  int64_t size() const { return static_cast<int64_t>(ends_.size()); }  // frames
  // REQUIRES: 0 <= index < size().
  absl::StatusOr<std::string> Read(int64_t index) const;

 private:
  FrameSpool(std::string directory, int fd);

  std::string directory_;
  std::unique_ptr<Descriptor> file_;
  std::vector<int64_t> ends_;  // in the file, of each frame
};

}  // namespace holdfast
