// SPDX-License-Identifier: Apache-2.0
#include "server/tracing/stream_trace.h"

namespace holdfast {

StreamTrace::StreamTrace(TraceContext context, SpanSink* sink, Clock& clock)
    : context_(std::move(context)),
      sink_(sink),
      clock_(clock),
      began_(clock.SteadyNow()),
      began_wall_(clock.WallNow()) {}

absl::Time StreamTrace::WallTime(SteadyTime time) const { return began_wall_ + Between(began_, time); }

void StreamTrace::Add(const StageWork& work) const {
  if (!recording()) return;
  sink_->Take({context_.trace_id,
               NewSpanId(),
               context_.span_id,
               StageName(work.stage),
               WallTime(work.begin),
               WallTime(work.end),
               absl::OkStatus(),
               {},
               {{"holdfast.first_frame", work.first_frame}, {"holdfast.count", work.count}}});
}

void StreamTrace::End(const absl::Status& status, std::vector<std::pair<std::string, std::string>> attributes) const {
  if (!recording()) return;
  sink_->Take({context_.trace_id,
               context_.span_id,
               context_.parent_id,
               "holdfast.v1.PointTracking/Track",
               began_wall_,
               WallTime(clock_.SteadyNow()),
               status,
               std::move(attributes),
               {}});
}

}  // namespace holdfast
