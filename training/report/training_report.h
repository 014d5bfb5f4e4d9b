// SPDX-License-Identifier: Apache-2.0
// What a training says about itself while it runs, and who listens.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "training/evaluation/metrics.h"

namespace holdfast {

// Where the time of a step went. On devices that work asynchronously only the sum is exact.
struct StepTimes {
  absl::Duration data;    // waiting for clips
  absl::Duration encode;  // frames to maps, forward
  absl::Duration refine;  // iterations and losses, forward
  absl::Duration backward;
  absl::Duration update;  // exchange between processes, clipping, optimizer, average
  absl::Duration total() const { return data + encode + refine + backward + update; }
};

// Mean over the clips of a step, before weighting; NaN where the recipe or the network has no such part.
struct LossValues {
  double total;
  double distance;
  double objectness;
  double visibility;
  double matching;
};

struct StepReport {
  int64_t step = 0;        // 1 for the first
  int64_t steps = 0;       // planned; 0: the time decides
  double progress = 0;     // share of the training done after this step
  absl::Time when;         // by the wall clock
  absl::Duration elapsed;  // of training, over all runs
  double learning_rate = 0;
  double gradient_norm = 0;     // before clipping
  bool skipped = false;         // the gradient was not finite: the weights are as before
  bool bfloat16 = false;        // the network ran in bfloat16
  int64_t clips = 0;            // in this step, all processes
  int64_t skipped_steps = 0;    // so far
  int64_t skipped_samples = 0;  // damaged ones so far, this process and run
  LossValues loss;
  StepTimes times;
};

struct ValidationReport {
  int64_t step = 0;
  absl::Time when;  // by the wall clock
  absl::Duration took;
  Metrics metrics;
  bool best = false;  // so far
};

// One thread calls. Implementations do not throw and do not fail: a log that cannot be written says so once, on
// standard error, and the training goes on.
class TrainingObserver {
 public:
  virtual ~TrainingObserver() = default;
  virtual void StepDone(const StepReport& report) = 0;
  virtual void Validated(const ValidationReport& report) = 0;
  virtual void Notice(absl::string_view text) = 0;  // one line for people
};

// Passes every event on to each of its observers.
class ObserverList : public TrainingObserver {
 public:
  void Add(std::unique_ptr<TrainingObserver> observer) { observers_.push_back(std::move(observer)); }

  void StepDone(const StepReport& report) override {
    for (const auto& observer : observers_) observer->StepDone(report);
  }
  void Validated(const ValidationReport& report) override {
    for (const auto& observer : observers_) observer->Validated(report);
  }
  void Notice(absl::string_view text) override {
    for (const auto& observer : observers_) observer->Notice(text);
  }

 private:
  std::vector<std::unique_ptr<TrainingObserver>> observers_;
};

}  // namespace holdfast
