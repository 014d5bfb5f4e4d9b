// SPDX-License-Identifier: Apache-2.0
#include "server/streams/served_streams.h"

#include <algorithm>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/errors.h"
#include "program/flags.h"
#include "proto/convert.h"

namespace holdfast {
namespace {

constexpr absl::Duration kHousekeepingPeriod = absl::Milliseconds(50);
constexpr absl::Duration kFlushTime = absl::Seconds(10);  // after the grace period: for checkpoints to be sent

absl::Status StillLoading() { return absl::UnavailableError("the server is still loading its model"); }

}  // namespace

ServedStreams::ServedStreams(const Options& options, Gatekeeper& gatekeeper, Clock& clock, ServerEvents& events,
                             std::shared_ptr<spdlog::logger> log)
    : options_(options),
      gatekeeper_(gatekeeper),
      clock_(clock),
      events_(events),
      log_(std::move(log)),
      housekeeper_([this] { KeepHouse(); }) {}

ServedStreams::~ServedStreams() {
  {
    absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(this, &ServedStreams::IdleLocked));
    stopping_ = true;
    work_.Notify();
  }
  housekeeper_.join();
}

void ServedStreams::Serve(Engine& engine) {
  absl::MutexLock lock(&mutex_);
  engine_ = &engine;
}

void ServedStreams::Drain() {
  absl::MutexLock lock(&mutex_);
  drain_began_ = clock_.SteadyNow();
  mutex_.Await(absl::Condition(this, &ServedStreams::IdleLocked));
}

void ServedStreams::Abort() {
  absl::MutexLock lock(&mutex_);
  aborting_ = true;
  work_.Notify();
  mutex_.Await(absl::Condition(this, &ServedStreams::IdleLocked));
}

absl::StatusOr<Engine*> ServedStreams::AdmitLocked() {
  if (drain_began_ || aborting_) {
    events_.StreamRefused(RefusalReason::kDraining);
    return absl::UnavailableError("the server is shutting down");
  }
  if (engine_ == nullptr) {
    events_.StreamRefused(RefusalReason::kLoading);
    return StillLoading();
  }
  if (FullLocked()) {
    events_.StreamRefused(RefusalReason::kStreams);
    return OverloadError("streams", absl::StrCat("all ", options_.max_streams, " are open"), kRetryAfter);
  }
  if (absl::Status status = engine_->CheckPlaces(); !status.ok()) return status;
  return engine_;
}

absl::StatusOr<LiveStream*> ServedStreams::Open(const Caller& caller, absl::string_view system, Maker make) {
  absl::StatusOr<Gatekeeper::Pass> pass = gatekeeper_.Admit(caller.authorization, caller.peer);
  if (!pass.ok()) {
    events_.StreamRefused(absl::IsUnauthenticated(pass.status()) ? RefusalReason::kToken : RefusalReason::kCaller);
    return pass.status();
  }
  absl::MutexLock lock(&mutex_);
  const absl::StatusOr<Engine*> engine = AdmitLocked();
  if (!engine.ok()) return engine.status();
  std::unique_ptr<LiveStream> stream =
      make(ServedStream::Deps{**engine, clock_, events_, log_, options_.stream, options_.spans, system},
           *std::move(pass), (*engine)->limits().max_points);
  LiveStream* const borrowed = stream.get();
  live_.emplace(borrowed, std::move(stream));
  ++alive_;
  return borrowed;
}

void ServedStreams::Retire(LiveStream* stream) {
  absl::MutexLock lock(&mutex_);
  retired_.push_back(stream);
  work_.Notify();  // under the lock: once the last stream is destroyed, so is this object
}

absl::StatusOr<v1::GetServerInfoResponse> ServedStreams::Info(const Caller& caller) {
  if (const auto grant = gatekeeper_.Check(caller.authorization, caller.peer); !grant.ok()) return grant.status();
  absl::MutexLock lock(&mutex_);
  if (engine_ == nullptr) return StillLoading();
  v1::GetServerInfoResponse response = ToProto(engine_->info());
  response.set_build(std::string(ProgramVersion()));
  return response;
}

void ServedStreams::KeepHouse() {
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

void ServedStreams::DestroyRetired() {
  std::vector<std::unique_ptr<LiveStream>> doomed;
  {
    absl::MutexLock lock(&mutex_);
    for (LiveStream* stream : retired_) doomed.push_back(std::move(live_.extract(stream).mapped()));
    retired_.clear();
  }
  const int count = static_cast<int>(doomed.size());
  doomed.clear();  // may block: an engine session waits for the engine to let go of it
  absl::MutexLock lock(&mutex_);
  alive_ -= count;
}

// Only this thread destroys streams, so that the pointers stay good without the lock.
void ServedStreams::CheckStreams() {
  std::vector<LiveStream*> streams;
  absl::Duration draining_for = -absl::InfiniteDuration();  // there is no drain
  bool aborting = false;
  bool full = false;
  const SteadyTime now = clock_.SteadyNow();
  {
    absl::MutexLock lock(&mutex_);
    for (const auto& [stream, owner] : live_) streams.push_back(stream);
    if (drain_began_) draining_for = Between(*drain_began_, now);
    aborting = aborting_;
    full = FullLocked();
  }
  for (LiveStream* live : streams) {
    ServedStream& stream = live->stream();
    stream.CheckTime(now, full);
    if (draining_for >= absl::ZeroDuration()) DrainStream(stream, draining_for);
    if (aborting) stream.Abort();
  }
}

void ServedStreams::DrainStream(ServedStream& stream, absl::Duration draining_for) const {
  stream.GoingAway(std::max(options_.grace_period - draining_for, absl::ZeroDuration()));
  if (draining_for >= options_.grace_period) stream.Suspend(absl::UnavailableError("the server is shutting down"));
  if (draining_for >= options_.grace_period + kFlushTime) stream.Abort();
}

}  // namespace holdfast
