// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "api/types.h"
#include "holdfast/v1/point_tracking.grpc.pb.h"
#include "proto/convert.h"
#include "proto/grpc_status.h"
#include "tests/support/simulated_clock.h"

namespace holdfast {

inline SessionConfig JpegConfig(std::vector<PointQuery> points = {{7, 10, 20}}) {
  SessionConfig config;
  config.points = std::move(points);
  return config;
}

// One Track call made with blocking calls of the generated stub, message by message.
class TrackCall {
 public:
  explicit TrackCall(const std::shared_ptr<grpc::Channel>& channel, const std::string& trace_parent = "")
      : stub_(v1::PointTracking::NewStub(channel)), stream_(stub_->Track(InTrace(trace_parent))) {}
  // Sends the config and takes the answer to it.
  TrackCall(const std::shared_ptr<grpc::Channel>& channel, const SessionConfig& config) : TrackCall(channel) {
    SendConfig(ToProto(config));
    ReadAccepted();
  }

  bool Send(const v1::TrackRequest& request) { return stream_->Write(request); }
  bool SendConfig(const v1::SessionConfig& config) {
    v1::TrackRequest request;
    *request.mutable_config() = config;
    return Send(request);
  }
  bool SendFrame(int64_t index, std::string bytes = "good", std::vector<PointQuery> points = {}) {
    v1::TrackRequest request;
    *request.mutable_frame() = ToProto(Frame{index, std::move(bytes), {}, std::move(points)});
    return Send(request);
  }
  void SendFrames(int64_t count) {
    for (int64_t index = 0; index < count; ++index) SendFrame(index);
  }
  void HalfClose() { stream_->WritesDone(); }
  void Cancel() { context_.TryCancel(); }

  bool ReadAccepted() {
    v1::TrackResponse response;
    if (!stream_->Read(&response) || !response.has_accepted()) return false;
    accepted_ = response.accepted();
    return true;
  }
  // Takes one message, false at the end.
  bool ReadOne() {
    v1::TrackResponse response;
    if (!stream_->Read(&response)) return false;
    bytes_read += static_cast<int64_t>(response.ByteSizeLong());
    ++messages_read;
    kinds.push_back(response.response_case());
    if (response.has_tracks()) Apply(response.tracks());
    if (response.has_warning()) warnings.push_back(FromRpcStatus(response.warning()));
    if (response.has_summary()) summaries.push_back(FromProto(response.summary()));
    if (response.has_checkpoint()) checkpoints.push_back(response.checkpoint());
    if (response.has_going_away()) times_left.push_back(response.going_away().time_left().seconds());
    return true;
  }
  // Takes everything that is left; how the call ended.
  absl::Status ReadToEnd() {
    while (ReadOne()) {
    }
    return FromGrpcStatus(stream_->Finish());
  }
  absl::Status FinishAndReadToEnd() {
    HalfClose();
    return ReadToEnd();
  }

  const v1::SessionAccepted& accepted() const { return accepted_; }
  // What the results say so far: of each point and frame the x, and whether that is final.
  struct Sample {
    float x;
    bool final;
  };
  std::map<PointId, std::map<int64_t, Sample>> tracks;
  std::vector<absl::Status> warnings;
  std::vector<SessionSummary> summaries;
  std::vector<v1::Checkpoint> checkpoints;
  std::vector<int64_t> times_left;                     // seconds, of what said that the server goes away
  std::vector<v1::TrackResponse::ResponseCase> kinds;  // of the messages, in their order
  int64_t frames_processed = 0;
  int64_t bytes_read = 0;
  int64_t messages_read = 0;

 private:
  grpc::ClientContext* InTrace(const std::string& trace_parent) {
    if (!trace_parent.empty()) context_.AddMetadata("traceparent", trace_parent);
    return &context_;
  }
  void Apply(const v1::Tracks& update) {
    frames_processed = update.frames_processed();
    for (const v1::PointRun& run : update.runs()) {
      for (int i = 0; i < run.x_size(); ++i) {
        tracks[run.id()][run.first_frame() + i] = {run.x(i), i < static_cast<int>(run.final_count())};
      }
    }
  }

  grpc::ClientContext context_;
  const std::unique_ptr<v1::PointTracking::Stub> stub_;
  const std::unique_ptr<grpc::ClientReaderWriter<v1::TrackRequest, v1::TrackResponse>> stream_;
  v1::SessionAccepted accepted_;
};

// Reads to the end while time goes by, step by step, because what happened last is not known to the test. The server
// asks for the time between two steps, so a write in flight has that long before it counts as unread.
inline absl::Status ReadWhileTimePasses(TrackCall& call, SimulatedClock& clock, absl::Duration step) {
  absl::Status status;
  std::atomic<bool> ended{false};
  std::thread reader([&] {
    status = call.ReadToEnd();
    ended = true;
  });
  while (!ended) {
    clock.Advance(step);
    clock.AwaitSteadyReads(1);
  }
  reader.join();
  return status;
}

}  // namespace holdfast
