// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "api/clock.h"
#include "server/engine/batcher.h"
#include "server/engine/metrics.h"
#include "server/engine/session.h"
#include "server/engine/tracker_model.h"
#include "server/engine/work_meter.h"

namespace holdfast {

// The one thread that computes. It takes turns: a batch of frames to encode, a batch of rows to refine, each shared
// fairly among the sessions that have work and begun by another session each time, so that none waits longer than a
// round of batches however much the others have. Owned by the engine; destruction closes the sessions that are left.
class Scheduler {
 public:
  struct Options {
    int64_t max_batch_frames = 4;
    int64_t max_batch_rows = 256;
    double least_step = 0;  // as in TrackerModel::RefineOptions
  };
  // All must outlive the scheduler.
  struct Deps {
    TrackerModel& model;
    WorkMeter& meter;
    Clock& clock;
    EngineMetrics& metrics;
  };
  Scheduler(const Options& options, const Deps& deps);
  ~Scheduler();

  // Any thread.
  void Add(std::shared_ptr<Session> session) ABSL_LOCKS_EXCLUDED(mutex_);
  // A session has something new.
  void Notify() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  using Sessions = std::vector<std::shared_ptr<Session>>;

  void Run();
  bool AwaitWork() ABSL_LOCKS_EXCLUDED(mutex_);
  // True: there may be more to do at once.
  bool TakeTurn();
  bool EncodeBatch();
  bool RefineBatch();
  void Admit(const FrameBatch& batch, std::vector<FrameFeaturesPtr> features);
  void Apply(const RowBatch& batch, std::vector<RowEstimate> estimates);
  // What is thrown, by the network or for want of memory, ends the sessions it was done for, and no others.
  void RunFor(const std::vector<Session*>& affected, const std::function<void()>& work);
  // The sessions, beginning with the one whose turn it is.
  std::vector<Session*> InTurn(size_t turn) const;
  // The turn after the session that began a batch.
  size_t TurnAfter(const Session* first) const;
  void DropClosed();

  const Options options_;
  TrackerModel& model_;
  WorkMeter& meter_;
  Clock& clock_;
  EngineMetrics& metrics_;

  // Compute thread only.
  Sessions sessions_;
  size_t encode_turn_ = 0;
  size_t refine_turn_ = 0;

  absl::Mutex mutex_;
  absl::CondVar changed_;
  Sessions arrivals_ ABSL_GUARDED_BY(mutex_);
  bool work_ ABSL_GUARDED_BY(mutex_) = false;
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace holdfast
