// SPDX-License-Identifier: Apache-2.0
#include "server/health_service.h"

#include <optional>

namespace holdfast {
namespace {

// HealthCheckResponse: its field 1 is the status, 1 for SERVING and 2 for NOT_SERVING.
grpc::ByteBuffer Response(bool serving) {
  const grpc::Slice bytes(serving ? "\x08\x01" : "\x08\x02");
  return grpc::ByteBuffer(&bytes, 1);
}

}  // namespace

// Hears of each change until it cancels; of those that come while it does not read, of the last one.
class HealthService::Watcher final : public Reactor {
 public:
  explicit Watcher(HealthService& health) : health_(health) {}

  void TellLocked() {
    health_.mutex_.AssertHeld();  // by the service too, whose own mutex the analysis takes for another one
    if (writing_ || ended_ || told_ == health_.serving_) return;
    told_ = health_.serving_;
    writing_ = true;
    response_ = Response(health_.serving_);
    StartWrite(&response_);
  }

  void OnWriteDone(bool) override {
    const absl::MutexLock lock(&health_.mutex_);
    writing_ = false;
    TellLocked();
  }

  void OnCancel() override {
    const absl::MutexLock lock(&health_.mutex_);
    ended_ = true;
    Finish(grpc::Status::CANCELLED);
  }

  void OnDone() override {
    {
      const absl::MutexLock lock(&health_.mutex_);
      health_.watchers_.erase(this);
    }
    delete this;  // owned by the call
  }

 private:
  HealthService& health_;
  grpc::ByteBuffer response_;  // gRPC's while it is written
  bool writing_ ABSL_GUARDED_BY(health_.mutex_) = false;
  bool ended_ ABSL_GUARDED_BY(health_.mutex_) = false;
  std::optional<bool> told_ ABSL_GUARDED_BY(health_.mutex_);
};

HealthService::HealthService() {
  AddCall("/grpc.health.v1.Health/Check", [this](auto*) { return Check(); });
  AddCall("/grpc.health.v1.Health/Watch", [this](auto*) { return Watch(); });
}

void HealthService::Set(bool serving) {
  const absl::MutexLock lock(&mutex_);
  serving_ = serving;
  for (Watcher* watcher : watchers_) watcher->TellLocked();
}

UnreadService::Reactor* HealthService::Check() {
  const absl::MutexLock lock(&mutex_);
  return new AnsweredCall(Response(serving_));
}

UnreadService::Reactor* HealthService::Watch() {
  const absl::MutexLock lock(&mutex_);
  if (watchers_.size() >= kMaxWatchers) {
    return new RefusedCall({grpc::StatusCode::RESOURCE_EXHAUSTED, "as many watch as may"});
  }
  auto* const watcher = new Watcher(*this);
  watchers_.insert(watcher);
  watcher->TellLocked();
  return watcher;
}

}  // namespace holdfast
