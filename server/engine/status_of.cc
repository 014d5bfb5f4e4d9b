// SPDX-License-Identifier: Apache-2.0
#include "server/engine/status_of.h"

#include <exception>
#include <new>

namespace holdfast {

absl::Status StatusOf(absl::FunctionRef<void()> work, absl::string_view failure) {
  try {
    work();
    return absl::OkStatus();
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory");
  } catch (const std::exception&) {
    return absl::InternalError(failure);
  }
}

}  // namespace holdfast
