// SPDX-License-Identifier: Apache-2.0
// A tracking server on a port of its own whose answers the test writes down as a function.
#pragma once

#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "holdfast/v1/point_tracking.grpc.pb.h"

namespace holdfast {

class FakeService final : public v1::PointTracking::Service {
 public:
  using Stream = grpc::ServerReaderWriter<v1::TrackResponse, v1::TrackRequest>;
  using TrackFunction = std::function<grpc::Status(grpc::ServerContext&, Stream&)>;

  explicit FakeService(TrackFunction track) : track_(std::move(track)) {
    grpc::EnableDefaultHealthCheckService(true);
    grpc::ServerBuilder builder;
    builder.SetMaxReceiveMessageSize(-1);
    builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PING_STRIKES, 0);  // a client may ask as often as a test has it
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
    builder.RegisterService(this);
    server_ = builder.BuildAndStart();
    SetServing(true);
  }
  ~FakeService() override { Kill(); }

  std::string address() const { return absl::StrCat("127.0.0.1:", port_); }
  int port() const { return port_; }
  // What grpc.health.v1 says of it.
  void SetServing(bool serving) {
    server_->GetHealthCheckService()->SetServingStatus(v1::PointTracking::service_full_name(), serving);
  }
  // Running calls are broken off, as when the process dies.
  void Kill() { server_->Shutdown(std::chrono::system_clock::now()); }

  grpc::Status Track(grpc::ServerContext* context, Stream* stream) override { return track_(*context, *stream); }
  grpc::Status GetServerInfo(grpc::ServerContext*, const v1::GetServerInfoRequest*,
                             v1::GetServerInfoResponse* response) override {
    *response = info;
    return info_status;
  }

  v1::GetServerInfoResponse info;
  grpc::Status info_status;

 private:
  const TrackFunction track_;
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

inline v1::TrackResponse Accepted() {
  v1::TrackResponse response;
  response.mutable_accepted()->set_session_id("s1");
  response.mutable_accepted()->set_hop_frames(8);
  response.mutable_accepted()->set_window_frames(24);
  return response;
}

inline v1::TrackResponse Summary(int64_t frames) {
  v1::TrackResponse response;
  response.mutable_summary()->set_frames(frames);
  return response;
}

// One final sample of point 'id' at (x, y).
inline v1::TrackResponse Sample(uint64_t id, int64_t frame, float x, float y) {
  v1::TrackResponse response;
  v1::PointRun* run = response.mutable_tracks()->add_runs();
  run->set_id(id);
  run->set_first_frame(frame);
  run->add_x(x);
  run->add_y(y);
  run->add_visible(true);
  run->add_confidence(0.5f);
  run->set_final_count(1);
  response.mutable_tracks()->set_frames_received(frame + 1);
  response.mutable_tracks()->set_frames_processed(frame + 1);
  return response;
}

}  // namespace holdfast
