// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "holdfast/v1/point_tracking.grpc.pb.h"
#include "server/streams/served_streams.h"

namespace holdfast {

// The gRPC service: its streams are those of ServedStreams. Messages of Track come as bytes: see message_codec.h.
// Thread-safe.
class TrackService final : public v1::PointTracking::WithRawCallbackMethod_Track<
                               v1::PointTracking::WithCallbackMethod_GetServerInfo<v1::PointTracking::Service>> {
 public:
  // 'streams' must outlive the service.
  explicit TrackService(ServedStreams& streams) : streams_(streams) {}

  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* Track(grpc::CallbackServerContext* context) override;
  grpc::ServerUnaryReactor* GetServerInfo(grpc::CallbackServerContext* context, const v1::GetServerInfoRequest* request,
                                          v1::GetServerInfoResponse* response) override;

 private:
  ServedStreams& streams_;
};

}  // namespace holdfast
