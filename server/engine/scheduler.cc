// SPDX-License-Identifier: Apache-2.0
#include "server/engine/scheduler.h"

#include <algorithm>
#include <utility>

#include "absl/status/status.h"
#include "server/engine/input/long_slices.h"
#include "server/engine/status_of.h"

namespace holdfast {
namespace {

template <typename Batch>
std::vector<Session*> SessionsOf(const Batch& batch) {
  std::vector<Session*> sessions;
  for (const auto& part : batch.parts) sessions.push_back(part.session);
  return sessions;
}

std::vector<int> IterationsOf(const std::vector<RowEstimate>& estimates) {
  std::vector<int> iterations;
  iterations.reserve(estimates.size());
  for (const RowEstimate& estimate : estimates) iterations.push_back(estimate.iterations);
  return iterations;
}

}  // namespace

Scheduler::Scheduler(const Options& options, const Deps& deps)
    : options_(options),
      model_(deps.model),
      meter_(deps.meter),
      clock_(deps.clock),
      metrics_(deps.metrics),
      thread_([this] { Run(); }) {}

Scheduler::~Scheduler() {
  {
    absl::MutexLock lock(&mutex_);
    stopped_ = true;
    changed_.SignalAll();
  }
  thread_.join();
}

void Scheduler::Add(std::shared_ptr<Session> session) {
  absl::MutexLock lock(&mutex_);
  arrivals_.push_back(std::move(session));
}

void Scheduler::Notify() {
  absl::MutexLock lock(&mutex_);
  work_ = true;
  changed_.Signal();
}

void Scheduler::Run() {
  RunInLongSlices();
  model_.PrepareThread();
  while (AwaitWork()) {
    while (TakeTurn()) {
    }
  }
  for (const auto& session : sessions_) session->Close(absl::CancelledError("the engine stops"));
}

bool Scheduler::AwaitWork() {
  absl::MutexLock lock(&mutex_);
  while (!work_ && !stopped_) changed_.Wait(&mutex_);
  work_ = false;
  return !stopped_;
}

// A turn encodes one batch and refines one, whatever is waiting: neither the frames of one session nor the windows of
// another can keep the others from their turn, and what has arrived meanwhile is seen after two batches at most.
bool Scheduler::TakeTurn() {
  {
    absl::MutexLock lock(&mutex_);
    if (stopped_) return false;
    for (auto& session : arrivals_) sessions_.push_back(std::move(session));
    arrivals_.clear();
  }
  for (const auto& session : sessions_) {
    RunFor({session.get()}, [&] { session->ApplyOps(model_); });
  }
  bool busy = false;
  RunFor(InTurn(0), [&] {
    busy = EncodeBatch();
    busy = RefineBatch() || busy;
  });
  int64_t cached = 0;
  for (const auto& session : sessions_) {
    RunFor({session.get()}, [&] { busy = session->FinishTurn(model_) || busy; });
    cached += session->CachedBytes();
  }
  metrics_.CacheBytes(cached);
  DropClosed();
  return busy;
}

// Which session leads a batch moves on by one each time, so that each leads in its turn even where one could fill every
// batch alone. RefineBatch does the same with an order of its own.
bool Scheduler::EncodeBatch() {
  FrameBatch batch = TakeFrameBatch(InTurn(encode_turn_), options_.max_batch_frames);
  if (batch.parts.empty()) return false;
  encode_turn_ = TurnAfter(batch.parts.front().session);
  RunFor(SessionsOf(batch), [&] {
    std::vector<const RgbImage*> images;
    for (const auto& part : batch.parts) {
      for (const DecodedFrame& frame : part.frames) images.push_back(&frame.image);
    }
    const SteadyTime begin = clock_.SteadyNow();
    auto features = model_.Encode(images);
    const SteadyTime end = clock_.SteadyNow();
    const absl::Duration took = Between(begin, end);
    metrics_.StageTook(Stage::kEncode, took);
    for (const auto& part : batch.parts) part.session->TellEncoded(part.frames, begin, end);
    meter_.Encoded(static_cast<int64_t>(images.size()) * Pixels(images.front()->size), took);
    Admit(batch, std::move(features));
  });
  return true;
}

void Scheduler::Admit(const FrameBatch& batch, std::vector<FrameFeaturesPtr> features) {
  size_t next = 0;
  for (const auto& part : batch.parts) {
    for (const DecodedFrame& frame : part.frames) part.session->Admit(frame, std::move(features[next++]), model_);
  }
}

bool Scheduler::RefineBatch() {
  RowBatch batch = MakeRowBatch(InTurn(refine_turn_), options_.max_batch_rows);
  if (batch.parts.empty()) return false;
  refine_turn_ = TurnAfter(batch.parts.front().session);
  RunFor(SessionsOf(batch), [&] {
    const bool carry = batch.parts.front().session->options().carry_templates;
    const SteadyTime begin = clock_.SteadyNow();
    auto estimates = model_.Refine(batch.groups, {batch.iterations, carry, carry ? 0 : options_.least_step});
    const SteadyTime end = clock_.SteadyNow();
    const absl::Duration took = Between(begin, end);
    metrics_.StageTook(Stage::kRefine, took);
    for (const auto& part : batch.parts) part.session->TellRefined(part.rows, begin, end);
    meter_.Refined(batch.rows, batch.iterations, took);
    metrics_.BatchRefined(IterationsOf(estimates));
    Apply(batch, std::move(estimates));
  });
  return true;
}

void Scheduler::Apply(const RowBatch& batch, std::vector<RowEstimate> estimates) {
  size_t next = 0;
  for (const auto& part : batch.parts) {
    part.session->Apply(part.rows, &estimates[next]);
    next += part.rows.size();
  }
}

void Scheduler::RunFor(const std::vector<Session*>& affected, const std::function<void()>& work) {
  const absl::Status status = StatusOf(work, "the network failed");
  if (status.ok()) return;
  for (Session* session : affected) session->Close(status);
}

std::vector<Session*> Scheduler::InTurn(size_t turn) const {
  std::vector<Session*> sessions;
  for (size_t i = 0; i < sessions_.size(); ++i) {
    Session* session = sessions_[(turn + i) % sessions_.size()].get();
    if (!session->done() && !session->inbox().cancelled()) sessions.push_back(session);
  }
  return sessions;
}

size_t Scheduler::TurnAfter(const Session* first) const {
  const auto it = std::find_if(sessions_.begin(), sessions_.end(),
                               [first](const std::shared_ptr<Session>& session) { return session.get() == first; });
  return static_cast<size_t>(it - sessions_.begin()) + 1;
}

void Scheduler::DropClosed() {
  sessions_.erase(std::remove_if(sessions_.begin(), sessions_.end(),
                                 [](const std::shared_ptr<Session>& session) { return session->done(); }),
                  sessions_.end());
}

}  // namespace holdfast
