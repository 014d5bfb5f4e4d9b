// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

namespace holdfast {

// The most resident memory of this process since the object was made, beyond what it had then. Freed memory that malloc
// keeps is given back first, so that what ran before does not hide it.
class PeakMemory {
 public:
  PeakMemory();
  // Empty where a process may not reset its high-water mark (/proc/self/clear_refs).
  std::optional<int64_t> Bytes() const;

 private:
  bool reset_ = false;
  int64_t before_ = 0;
};

}  // namespace holdfast
