// SPDX-License-Identifier: Apache-2.0
#include "training/report/log_files.h"

#include <fcntl.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <system_error>
#include <tuple>
#include <utility>

#include "absl/strings/str_cat.h"
#include "training/report/event_file.h"

namespace holdfast {
namespace {

double Seconds(absl::Time time) { return absl::ToDoubleSeconds(time - absl::UnixEpoch()); }

// A file of records that is only ever appended to; the first failure is reported, later ones are not.
class AppendOnlyFile {
 public:
  explicit AppendOnlyFile(const std::string& path)
      : path_(path), fd_(::open(path.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0666)) {}
  ~AppendOnlyFile() {
    if (is_open()) ::close(fd_);
  }
  AppendOnlyFile(const AppendOnlyFile&) = delete;
  AppendOnlyFile& operator=(const AppendOnlyFile&) = delete;

  bool is_open() const { return fd_ >= 0; }

  // The whole record or nothing of it: a half would spoil the one that is written when there is room again.
  void Append(absl::string_view record) {
    const off_t end = ::lseek(fd_, 0, SEEK_END);
    const ssize_t written = ::write(fd_, record.data(), record.size());
    if (written == static_cast<ssize_t>(record.size())) return;
    if (written > 0) std::ignore = ::ftruncate(fd_, end);  // what else could be done?
    if (!std::exchange(failed_, true)) std::cerr << "cannot write to " << path_ << ": lines are missing there\n";
  }

 private:
  const std::string path_;
  const int fd_;
  bool failed_ = false;
};

void AddFinite(nlohmann::json& object, const char* key, double value) {
  if (std::isfinite(value)) object[key] = value;
}

nlohmann::json StepJson(const StepReport& report) {
  nlohmann::json line = {{"event", "step"},
                         {"time", Seconds(report.when)},
                         {"step", report.step},
                         {"progress", report.progress},
                         {"elapsed_s", absl::ToDoubleSeconds(report.elapsed)},
                         {"lr", report.learning_rate},
                         {"clips", report.clips},
                         {"skipped", report.skipped},
                         {"skipped_steps", report.skipped_steps},
                         {"skipped_samples", report.skipped_samples}};
  AddFinite(line, "gradient_norm", report.gradient_norm);
  for (const LossColumn& column : kLossColumns) AddFinite(line, column.key, report.loss.*column.value);
  const StepTimes& times = report.times;
  line["seconds"] = {
      {"data", absl::ToDoubleSeconds(times.data)},     {"encode", absl::ToDoubleSeconds(times.encode)},
      {"refine", absl::ToDoubleSeconds(times.refine)}, {"backward", absl::ToDoubleSeconds(times.backward)},
      {"update", absl::ToDoubleSeconds(times.update)}, {"total", absl::ToDoubleSeconds(times.total())}};
  return line;
}

class JsonLog : public TrainingObserver {
 public:
  explicit JsonLog(const std::string& path) : file_(path) {}
  bool is_open() const { return file_.is_open(); }

  void StepDone(const StepReport& report) override { Write(StepJson(report)); }

  void Validated(const ValidationReport& report) override {
    nlohmann::json line = {{"event", "validation"},
                           {"time", Seconds(report.when)},
                           {"step", report.step},
                           {"took_s", absl::ToDoubleSeconds(report.took)},
                           {"best", report.best}};
    for (const MetricColumn& column : MetricColumns()) {
      if (report.metrics.*column.value) line[column.key] = *(report.metrics.*column.value);
    }
    Write(line);
  }

  void Notice(absl::string_view text) override { Write({{"event", "notice"}, {"text", std::string(text)}}); }

 private:
  void Write(const nlohmann::json& line) {
    file_.Append(line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
  }

  AppendOnlyFile file_;
};

class EventLog : public TrainingObserver {
 public:
  EventLog(const std::string& path, absl::Time now) : file_(path) {
    file_.Append(FrameRecord(EncodeVersionEvent(Seconds(now))));
  }
  bool is_open() const { return file_.is_open(); }

  void StepDone(const StepReport& report) override {
    Scalars scalars = {{"train/learning_rate", report.learning_rate},
                       {"train/seconds_per_step", absl::ToDoubleSeconds(report.times.total())},
                       {"train/data_wait_seconds", absl::ToDoubleSeconds(report.times.data)},
                       {"train/skipped_steps", static_cast<float>(report.skipped_steps)}};
    const auto add = [&](const std::string& tag, double value) {
      if (std::isfinite(value)) scalars.emplace_back(tag, value);
    };
    add("train/gradient_norm", report.gradient_norm);
    for (const LossColumn& column : kLossColumns) {
      add(absl::StrCat("loss/", column.name), report.loss.*column.value);
    }
    Write(report.when, report.step, scalars);
  }

  void Validated(const ValidationReport& report) override {
    Scalars scalars;
    for (const MetricColumn& column : MetricColumns()) {
      if (const auto& value = report.metrics.*column.value) {
        scalars.emplace_back(absl::StrCat("validation/", column.key), *value);
      }
    }
    Write(report.when, report.step, scalars);
  }

  void Notice(absl::string_view) override {}

 private:
  void Write(absl::Time when, int64_t step, const Scalars& scalars) {
    file_.Append(FrameRecord(EncodeScalarEvent(Seconds(when), step, scalars)));
  }

  AppendOnlyFile file_;
};

template <typename Log, typename... Args>
absl::StatusOr<std::unique_ptr<TrainingObserver>> Open(const std::string& path, Args... args) {
  auto log = std::make_unique<Log>(path, args...);
  if (!log->is_open()) return absl::PermissionDeniedError(absl::StrCat("cannot write to ", path));
  return log;
}

}  // namespace

absl::StatusOr<std::unique_ptr<TrainingObserver>> OpenJsonLog(const std::string& path) { return Open<JsonLog>(path); }

absl::StatusOr<std::unique_ptr<TrainingObserver>> OpenEventLog(const std::string& directory, absl::Time now) {
  std::error_code error;
  std::filesystem::create_directories(directory, error);
  const std::string name =
      absl::StrCat("events.out.tfevents.", absl::ToUnixSeconds(now), ".holdfast.", static_cast<int64_t>(getpid()));
  return Open<EventLog>(absl::StrCat(directory, "/", name), now);
}

}  // namespace holdfast
