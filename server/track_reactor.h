// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/grpcpp.h>

#include <functional>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "server/streams/served_stream.h"
#include "server/streams/served_streams.h"

namespace holdfast {

// A Track call of gRPC, which carries a stream. Made by TrackService::Track. After gRPC's OnDone the reactor calls
// 'retire'; its owner then destroys it, see ServedStreams.
class TrackReactor final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>,
                           public LiveStream,
                           private StreamCarrier {
 public:
  // 'context' is used until gRPC's OnDone; no request of more points than 'max_points' is parsed.
  TrackReactor(ServedStream::Deps deps, Gatekeeper::Pass pass, TraceContext trace, int max_points,
               grpc::CallbackServerContext* context, std::function<void(TrackReactor*)> retire);

  ServedStream& stream() override { return stream_; }

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override { stream_.OnWritten(ok); }
  void OnCancel() override { stream_.OnCancel(); }
  void OnDone() override ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  void StartRead() override { ServerBidiReactor::StartRead(&request_); }
  void StartWrite(const v1::TrackResponse& response) override;
  void Finish(const absl::Status& status) override;
  void Cancel() override ABSL_LOCKS_EXCLUDED(mutex_);

  const int max_points_;
  const std::function<void(TrackReactor*)> retire_;
  // The buffers belong to gRPC while a read or a write is in flight.
  grpc::ByteBuffer request_;
  grpc::ByteBuffer response_;
  absl::Mutex mutex_;                                             // taken with the stream's lock held
  grpc::CallbackServerContext* context_ ABSL_GUARDED_BY(mutex_);  // null after gRPC's OnDone
  ServedStream stream_;                                           // last, so that it is destroyed first
};

}  // namespace holdfast
