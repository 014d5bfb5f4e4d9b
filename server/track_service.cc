// SPDX-License-Identifier: Apache-2.0
#include "server/track_service.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/errors.h"
#include "program/flags.h"
#include "proto/convert.h"
#include "proto/grpc_status.h"
#include "server/tracing/trace_context.h"

namespace holdfast {
namespace {

constexpr absl::Duration kHousekeepingPeriod = absl::Milliseconds(50);
constexpr absl::Duration kFlushTime = absl::Seconds(10);  // after the grace period: for checkpoints to be sent
constexpr absl::Duration kRetryAfter = absl::Seconds(2);
constexpr char kAuthorization[] = "authorization";
constexpr char kTraceParent[] = "traceparent";

// Ends a call that was not admitted.
class RefusedCall final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer> {
 public:
  explicit RefusedCall(const absl::Status& status) { Finish(ToGrpcStatus(status)); }
  void OnDone() override { delete this; }  // owned by the call
};

// Empty where there is none; the first one of several.
absl::string_view MetadataOf(const grpc::CallbackServerContext& context, const char* key) {
  const auto found = context.client_metadata().find(key);
  if (found == context.client_metadata().end()) return "";
  return {found->second.data(), found->second.size()};
}

}  // namespace

TrackService::TrackService(const Options& options, Gatekeeper& gatekeeper, Clock& clock, ServerEvents& events,
                           std::shared_ptr<spdlog::logger> log)
    : options_(options),
      gatekeeper_(gatekeeper),
      clock_(clock),
      events_(events),
      log_(std::move(log)),
      housekeeper_([this] { KeepHouse(); }) {}

TrackService::~TrackService() {
  {
    absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(this, &TrackService::IdleLocked));
    stopping_ = true;
    work_.Notify();
  }
  housekeeper_.join();
}

void TrackService::Serve(Engine& engine) {
  absl::MutexLock lock(&mutex_);
  engine_ = &engine;
}

void TrackService::Drain() {
  absl::MutexLock lock(&mutex_);
  drain_began_ = clock_.SteadyNow();
  mutex_.Await(absl::Condition(this, &TrackService::IdleLocked));
}

absl::StatusOr<Engine*> TrackService::AdmitLocked() {
  if (drain_began_) {
    events_.StreamRefused(RefusalReason::kDraining);
    return absl::UnavailableError("the server is shutting down");
  }
  if (engine_ == nullptr) {
    events_.StreamRefused(RefusalReason::kLoading);
    return absl::UnavailableError("the server is still loading its model");
  }
  if (static_cast<int>(live_.size() - retired_.size()) >= options_.max_streams) {
    events_.StreamRefused(RefusalReason::kStreams);
    return OverloadError("streams", absl::StrCat("all ", options_.max_streams, " are open"), kRetryAfter);
  }
  return engine_;
}

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* TrackService::Track(grpc::CallbackServerContext* context) {
  absl::StatusOr<Gatekeeper::Pass> pass = gatekeeper_.Admit(MetadataOf(*context, kAuthorization), context->peer());
  if (!pass.ok()) {
    events_.StreamRefused(absl::IsUnauthenticated(pass.status()) ? RefusalReason::kToken : RefusalReason::kStreams);
    return new RefusedCall(pass.status());
  }
  absl::MutexLock lock(&mutex_);
  const absl::StatusOr<Engine*> engine = AdmitLocked();
  if (!engine.ok()) return new RefusedCall(engine.status());
  auto reactor =
      std::make_unique<TrackReactor>(TrackReactor::Deps{**engine, clock_, events_, log_, options_.stream,
                                                        options_.spans, [this](TrackReactor* done) { Retire(done); }},
                                     *std::move(pass), TraceOf(MetadataOf(*context, kTraceParent)), context);
  TrackReactor* const borrowed = reactor.get();
  live_.emplace(borrowed, std::move(reactor));
  ++alive_;
  return borrowed;
}

grpc::ServerUnaryReactor* TrackService::GetServerInfo(grpc::CallbackServerContext* context,
                                                      const v1::GetServerInfoRequest*,
                                                      v1::GetServerInfoResponse* response) {
  grpc::ServerUnaryReactor* const reactor = context->DefaultReactor();
  if (const auto grant = gatekeeper_.Check(MetadataOf(*context, kAuthorization), context->peer()); !grant.ok()) {
    reactor->Finish(ToGrpcStatus(grant.status()));
    return reactor;
  }
  absl::MutexLock lock(&mutex_);
  if (engine_ == nullptr) {
    reactor->Finish(ToGrpcStatus(absl::UnavailableError("the server is still loading its model")));
    return reactor;
  }
  *response = ToProto(engine_->info());
  response->set_build(std::string(ProgramVersion()));
  reactor->Finish(grpc::Status::OK);
  return reactor;
}

void TrackService::Retire(TrackReactor* reactor) {
  absl::MutexLock lock(&mutex_);
  retired_.push_back(reactor);
  work_.Notify();  // under the lock: once the last reactor is destroyed, so is this service
}

void TrackService::KeepHouse() {
  while (true) {
    work_.WaitFor(kHousekeepingPeriod);
    {
      absl::MutexLock lock(&mutex_);
      if (stopping_) return;
    }
    DestroyRetired();
    CheckStreams();
  }
}

void TrackService::DestroyRetired() {
  std::vector<std::unique_ptr<TrackReactor>> doomed;
  {
    absl::MutexLock lock(&mutex_);
    for (TrackReactor* reactor : retired_) doomed.push_back(std::move(live_.extract(reactor).mapped()));
    retired_.clear();
  }
  const int count = static_cast<int>(doomed.size());
  doomed.clear();  // may block: an engine session waits for the engine to let go of it
  absl::MutexLock lock(&mutex_);
  alive_ -= count;
}

// Only this thread destroys reactors, so that the pointers stay good without the lock.
void TrackService::CheckStreams() {
  std::vector<TrackReactor*> streams;
  absl::Duration draining_for = -absl::InfiniteDuration();  // there is no drain
  const SteadyTime now = clock_.SteadyNow();
  {
    absl::MutexLock lock(&mutex_);
    for (const auto& [reactor, owner] : live_) streams.push_back(reactor);
    if (drain_began_) draining_for = Between(*drain_began_, now);
  }
  for (TrackReactor* stream : streams) {
    stream->CheckTime(now);
    if (draining_for >= absl::ZeroDuration()) DrainStream(*stream, draining_for);
  }
}

void TrackService::DrainStream(TrackReactor& stream, absl::Duration draining_for) const {
  stream.GoingAway(std::max(options_.grace_period - draining_for, absl::ZeroDuration()));
  if (draining_for >= options_.grace_period) stream.Suspend(absl::UnavailableError("the server is shutting down"));
  if (draining_for >= options_.grace_period + kFlushTime) stream.Abort();
}

}  // namespace holdfast
