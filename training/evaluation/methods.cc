// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/methods.h"

#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "api/clock.h"
#include "server/engine/local_tracker.h"
#include "server/engine/metrics.h"
#include "training/evaluation/calibrating_clip_tracker.h"
#include "training/evaluation/lk_baseline.h"
#include "training/evaluation/stream_clip_tracker.h"

namespace holdfast {
namespace {

std::string NetworkName(const TrackerInfo& info, const EngineOptions& engine) {
  const bool published = engine.chaining == Chaining::kPublished;
  return absl::StrCat("holdfast ", info.model_name, " (preset ", info.preset, ", weights ",
                      info.weights_sha256.substr(0, 12), ", ", info.default_iterations, " iterations, hop ",
                      info.default_hop_frames, published ? ", published chaining, " : ", ",
                      published || engine.least_step <= 0 ? "" : absl::StrCat("least step ", engine.least_step, ", "),
                      info.default_motion_prior ? "motion prior, " : "", info.default_polish ? "polish, " : "",
                      info.precision, " on ", info.device, ")");
}

// Of the windows that were refined since it was asked before.
class IterationCount final : public NullEngineMetrics {
 public:
  void BatchRefined(absl::Span<const int> iterations) override ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    windows_ += static_cast<int64_t>(iterations.size());
    for (const int taken : iterations) taken_ += taken;
  }

  std::optional<double> TakeMean() ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    const int64_t windows = std::exchange(windows_, 0), taken = std::exchange(taken_, 0);
    if (windows == 0) return std::nullopt;
    return static_cast<double>(taken) / static_cast<double>(windows);
  }

 private:
  absl::Mutex mutex_;
  int64_t windows_ ABSL_GUARDED_BY(mutex_) = 0;
  int64_t taken_ ABSL_GUARDED_BY(mutex_) = 0;
};

class Methods final : public EvaluationMethods {
 public:
  explicit Methods(const EvaluationMethodsOptions& options) : options_(options) {
    if (options_.calibrate) options_.engine.evidence = evidence_.Sink();
  }

  absl::Status Load() {
    if (options_.engine.weights_path.empty()) return absl::OkStatus();
    absl::StatusOr<std::unique_ptr<Engine>> engine = Engine::Create(options_.engine, clock_, metrics_);
    if (!engine.ok()) return engine.status();
    engine_ = *std::move(engine);
    tracker_ = std::make_unique<LocalTracker>(*engine_);
    return absl::OkStatus();
  }

  absl::StatusOr<std::vector<std::unique_ptr<ClipTracker>>> At(ImageSize processing_size) override {
    std::vector<std::unique_ptr<ClipTracker>> methods;
    if (tracker_ != nullptr) {
      StreamClipTrackerOptions options;
      options.name = NetworkName(engine_->info(), options_.engine);
      options.processing_size = processing_size;
      options.iterations_taken = [this] { return metrics_.TakeMean(); };
      methods.push_back(std::make_unique<StreamClipTracker>(*tracker_, options));
      if (options_.calibrate) {
        methods.back() = std::make_unique<CalibratingClipTracker>(std::move(methods.back()), evidence_, judged_);
      }
    }
    if (options_.lucas_kanade) {
      absl::StatusOr<std::unique_ptr<ClipTracker>> baseline = CreateLucasKanade({});
      if (!baseline.ok()) return baseline.status();
      methods.push_back(*std::move(baseline));
    }
    return methods;
  }

  const std::vector<Judged>& judged() const override { return judged_; }

 private:
  EvaluationMethodsOptions options_;
  EvidenceLog evidence_;
  std::vector<Judged> judged_;
  SystemClock clock_;
  IterationCount metrics_;
  std::unique_ptr<Engine> engine_;  // null without weights
  std::unique_ptr<LocalTracker> tracker_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<EvaluationMethods>> EvaluationMethods::Create(const EvaluationMethodsOptions& options) {
  if (options.engine.weights_path.empty() && !options.lucas_kanade) {
    return absl::InvalidArgumentError("nothing to evaluate: give weights, a baseline or both");
  }
  auto methods = std::make_unique<Methods>(options);
  if (absl::Status loaded = methods->Load(); !loaded.ok()) return loaded;
  return methods;
}

}  // namespace holdfast
