// SPDX-License-Identifier: Apache-2.0
#include "server/track_reactor.h"

#include <utility>

#include "proto/grpc_status.h"
#include "server/streams/message_codec.h"

namespace holdfast {

TrackReactor::TrackReactor(ServedStream::Deps deps, Gatekeeper::Pass pass, TraceContext trace, int max_points,
                           grpc::CallbackServerContext* context, std::function<void(TrackReactor*)> retire)
    : max_points_(max_points),
      retire_(std::move(retire)),
      context_(context),
      stream_(std::move(deps), std::move(pass), std::move(trace), *this) {
  stream_.Begin();
}

void TrackReactor::OnReadDone(bool ok) {
  if (!ok) return stream_.OnInputEnd();
  v1::TrackRequest request;
  const absl::Status parsed = ParseRequest(request_, max_points_, request);
  if (!parsed.ok()) return stream_.OnRequest(parsed);
  stream_.OnRequest(std::move(request));
}

void TrackReactor::OnDone() {
  {
    absl::MutexLock lock(&mutex_);
    context_ = nullptr;
  }
  retire_(this);
}

void TrackReactor::StartWrite(const v1::TrackResponse& response) {
  response_ = SerializeResponse(response);
  ServerBidiReactor::StartWrite(&response_);
}

void TrackReactor::Finish(const absl::Status& status) { ServerBidiReactor::Finish(ToGrpcStatus(status)); }

void TrackReactor::Cancel() {
  absl::MutexLock lock(&mutex_);
  if (context_ != nullptr) context_->TryCancel();  // OnCancel follows, never from within this call
}

}  // namespace holdfast
