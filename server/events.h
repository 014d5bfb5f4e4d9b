// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace holdfast {

// kStreams: as many as the server takes are open; kCaller: as many as the caller's token may have.
enum class RefusalReason { kLoading, kDraining, kStreams, kCaller, kToken };
// kRefused: the token fits nothing here; kOverloaded: it may, at another time or elsewhere.
enum class ResumeResult { kResumed, kRefused, kOverloaded };
enum class SpanResult { kSent, kDropped };

// What the server reports beside the engine's events. Implementations are thread-safe and quick.
class ServerEvents {
 public:
  virtual ~ServerEvents() = default;
  virtual void StreamRefused(RefusalReason reason) = 0;  // before it reached the engine
  virtual void SessionResumed(ResumeResult result) = 0;  // what came of a stream that began with a token
  virtual void CheckpointSent(int64_t token_bytes) = 0;
  virtual void SpansDone(SpanResult result, int64_t count) = 0;  // of traces, and what the collector did with them
};

}  // namespace holdfast
