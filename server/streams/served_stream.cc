// SPDX-License-Identifier: Apache-2.0
#include "server/streams/served_stream.h"

#include <string>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "api/errors.h"
#include "api/limits.h"
#include "proto/convert.h"
#include "proto/grpc_status.h"
#include "server/logging.h"

namespace holdfast {
namespace {

constexpr size_t kMaxWarnings = 16;     // waiting to be sent; later ones are dropped
constexpr size_t kMaxLoggedText = 300;  // bytes

// Code and text, cut: the text may quote what a stranger sent.
std::string ForLog(const absl::Status& status) {
  const absl::string_view text = status.message();
  return absl::StrCat(absl::StatusCodeToString(status.code()), text.empty() ? "" : ": ", text.substr(0, kMaxLoggedText),
                      text.size() > kMaxLoggedText ? "..." : "");
}

ResumeResult ResultOfResume(const absl::Status& opened) {
  if (opened.ok()) return ResumeResult::kResumed;
  const bool wrong = absl::IsFailedPrecondition(opened) || absl::IsInvalidArgument(opened);
  return wrong ? ResumeResult::kRefused : ResumeResult::kOverloaded;
}

}  // namespace

ServedStream::ServedStream(Deps deps, Gatekeeper::Pass pass, TraceContext trace, StreamCarrier& carrier)
    : deps_(std::move(deps)),
      pass_(std::move(pass)),
      trace_(std::move(trace), deps_.spans, deps_.clock),
      started_(deps_.clock.SteadyNow()),
      carrier_(carrier),
      log_(deps_.log),
      last_activity_(started_) {}

// That the carrier's last event has returned is ordered by means of the carrier's own; the lock makes it seen by who
// knows locks alone.
ServedStream::~ServedStream() { const absl::MutexLock lock(&mutex_); }

void ServedStream::Begin() {
  absl::MutexLock lock(&mutex_);
  carrier_.StartRead();
}

bool ServedStream::TakesInput(EngineSession*& session) {
  absl::MutexLock lock(&mutex_);
  last_activity_ = deps_.clock.SteadyNow();
  session = session_.get();
  return !input_closed_ && !cancelled_ && !done_;
}

void ServedStream::OnRequest(absl::StatusOr<v1::TrackRequest> request) {
  EngineSession* session = nullptr;
  if (!TakesInput(session)) return;
  if (!request.ok()) return End(request.status());
  if (request->has_finish()) return OnInputEnd();
  const absl::Status taken = session == nullptr ? Open(*request) : Apply(*std::move(request), *session);
  if (!taken.ok()) return End(taken);
  absl::MutexLock lock(&mutex_);
  reading_ = false;  // not before: writes and the engine start reads too, and messages have to stay in their order
  MaybeReadLocked();
}

void ServedStream::OnInputEnd() {
  EngineSession* session = nullptr;
  if (!TakesInput(session)) return;
  if (session == nullptr) return End(InvalidFieldError("config", "is missing: the stream ended before it came"));
  {
    absl::MutexLock lock(&mutex_);
    if (input_closed_) return;
    input_closed_ = true;
  }
  session->Finish();
}

absl::Status ServedStream::Open(const v1::TrackRequest& request) {
  if (!request.has_config()) {
    return InvalidFieldError("config", "is missing: the first message of a stream has to be the config");
  }
  absl::StatusOr<SessionConfig> config = FromProto(request.config());
  if (!config.ok()) return config.status();
  config->max_points = pass_.grant().max_points;
  absl::StatusOr<std::unique_ptr<EngineSession>> opened = OpenSession(*config);
  if (!opened.ok()) return opened.status();

  const SessionAccepted& accepted = (*opened)->accepted();
  const auto log =
      SessionLogger(*deps_.log, accepted.session_id, absl::Utf8SafeCHexEscape(config->label), trace_.context());
  log->info(absl::StrCat(config->resume_token.empty()
                             ? absl::StrCat("session opened with ", config->points.size(), " points")
                             : absl::StrCat("session resumed at frame ", accepted.first_frame),
                         pass_.grant().name.empty() ? "" : " by ", pass_.grant().name));
  EngineSession* late = nullptr;
  {
    absl::MutexLock lock(&mutex_);
    session_ = *std::move(opened);
    accepted_ = session_->accepted();
    accepted_->trace_id = trace_.context().trace_id;
    log_ = log;
    if (cancelled_ || done_) late = session_.get();
    MaybeWriteLocked();
  }
  if (late != nullptr) late->Cancel();
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<EngineSession>> ServedStream::OpenSession(const SessionConfig& config) {
  absl::StatusOr<std::unique_ptr<EngineSession>> opened = deps_.engine.OpenSession(config, *this);
  if (!config.resume_token.empty()) {
    deps_.events.SessionResumed(ResultOfResume(opened.status()));
  }
  return opened;
}

absl::Status ServedStream::Apply(v1::TrackRequest request, EngineSession& session) {
  switch (request.request_case()) {
    case v1::TrackRequest::kConfig:
      return InvalidFieldError("config", "came once more; it is sent once, as the first message");
    case v1::TrackRequest::kFrame:
      return PushFrame(std::move(*request.mutable_frame()), session);
    case v1::TrackRequest::kAddPoints: {
      const auto points = FromProto(request.add_points());
      return points.ok() ? session.AddPoints(*points) : points.status();
    }
    case v1::TrackRequest::kRemovePoints: {
      const auto ids = FromProto(request.remove_points());
      return ids.ok() ? session.RemovePoints(*ids) : ids.status();
    }
    case v1::TrackRequest::kFinish:  // see OnRequest
    case v1::TrackRequest::REQUEST_NOT_SET:
      break;
  }
  return InvalidFieldError("request", "is empty or of an unknown kind");
}

absl::Status ServedStream::PushFrame(v1::Frame&& message, EngineSession& session) {
  absl::StatusOr<Frame> frame = FromProto(std::move(message));
  if (!frame.ok()) return frame.status();
  {
    absl::MutexLock lock(&mutex_);
    full_ = true;  // before the push: OnRoomForFrame may come before the push has returned
  }
  const absl::StatusOr<Room> room = session.PushFrame(*std::move(frame));
  if (!room.ok()) return room.status();
  if (*room == Room::kAvailable) {
    absl::MutexLock lock(&mutex_);
    full_ = false;
  }
  return absl::OkStatus();
}

void ServedStream::OnWritten(bool ok) {
  EngineSession* session;
  {
    absl::MutexLock lock(&mutex_);
    writing_ = false;
    last_activity_ = deps_.clock.SteadyNow();
    if (!ok) cancelled_ = true;
    MaybeWriteLocked();
    MaybeReadLocked();
    session = session_.get();
  }
  if (!ok && session != nullptr) session->Cancel();
}

void ServedStream::OnCancel() {
  EngineSession* session;
  {
    absl::MutexLock lock(&mutex_);
    cancelled_ = true;
    session = session_.get();
    if (session == nullptr && !done_) done_ = absl::CancelledError("the client went away");
    MaybeWriteLocked();
  }
  if (session != nullptr) session->Cancel();
}

void ServedStream::OnTracks(TrackUpdate update) {
  absl::MutexLock lock(&mutex_);
  last_activity_ = deps_.clock.SteadyNow();
  if (cancelled_) return;
  outbox_.Add(std::move(update));
  MaybeWriteLocked();
}

void ServedStream::OnWarning(const absl::Status& warning) {
  std::shared_ptr<spdlog::logger> log;
  {
    absl::MutexLock lock(&mutex_);
    log = log_;
  }
  log->warn(absl::StrCat("warning: ", ForLog(warning)));
  absl::MutexLock lock(&mutex_);
  if (cancelled_ || warnings_.size() >= kMaxWarnings) return;
  warnings_.push_back(warning);
  MaybeWriteLocked();
}

void ServedStream::OnCheckpoint(Checkpoint checkpoint) {
  absl::MutexLock lock(&mutex_);
  if (cancelled_) return;
  checkpoint_ = std::move(checkpoint);
  outbox_.Mark();
  MaybeWriteLocked();
}

void ServedStream::OnRoomForFrame() {
  absl::MutexLock lock(&mutex_);
  full_ = false;
  last_activity_ = deps_.clock.SteadyNow();
  MaybeReadLocked();
}

void ServedStream::OnSessionDone(const absl::Status& status, const SessionSummary& summary) {
  absl::MutexLock lock(&mutex_);
  if (!done_) done_ = status;
  if (done_->ok()) summary_ = summary;
  MaybeWriteLocked();
}

void ServedStream::CheckTime(SteadyTime now, bool wanted) {
  absl::Status late;
  {
    absl::MutexLock lock(&mutex_);
    if (finished_ || cancelled_) return;
    const absl::Duration quiet = Between(last_activity_, now);
    if (writing_) {
      if (quiet < deps_.options.idle_timeout) return;
      log_->info("the client does not read; cutting it off");
      return AbortLocked();
    }
    if (input_closed_ || done_) return;
    const int64_t largest = session_ == nullptr ? kMaxTokenBytes : deps_.engine.limits().max_frame_bytes;
    const absl::Duration on_its_way = wanted ? absl::ZeroDuration() : UploadTime(largest);
    if (session_ == nullptr) {
      if (Between(started_, now) < deps_.options.first_message_timeout + on_its_way) return;
      late = absl::DeadlineExceededError("the config did not come in time");
    } else {
      const absl::Duration most = deps_.options.idle_timeout + on_its_way;
      if (!reading_ || quiet < most) return;
      late = absl::DeadlineExceededError(absl::StrCat("nothing came for ", absl::FormatDuration(most)));
    }
  }
  End(late);
}

void ServedStream::End(const absl::Status& status) {
  EngineSession* session;
  {
    absl::MutexLock lock(&mutex_);
    if (input_closed_ || done_) return;  // it is ending already
    input_closed_ = failing_ = true;
    session = session_.get();
    if (session == nullptr) done_ = status;
    MaybeWriteLocked();
  }
  if (session != nullptr) session->Fail(status);
}

void ServedStream::GoingAway(absl::Duration time_left) {
  absl::MutexLock lock(&mutex_);
  if (told_going_away_ || session_ == nullptr || done_ || cancelled_) return;
  told_going_away_ = true;
  going_away_ = time_left;
  MaybeWriteLocked();
}

void ServedStream::Suspend(const absl::Status& status) {
  EngineSession* session;
  {
    absl::MutexLock lock(&mutex_);
    if (suspended_ || failing_ || done_) return;
    input_closed_ = suspended_ = true;
    session = session_.get();
    if (session == nullptr) done_ = status;
    MaybeWriteLocked();
  }
  if (session != nullptr) session->Suspend(status);
}

void ServedStream::Abort() {
  absl::MutexLock lock(&mutex_);
  if (!cancelled_) AbortLocked();
}

void ServedStream::AbortLocked() {
  cancelled_ = true;
  carrier_.Cancel();
}

void ServedStream::MaybeReadLocked() {
  if (reading_ || full_ || input_closed_ || cancelled_ || done_ || session_ == nullptr) return;
  if (outbox_.bytes() > deps_.options.max_unsent_bytes) return;
  reading_ = true;
  carrier_.StartRead();
}

void ServedStream::MaybeWriteLocked() {
  if (writing_ || finished_) return;
  v1::TrackResponse response;
  if (cancelled_ || !NextResponseLocked(response)) return MaybeFinishLocked();
  writing_ = true;
  last_activity_ = deps_.clock.SteadyNow();
  carrier_.StartWrite(response);
}

// Fills 'response' with what has to be sent next; false: nothing waits.
bool ServedStream::NextResponseLocked(v1::TrackResponse& response) {
  if (accepted_) {
    *response.mutable_accepted() = ToProto(*accepted_);
    accepted_.reset();
  } else if (going_away_) {
    *response.mutable_going_away() = GoingAwayToProto(*going_away_);
    going_away_.reset();
  } else if (!warnings_.empty()) {
    *response.mutable_warning() = ToRpcStatus(warnings_.front());
    warnings_.erase(warnings_.begin());
  } else if (checkpoint_ && !outbox_.marked_waits()) {  // before later results, which may never end
    *response.mutable_checkpoint() = TakeCheckpointLocked();
  } else if (!outbox_.empty()) {
    *response.mutable_tracks() = ToProto(outbox_.Take(deps_.options.max_message_bytes));
  } else if (summary_) {
    *response.mutable_summary() = ToProto(*summary_);
    summary_.reset();
    pass_.Leave();
  } else {
    return false;
  }
  return true;
}

v1::Checkpoint ServedStream::TakeCheckpointLocked() {
  Checkpoint checkpoint = *std::exchange(checkpoint_, std::nullopt);
  if (checkpoint.token.empty()) {
    log_->warn("the session has outgrown what a checkpoint can hold");
  } else {
    deps_.events.CheckpointSent(static_cast<int64_t>(checkpoint.token.size()));
    log_->debug(absl::StrCat("checkpoint of ", checkpoint.token.size(), " bytes"));
  }
  return ToProto(std::move(checkpoint));
}

void ServedStream::MaybeFinishLocked() {
  if (finished_ || writing_ || !done_) return;
  finished_ = true;
  pass_.GiveBack();
  TellEndLocked();
  carrier_.Finish(cancelled_ ? absl::CancelledError("the client went away") : *done_);
}

void ServedStream::TellEndLocked() {
  const auto level = IsServersFault(*done_) ? spdlog::level::err : spdlog::level::info;
  log_->log(level, absl::StrCat(session_ == nullptr ? "stream" : "session", " ended: ", ForLog(*done_)));
  trace_.End(*done_, {{"rpc.system", std::string(deps_.system)},
                      {"holdfast.session", session_ == nullptr ? "" : session_->accepted().session_id},
                      {"holdfast.caller", pass_.grant().name}});
}

}  // namespace holdfast
