// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>
#include <thread>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "api/steady_event.h"
#include "holdfast/v1/point_tracking.grpc.pb.h"

namespace holdfast {

struct RemoteServer {
  std::string address;
  std::shared_ptr<grpc::Channel> channel;
  std::string token;         // of the caller; empty: it has none
  std::string trace_parent;  // of its calls; empty: they are in no trace
};

// 'context' with what 'server' is to know of the caller, before its call begins.
grpc::ClientContext* Introduced(const RemoteServer& server, grpc::ClientContext& context);

// The code and the details of 'status' with another text.
absl::Status WithText(const absl::Status& status, absl::string_view text);

// 'status' with the server's address in front of its text and 'where' behind it; details are kept.
absl::Status AboutServer(absl::string_view address, const absl::Status& status, absl::string_view where = "");

// One Track call. One thread may write while another one reads; Cancel may be called from any thread.
class RemoteCall {
 public:
  explicit RemoteCall(const RemoteServer& server)
      : stub_(v1::PointTracking::NewStub(server.channel)), call_(stub_->Track(Introduced(server, context_))) {}

  // False: the call is over.
  bool Write(const v1::TrackRequest& request) { return call_->Write(request); }
  void WritesDone() { call_->WritesDone(); }
  bool Read(v1::TrackResponse* response) { return call_->Read(response); }
  // Drops answers that were not read; blocks until the call is over. UNAVAILABLE for every way of losing a server, and
  // after Cancel. REQUIRES: called once, by the thread that reads.
  absl::Status Finish();
  void Cancel() { context_.TryCancel(); }

 private:
  grpc::ClientContext context_;
  const std::unique_ptr<v1::PointTracking::Stub> stub_;
  const std::unique_ptr<grpc::ClientReaderWriter<v1::TrackRequest, v1::TrackResponse>> call_;
};

// Cancels a call that does not get its first answer in time. A call's own deadline would end it later on.
class AnswerTimer {
 public:
  // 'call' is not owned and must outlive the timer.
  AnswerTimer(RemoteCall& call, absl::Duration timeout)
      : thread_([this, &call, timeout] {
          if (answered_.WaitFor(timeout)) return;
          expired_ = true;
          call.Cancel();
        }) {}
  ~AnswerTimer() { Stop(); }

  // The answer is there, or none will come. True: the time was over before.
  bool Stop() {
    answered_.Notify();
    if (thread_.joinable()) thread_.join();
    return expired_;
  }

 private:
  SteadyEvent answered_;
  bool expired_ = false;  // read when the thread has ended
  std::thread thread_;    // last: it uses all of the above
};

}  // namespace holdfast
