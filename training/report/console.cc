// SPDX-License-Identifier: Apache-2.0
#include "training/report/console.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace holdfast {
namespace {

std::string Remaining(const StepReport& report) {
  if (report.progress <= 0) return "";
  const absl::Duration left = report.elapsed * (1 / report.progress - 1);
  return absl::StrCat(", ", absl::FormatDuration(absl::Trunc(left, absl::Seconds(1))), " left");
}

// "loss 1.500 (distance 1.250, visible 0.500)": the total, and in brackets the parts that there are.
std::string LossText(const LossValues& loss) {
  std::vector<std::string> parts;
  for (const LossColumn& column : kLossColumns) {
    const double value = loss.*column.value;
    if (column.always || std::isfinite(value)) parts.push_back(absl::StrFormat("%s %.3f", column.label, value));
  }
  return absl::StrCat(parts.front(), " (", absl::StrJoin(parts.begin() + 1, parts.end(), ", "), ")");
}

std::string StepLine(const StepReport& report) {
  std::string line = absl::StrCat("step ", report.step);
  if (report.steps > 0) absl::StrAppend(&line, "/", report.steps);
  const double seconds = absl::ToDoubleSeconds(report.times.total());
  absl::StrAppendFormat(&line, "  %s  lr %.2e  %.2f s/step, data %.0f%%%s", LossText(report.loss), report.learning_rate,
                        seconds, seconds > 0 ? 100 * absl::ToDoubleSeconds(report.times.data) / seconds : 0.0,
                        Remaining(report));
  if (report.skipped_samples > 0) absl::StrAppend(&line, "  ", report.skipped_samples, " damaged samples skipped");
  if (report.skipped) absl::StrAppend(&line, "  SKIPPED: not finite");
  return line;
}

class Console : public TrainingObserver {
 public:
  Console(std::ostream& out, const ConsoleOptions& options) : out_(out), options_(options) {}

  void StepDone(const StepReport& report) override {
    if (options_.terminal) {
      out_ << "\r\033[K" << ProgressBar(report.progress, 20) << ' ' << StepLine(report) << std::flush;
      bar_shown_ = true;
    } else if (report.step % options_.lines_every == 0 || report.step == 1 || report.skipped) {
      out_ << StepLine(report) << std::endl;
    }
  }

  void Validated(const ValidationReport& report) override {
    std::string line = absl::StrCat("validation at step ", report.step, ":");
    for (const MetricColumn& column : MetricColumns()) {
      const auto& value = report.metrics.*column.value;
      if (value) absl::StrAppendFormat(&line, "  %s %.1f", column.header, *value);
    }
    if (report.best) absl::StrAppend(&line, "  (best)");
    Notice(line);
  }

  void Notice(absl::string_view text) override {
    if (bar_shown_) out_ << "\r\033[K";
    bar_shown_ = false;
    out_ << text << std::endl;
  }

 private:
  std::ostream& out_;
  const ConsoleOptions options_;
  bool bar_shown_ = false;
};

}  // namespace

std::unique_ptr<TrainingObserver> MakeConsole(std::ostream& out, const ConsoleOptions& options) {
  return std::make_unique<Console>(out, options);
}

std::string ProgressBar(double share, int width) {
  const int full = static_cast<int>(std::lround(std::clamp(share, 0.0, 1.0) * width));
  return absl::StrCat("[", std::string(full, '#'), std::string(width - full, '.'), "]");
}

}  // namespace holdfast
