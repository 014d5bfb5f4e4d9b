// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/synchronization/mutex.h"
#include "api/point_tracker.h"
#include "api/steady_event.h"
#include "holdfast/v1/point_tracking.grpc.pb.h"

namespace holdfast {

// 'status' with the server's address in front of its text and 'where' behind it; details are kept.
absl::Status AboutServer(absl::string_view address, const absl::Status& status, absl::string_view where = "");

// One Track call. The owner's thread writes; a thread of the stream reads and calls the observer.
class RemoteStream final : public TrackStream {
 public:
  // Starts the call. 'observer' is not owned and must outlive the stream.
  RemoteStream(std::shared_ptr<grpc::Channel> channel, std::string address, TrackObserver& observer);
  ~RemoteStream() override;

  // Sends 'config' and blocks until the server has answered. REQUIRES: called once, before anything else.
  absl::Status Start(const SessionConfig& config, absl::Duration answer_timeout);

  absl::Status PushFrame(Frame frame) override;
  absl::Status AddPoints(std::vector<PointQuery> points) override;
  absl::Status RemovePoints(std::vector<PointId> ids) override;
  absl::Status Finish() override;
  void Cancel() override;

 private:
  absl::Status Write(const v1::TrackRequest& request);
  void ReadUntilTheEnd();
  absl::Status Deliver(const v1::TrackResponse& response);
  absl::Status DeliverAccepted(const v1::SessionAccepted& accepted);
  absl::Status EndOfCall(const absl::Status& delivered);
  std::string LastFrame() const;  // for the reader of an error; empty before the first frame

  const std::string address_;
  TrackObserver& observer_;
  grpc::ClientContext context_;
  const std::unique_ptr<v1::PointTracking::Stub> stub_;
  const std::unique_ptr<grpc::ClientReaderWriter<v1::TrackRequest, v1::TrackResponse>> call_;
  std::atomic<bool> cancelled_{false};     // by the caller
  std::atomic<int64_t> last_frame_{-1};    // index of the newest frame given to the call
  bool half_closed_ = false;               // of the writing thread
  std::optional<SessionSummary> summary_;  // of the reading thread

  SteadyEvent answered_;  // accepted_ or end_ was set
  absl::Mutex mutex_;
  bool accepted_ ABSL_GUARDED_BY(mutex_) = false;
  std::optional<absl::Status> end_ ABSL_GUARDED_BY(mutex_);  // how the session ended
  bool done_ ABSL_GUARDED_BY(mutex_) = false;                // OnDone has returned

  std::thread reader_;  // last: it uses all of the above
};

}  // namespace holdfast
