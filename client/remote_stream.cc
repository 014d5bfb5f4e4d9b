// SPDX-License-Identifier: Apache-2.0
#include "client/remote_stream.h"

#include <utility>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "proto/convert.h"
#include "proto/grpc_status.h"

namespace holdfast {

absl::Status AboutServer(absl::string_view address, const absl::Status& status, absl::string_view where) {
  if (status.ok()) return status;
  const bool unavailable = status.code() == absl::StatusCode::kUnavailable;
  absl::Status named(status.code(), absl::StrCat("holdfast: server at ", address,
                                                 unavailable ? " is unavailable: " : ": ", status.message(), where));
  status.ForEachPayload([&named](absl::string_view url, const absl::Cord& cord) { named.SetPayload(url, cord); });
  return named;
}

RemoteStream::RemoteStream(std::shared_ptr<grpc::Channel> channel, std::string address, TrackObserver& observer)
    : address_(std::move(address)),
      observer_(observer),
      stub_(v1::PointTracking::NewStub(std::move(channel))),
      call_(stub_->Track(&context_)),
      reader_([this] { ReadUntilTheEnd(); }) {}

RemoteStream::~RemoteStream() {
  Cancel();
  reader_.join();
}

absl::Status RemoteStream::Start(const SessionConfig& config, absl::Duration answer_timeout) {
  v1::TrackRequest request;
  *request.mutable_config() = ToProto(config);
  const absl::Status written = Write(request);
  if (!written.ok()) return written;
  if (!answered_.WaitFor(answer_timeout)) {
    return absl::DeadlineExceededError(absl::StrCat("holdfast: server at ", address_, " did not answer within ",
                                                    absl::FormatDuration(answer_timeout)));
  }
  absl::MutexLock lock(&mutex_);
  return accepted_ || end_->ok() ? absl::OkStatus() : *end_;
}

absl::Status RemoteStream::PushFrame(Frame frame) {
  v1::TrackRequest request;
  *request.mutable_frame() = ToProto(std::move(frame));
  last_frame_ = request.frame().index();  // before the write: its answer may end the call while the write returns
  return Write(request);
}

absl::Status RemoteStream::AddPoints(std::vector<PointQuery> points) {
  v1::TrackRequest request;
  *request.mutable_add_points() = AddPointsToProto(points);
  return Write(request);
}

absl::Status RemoteStream::RemovePoints(std::vector<PointId> ids) {
  v1::TrackRequest request;
  *request.mutable_remove_points() = RemovePointsToProto(ids);
  return Write(request);
}

absl::Status RemoteStream::Finish() {
  if (!half_closed_) call_->WritesDone();
  half_closed_ = true;
  absl::MutexLock lock(&mutex_);
  mutex_.Await(absl::Condition(&done_));
  return *end_;
}

void RemoteStream::Cancel() {
  cancelled_ = true;
  context_.TryCancel();
}

absl::Status RemoteStream::Write(const v1::TrackRequest& request) {
  if (half_closed_) return absl::FailedPreconditionError("the session was finished before");
  if (call_->Write(request)) return absl::OkStatus();
  // A failed write means that the call is over; why is known to the reader a moment later.
  absl::MutexLock lock(&mutex_);
  const auto ended = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return end_.has_value(); };
  mutex_.Await(absl::Condition(&ended));
  return end_->ok() ? absl::FailedPreconditionError("the server has ended the session") : *end_;
}

void RemoteStream::ReadUntilTheEnd() {
  v1::TrackResponse response;
  absl::Status delivered;
  while (delivered.ok() && call_->Read(&response)) delivered = Deliver(response);
  if (!delivered.ok()) {
    context_.TryCancel();
    while (call_->Read(&response)) {  // Finish wants every response to be read
    }
  }
  const absl::Status end = EndOfCall(delivered);
  {
    absl::MutexLock lock(&mutex_);
    end_ = end;
    answered_.Notify();
  }
  observer_.OnDone(end, summary_.value_or(SessionSummary{}));
  absl::MutexLock lock(&mutex_);
  done_ = true;
}

absl::Status RemoteStream::Deliver(const v1::TrackResponse& response) {
  switch (response.response_case()) {
    case v1::TrackResponse::kAccepted:
      return DeliverAccepted(response.accepted());
    case v1::TrackResponse::kTracks: {
      absl::StatusOr<TrackUpdate> update = FromProto(response.tracks());
      if (!update.ok()) return update.status();
      observer_.OnTracks(*std::move(update));
      return absl::OkStatus();
    }
    case v1::TrackResponse::kWarning:
      observer_.OnWarning(FromRpcStatus(response.warning()));
      return absl::OkStatus();
    case v1::TrackResponse::kSummary:
      summary_ = FromProto(response.summary());
      return absl::OkStatus();
    default:
      return absl::OkStatus();  // of a newer server; nothing this client could miss
  }
}

absl::Status RemoteStream::DeliverAccepted(const v1::SessionAccepted& message) {
  const absl::StatusOr<SessionAccepted> accepted = FromProto(message);
  if (!accepted.ok()) return accepted.status();
  observer_.OnAccepted(*accepted);
  absl::MutexLock lock(&mutex_);
  accepted_ = true;
  answered_.Notify();
  return absl::OkStatus();
}

absl::Status RemoteStream::EndOfCall(const absl::Status& delivered) {
  const absl::Status status = FromGrpcStatus(call_->Finish());
  if (!delivered.ok()) return AboutServer(address_, delivered, LastFrame());
  if (cancelled_ && absl::IsCancelled(status)) return absl::CancelledError("the session was cancelled");
  if (status.ok() && !summary_) {
    return AboutServer(address_, absl::InternalError("ended the session without a summary"), LastFrame());
  }
  return AboutServer(address_, status, LastFrame());
}

std::string RemoteStream::LastFrame() const {
  const int64_t index = last_frame_;
  return index < 0 ? "" : absl::StrCat(" (the last frame sent is ", index, ")");
}

}  // namespace holdfast
