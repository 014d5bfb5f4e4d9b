// SPDX-License-Identifier: Apache-2.0
// What a training says about itself while it runs, and who listens.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
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

// The loss of a clip and the parts that it is the weighted sum of: tensors where it is computed, numbers in reports.
template <typename T>
struct LossPartsOf {
  T total;
  T distance;
  T objectness;
  T visibility;
  T matching;

  // What 'convert' makes of the total and of each part.
  template <typename Convert>
  auto Map(const Convert& convert) const -> LossPartsOf<decltype(convert(total))> {
    return {convert(total), convert(distance), convert(objectness), convert(visibility), convert(matching)};
  }
};

// Mean over the clips of a step, parts before weighting; NaN where the recipe or the network has no such part.
using LossValues = LossPartsOf<double>;

struct LossColumn {
  const char* name;   // in event files ("loss/<name>") and of the metrics port's label "part"
  const char* key;    // in log.jsonl
  const char* label;  // on the console
  bool always;        // every clip has it: the console shows it even where it is not finite
  double LossValues::*value;
};

// The one list of what the trainer adds up, sends to the other processes and reports; the total comes first. Records
// leave out what is not finite.
inline constexpr std::array<LossColumn, 5> kLossColumns = {{
    {"total", "loss", "loss", true, &LossValues::total},
    {"distance", "distance", "distance", true, &LossValues::distance},
    {"objectness", "objectness", "object", false, &LossValues::objectness},
    {"visibility", "visibility", "visible", false, &LossValues::visibility},
    {"matching", "matching", "match", false, &LossValues::matching},
}};

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
  int64_t skipped_samples = 0;  // damaged ones so far, in all processes of this run
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
