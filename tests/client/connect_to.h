// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "client/remote_tracker.h"

namespace holdfast {

// With the options that a program has that names nothing else.
inline absl::StatusOr<std::unique_ptr<RemoteTracker>> ConnectTo(const std::string& address) {
  RemoteTracker::Options options;
  options.addresses = {address};
  return RemoteTracker::Connect(options);
}

}  // namespace holdfast
