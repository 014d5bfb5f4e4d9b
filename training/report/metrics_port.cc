// SPDX-License-Identifier: Apache-2.0
#include "training/report/metrics_port.h"

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include <cmath>
#include <map>

#include "absl/strings/str_cat.h"
#include "http/http_server.h"

namespace holdfast {
namespace {

class PrometheusTraining : public TrainingMetrics {
 public:
  PrometheusTraining()
      : steps_(Count("holdfast_training_steps_total", "Optimizer steps of this run.")),
        clips_(Count("holdfast_training_clips_total", "Clips trained on, all processes; its rate is samples/s.")),
        skipped_(Count("holdfast_training_skipped_steps_total", "Steps skipped: the gradient was not finite.")),
        data_wait_(Count("holdfast_training_data_wait_seconds_total", "Time spent waiting for clips.")),
        step_time_(Count("holdfast_training_step_seconds_total", "Time spent in steps, waiting included.")),
        step_(Level("holdfast_training_step", "Step the training is at, all runs.")),
        progress_(Level("holdfast_training_progress", "Share of the training done.")),
        rate_(Level("holdfast_training_learning_rate", "Learning rate of the last step.")),
        norm_(Level("holdfast_training_gradient_norm", "Norm of the last gradient before clipping.")),
        samples_(Level("holdfast_training_skipped_samples", "Damaged samples skipped in this run, all processes.")),
        bfloat16_(Level("holdfast_training_bfloat16", "1 while the network runs in bfloat16, 0 in float32.")),
        loss_(prometheus::BuildGauge().Name("holdfast_training_loss").Help("Last step's loss.").Register(registry_)),
        validation_(prometheus::BuildGauge()
                        .Name("holdfast_training_validation")
                        .Help("Metrics of the last validation, percent or pixels.")
                        .Register(registry_)) {}

  absl::Status ServeAt(const std::string& address) {
    auto server = HttpServer::Start(address, {{"/metrics", [this] { return MetricsPage(Text()); }}});
    if (!server.ok()) return server.status();
    server_ = *std::move(server);
    return absl::OkStatus();
  }

  void StepDone(const StepReport& report) override {
    steps_.Increment();
    clips_.Increment(static_cast<double>(report.clips));
    if (report.skipped) skipped_.Increment();
    data_wait_.Increment(absl::ToDoubleSeconds(report.times.data));
    step_time_.Increment(absl::ToDoubleSeconds(report.times.total()));
    step_.Set(static_cast<double>(report.step));
    progress_.Set(report.progress);
    rate_.Set(report.learning_rate);
    norm_.Set(report.gradient_norm);
    samples_.Set(static_cast<double>(report.skipped_samples));
    bfloat16_.Set(report.bfloat16 ? 1 : 0);
    for (const LossColumn& column : kLossColumns) {
      const double value = report.loss.*column.value;
      if (std::isfinite(value)) loss_.Add({{"part", column.name}}).Set(value);
    }
  }

  void Validated(const ValidationReport& report) override {
    for (const MetricColumn& column : MetricColumns()) {
      if (const auto& value = report.metrics.*column.value) validation_.Add({{"metric", column.key}}).Set(*value);
    }
  }

  void Notice(absl::string_view) override {}

  std::string Text() const override { return prometheus::TextSerializer().Serialize(registry_.Collect()); }
  int port() const override { return server_->port(); }

 private:
  prometheus::Counter& Count(const char* name, const char* help) {
    return prometheus::BuildCounter().Name(name).Help(help).Register(registry_).Add({});
  }
  prometheus::Gauge& Level(const char* name, const char* help) {
    return prometheus::BuildGauge().Name(name).Help(help).Register(registry_).Add({});
  }

  prometheus::Registry registry_;
  prometheus::Counter& steps_;
  prometheus::Counter& clips_;
  prometheus::Counter& skipped_;
  prometheus::Counter& data_wait_;
  prometheus::Counter& step_time_;
  prometheus::Gauge& step_;
  prometheus::Gauge& progress_;
  prometheus::Gauge& rate_;
  prometheus::Gauge& norm_;
  prometheus::Gauge& samples_;
  prometheus::Gauge& bfloat16_;
  prometheus::Family<prometheus::Gauge>& loss_;
  prometheus::Family<prometheus::Gauge>& validation_;
  std::unique_ptr<HttpServer> server_;  // last: its thread uses the rest
};

}  // namespace

absl::StatusOr<std::unique_ptr<TrainingMetrics>> TrainingMetrics::Listen(const std::string& address) {
  auto metrics = std::make_unique<PrometheusTraining>();
  if (const absl::Status status = metrics->ServeAt(address); !status.ok()) {
    return absl::Status(status.code(), absl::StrCat("metrics: ", status.message()));
  }
  return metrics;
}

}  // namespace holdfast
