// SPDX-License-Identifier: Apache-2.0
#include "client/resuming_stream.h"

#include <algorithm>
#include <functional>
#include <random>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/limits.h"
#include "proto/convert.h"

namespace holdfast {
namespace {

std::function<double()> MakeRandom() {
  return [engine = std::mt19937_64(std::random_device()())]() mutable {
    return std::uniform_real_distribution<double>(0, 1)(engine);
  };
}

// Of a session that no server has accepted yet.
bool AnotherServerMayAccept(const absl::Status& status) {
  return absl::IsUnavailable(status) || absl::IsDeadlineExceeded(status) || absl::IsResourceExhausted(status) ||
         absl::IsFailedPrecondition(status);
}

}  // namespace

ResumingStream::ResumingStream(const Options& options, const SessionConfig& config, TrackObserver& observer)
    : options_(options),
      queue_(options.buffer_bytes, options.resume),
      config_(config),
      answers_(observer, queue_),
      plan_({options.servers.size(), options.reconnect_timeout, options.backoff}, MakeRandom()),
      observer_(observer),
      thread_([this] { Run(); }) {}

ResumingStream::~ResumingStream() {
  Cancel();
  thread_.join();
}

absl::Status ResumingStream::AwaitAnswer() {
  absl::MutexLock lock(&mutex_);
  const auto answered = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return accepted_ || end_.has_value(); };
  mutex_.Await(absl::Condition(&answered));
  return accepted_ ? absl::OkStatus() : *end_;
}

absl::Status ResumingStream::PushFrame(Frame frame) {
  v1::TrackRequest request;
  *request.mutable_frame() = ToProto(std::move(frame));
  return queue_.Push(std::move(request));
}

absl::Status ResumingStream::AddPoints(std::vector<PointQuery> points) {
  v1::TrackRequest request;
  *request.mutable_add_points() = AddPointsToProto(points);
  return queue_.Push(std::move(request));
}

absl::Status ResumingStream::RemovePoints(std::vector<PointId> ids) {
  v1::TrackRequest request;
  *request.mutable_remove_points() = RemovePointsToProto(ids);
  return queue_.Push(std::move(request));
}

absl::Status ResumingStream::Finish() {
  queue_.Close();
  absl::MutexLock lock(&mutex_);
  mutex_.Await(absl::Condition(&done_));
  return *end_;
}

void ResumingStream::Cancel() {
  absl::MutexLock lock(&mutex_);
  if (stopped_ || end_) return;
  stopped_ = absl::CancelledError("the session was cancelled");
  wake_.Notify();
  if (call_ != nullptr) call_->Cancel();
}

void ResumingStream::Run() {
  absl::Status end = RunCalls();
  {
    absl::MutexLock lock(&mutex_);
    if (stopped_ && !end.ok()) end = *stopped_;
    end_ = end;
  }
  queue_.End(end);
  observer_.OnDone(end, answers_.summary().value_or(SessionSummary{}));
  absl::MutexLock lock(&mutex_);
  done_ = true;
}

absl::Status ResumingStream::RunCalls() {
  absl::StatusOr<OpenCall> open = OpenFirst();
  for (bool first = true; open.ok(); first = false) {
    if (first) TakeOptions(open->accepted);
    const SteadyTime began = clock_.SteadyNow();
    const absl::Status end = Follow(*open);
    if (!CanResume(end)) return end;
    const SteadyTime now = clock_.SteadyNow();
    const bool recovered = first || Between(began, now) > options_.reconnect_timeout;
    plan_.Lost(server_, now, answers_.TakeProgress() || recovered);
    if (answers_.checkpoint() && !answers_.checkpoint()->resumable) plan_.StayFirst();
    observer_.OnReconnecting(end);
    open = OpenNext(end);
  }
  return open.status();
}

absl::StatusOr<ResumingStream::OpenCall> ResumingStream::OpenFirst() {
  const size_t servers = options_.servers.size();
  absl::StatusOr<OpenCall> open;
  for (size_t i = 0; i < servers; ++i) {
    open = OpenOn((options_.first_server + i) % servers, absl::InfiniteDuration());
    if (open.ok() || !AnotherServerMayAccept(open.status())) break;
  }
  return open;
}

absl::StatusOr<ResumingStream::OpenCall> ResumingStream::OpenNext(absl::Status lost) {
  absl::Status refused;  // by a server that cannot take this session: says more than that the others are not there
  for (SteadyTime now = clock_.SteadyNow(); const auto attempt = plan_.Next(now); now = clock_.SteadyNow()) {
    wake_.WaitFor(Between(now, attempt->at));
    if (stopped()) return lost;
    absl::StatusOr<OpenCall> open = OpenOn(attempt->server, plan_.TimeLeft(clock_.SteadyNow()));
    if (open.ok()) return open;
    lost = open.status();
    if (!plan_.Failed(lost, clock_.SteadyNow())) return lost;
    if (absl::IsFailedPrecondition(lost)) refused = lost;
  }
  const absl::Status& why = refused.ok() ? lost : refused;
  return WithText(why, absl::StrCat(why.message(), "; no server took the session over within ",
                                    absl::FormatDuration(options_.reconnect_timeout)));
}

absl::StatusOr<ResumingStream::OpenCall> ResumingStream::OpenOn(size_t server, absl::Duration at_most) {
  server_ = server;
  const v1::TrackRequest config = ConfigMessage();
  const absl::Duration timeout = options_.answer_timeout + UploadTime(static_cast<int64_t>(config.ByteSizeLong()));
  OpenCall open;
  open.call = std::make_shared<RemoteCall>(options_.servers[server]);
  SetCall(open.call);
  absl::StatusOr<SessionAccepted> accepted = AwaitAccepted(*open.call, config, std::min(timeout, at_most));
  if (!accepted.ok()) return Located(accepted.status());
  open.accepted = *std::move(accepted);
  open.accepted.server = options_.servers[server].address;
  return open;
}

absl::StatusOr<SessionAccepted> ResumingStream::AwaitAccepted(RemoteCall& call, const v1::TrackRequest& config,
                                                              absl::Duration timeout) {
  AnswerTimer timer(call, timeout);
  v1::TrackResponse response;
  absl::StatusOr<SessionAccepted> accepted = absl::InternalError("ended the session without accepting it");
  const bool answered = call.Write(config) && call.Read(&response);
  if (answered && response.has_accepted()) accepted = FromProto(response.accepted());
  if (answered && !response.has_accepted()) accepted = absl::InternalError("answered before it accepted the session");
  const bool in_time = !timer.Stop();
  if (accepted.ok() && in_time) return accepted;
  if (answered) call.Cancel();
  const absl::Status status = call.Finish();
  if (!in_time) {
    return absl::DeadlineExceededError(absl::StrCat("did not answer within ", absl::FormatDuration(timeout)));
  }
  return answered || status.ok() ? accepted.status() : status;
}

v1::TrackRequest ResumingStream::ConfigMessage() const {
  v1::TrackRequest request;
  *request.mutable_config() = ToProto(config_);
  if (const auto& checkpoint = answers_.checkpoint()) request.mutable_config()->set_resume_token(checkpoint->token);
  return request;
}

void ResumingStream::TakeOptions(const SessionAccepted& accepted) {
  if (config_.processing_size.empty()) config_.processing_size = accepted.processing_size;
  config_.hop_frames = accepted.hop_frames;
  config_.max_hop_frames = 0;
  if (config_.iterations == 0) config_.iterations = accepted.iterations;
  if (!config_.motion_prior) config_.motion_prior = accepted.motion_prior;
  if (!config_.polish) config_.polish = accepted.polish;
}

absl::Status ResumingStream::Follow(const OpenCall& open) {
  if (!queue_.Restart(open.accepted)) return CannotGoOn(open);
  answers_.Begin(open.accepted);
  {
    absl::MutexLock lock(&mutex_);
    accepted_ = true;
  }
  std::thread writer([this, &open] { WriteMessages(*open.call); });
  const absl::Status delivered = ReadAnswers(*open.call);
  const absl::Status status = open.call->Finish();
  queue_.Interrupt();
  writer.join();
  if (!delivered.ok()) return Located(delivered);
  // The summary is the last message: what is lost after it is the connection alone.
  if (absl::IsUnavailable(status) && answers_.summary()) return absl::OkStatus();
  if (status.ok() && !answers_.summary()) return Located(absl::InternalError("ended the session without a summary"));
  return Located(status);
}

absl::Status ResumingStream::ReadAnswers(RemoteCall& call) {
  absl::Status delivered;
  v1::TrackResponse response;
  while (delivered.ok() && call.Read(&response)) delivered = answers_.Deliver(response);
  if (!delivered.ok()) call.Cancel();
  return delivered;
}

absl::Status ResumingStream::CannotGoOn(const OpenCall& open) {
  open.call->Cancel();
  open.call->Finish().IgnoreError();
  return Located(absl::InternalError(
      absl::StrCat("wants to go on at frame ", open.accepted.first_frame, ", which is not kept any more")));
}

bool ResumingStream::CanResume(const absl::Status& status) const {
  return absl::IsUnavailable(status) && queue_.keeps() && !stopped();
}

void ResumingStream::SetCall(std::shared_ptr<RemoteCall> call) {
  absl::MutexLock lock(&mutex_);
  call_ = std::move(call);
  if (stopped_) call_->Cancel();
}

bool ResumingStream::stopped() const {
  absl::MutexLock lock(&mutex_);
  return stopped_.has_value();
}

absl::Status ResumingStream::Located(const absl::Status& status) const {
  return AboutServer(options_.servers[server_].address, status, queue_.LastFrameSent());
}

void ResumingStream::WriteMessages(RemoteCall& call) {
  while (const ReplayBuffer::Message message = queue_.Next()) {
    if (!call.Write(*message)) return;  // why, is what the reader learns
  }
  call.WritesDone();
}

}  // namespace holdfast
