// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "api/clock.h"
#include "server/engine/engine_session.h"
#include "server/tracing/span.h"
#include "server/tracing/trace_context.h"

namespace holdfast {

// The spans of one stream: one for all of it, and below that one for each piece of work that the engine did for it.
// Thread-safe.
class StreamTrace {
 public:
  // Begins now. 'sink' null: nothing is recorded; otherwise it must outlive this, as must 'clock'.
  StreamTrace(TraceContext context, SpanSink* sink, Clock& clock);

  const TraceContext& context() const { return context_; }
  // Somebody wants to know of this stream: Add is worth its while.
  bool recording() const { return sink_ != nullptr && context_.sampled; }
  void Add(const StageWork& work) const;
  // The stream has ended. REQUIRES: called once.
  void End(const absl::Status& status, std::vector<std::pair<std::string, std::string>> attributes) const;

 private:
  absl::Time WallTime(SteadyTime time) const;

  const TraceContext context_;
  SpanSink* const sink_;
  Clock& clock_;
  const SteadyTime began_;
  const absl::Time began_wall_;
};

}  // namespace holdfast
