// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace holdfast {

enum class RefusalReason { kLoading, kDraining, kStreams };

// What the server reports beside the engine's events. Implementations are thread-safe and quick.
class ServerEvents {
 public:
  virtual ~ServerEvents() = default;
  virtual void StreamRefused(RefusalReason reason) = 0;  // before it reached the engine
};

}  // namespace holdfast
