// SPDX-License-Identifier: Apache-2.0
#include "server/engine/work_meter.h"

#include <cmath>
#include <limits>

namespace holdfast {
namespace {

// A busy neighbour is noticed within seconds and forgotten half a minute after it has gone.
constexpr absl::Duration kHalfLife = absl::Seconds(10);
// So many seconds of batches as at warm-up stand against what was measured since: a first slow batch says little.
constexpr double kPrior = 0.5;

}  // namespace

WorkMeter::WorkMeter(const Options& options, const Clock& clock, EngineMetrics& metrics)
    : options_(options),
      unit_(options.costs.row * options.iterations / options.hop_frames),
      clock_(clock),
      metrics_(metrics),
      last_(clock.SteadyNow()) {
  metrics_.WorkBudget(QuietBudget());
}

WorkMeter::FrameWork WorkMeter::Of(const SessionAccepted& session) const {
  if (unit_ <= 0) return {};
  const WorkCosts& costs = options_.costs;
  const double runs = static_cast<double>(session.iterations) / session.hop_frames;  // iterations a frame
  const double frame = static_cast<double>(Pixels(session.processing_size)) * costs.pixel + runs * costs.batch;
  return {frame / unit_, runs * costs.row / unit_};
}

double WorkMeter::QuietBudget() const {
  if (unit_ <= 0 || options_.max_load <= 0) return std::numeric_limits<double>::infinity();
  return options_.max_load / unit_;
}

double WorkMeter::Budget() const {
  absl::MutexLock lock(&mutex_);
  return BudgetLocked(clock_.SteadyNow());
}

double WorkMeter::BudgetLocked(SteadyTime now) const {
  const double remains = Remains(now);
  return QuietBudget() * (kPrior + expected_ * remains) / (kPrior + took_ * remains);
}

void WorkMeter::Encoded(int64_t pixels, absl::Duration took) {
  Add(static_cast<double>(pixels) * options_.costs.pixel, took);
}

void WorkMeter::Refined(int64_t rows, int iterations, absl::Duration took) {
  Add(iterations * (options_.costs.batch + static_cast<double>(rows) * options_.costs.row), took);
}

void WorkMeter::Add(double expected, absl::Duration took) {
  absl::MutexLock lock(&mutex_);
  const SteadyTime now = clock_.SteadyNow();
  const double remains = Remains(now);
  expected_ = expected_ * remains + expected;
  took_ = took_ * remains + absl::ToDoubleSeconds(took);
  last_ = now;
  metrics_.WorkBudget(BudgetLocked(now));
}

double WorkMeter::Remains(SteadyTime now) const {
  return std::exp2(-absl::FDivDuration(Between(last_, now), kHalfLife));
}

}  // namespace holdfast
