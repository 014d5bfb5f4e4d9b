// SPDX-License-Identifier: Apache-2.0
// holdfast-eval: how well weights track, through the engine that serves them, beside a baseline and the paper.
#include <unistd.h>

#include <cstdlib>
#include <iostream>
#include <memory>
#include <opencv2/core/utility.hpp>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "api/clock.h"
#include "io/atomic_file.h"
#include "model/checkpoint/metadata.h"
#include "program/flags.h"
#include "program/network_process.h"
#include "training/evaluation/evaluator.h"
#include "training/evaluation/flags.h"
#include "training/evaluation/report.h"
#include "training/evaluation/suite.h"

namespace holdfast {
namespace {

constexpr Program kProgram = {"holdfast-eval",
                              "holdfast-eval --data=DIR --format=FORMAT --weights=FILE [--baseline=lk] [--json=FILE]\n"
                              "holdfast-eval --format=synthetic --count=N --seed=S --weights=FILE\n"
                              "holdfast-eval --suite=paper --data=DIR --weights=FILE\n"
                              "holdfast-eval --format=synthetic --weights=FILE --calibrate=FILE\n\n"
                              "Prints delta, survival, MTE, OA and AJ of every sequence and their mean, and how far "
                              "confidence is to be trusted. Distances are pixels of a 256x256 frame."};

constexpr int kFailure = 1;
constexpr int kUsageError = 2;

void ShowProgress(size_t index, size_t size) {
  const bool terminal = isatty(STDERR_FILENO) != 0;
  std::cerr << (terminal ? "\r\033[K" : "") << "sequence " << index + 1 << " of " << size << (terminal ? "" : "\n")
            << std::flush;
}

absl::StatusOr<std::vector<Report>> EvaluateData(EvaluationDataOptions data, ImageSize processing_size,
                                                 EvaluationMethods& methods) {
  data.crohd_size = processing_size;
  absl::StatusOr<std::unique_ptr<Dataset>> dataset = OpenEvaluationData(data);
  if (!dataset.ok()) return dataset.status();
  absl::StatusOr<std::vector<std::unique_ptr<ClipTracker>>> trackers = methods.At(processing_size);
  if (!trackers.ok()) return trackers.status();
  std::vector<ClipTracker*> borrowed;
  for (const std::unique_ptr<ClipTracker>& tracker : *trackers) borrowed.push_back(tracker.get());
  EvaluationOptions options;
  options.progress = ShowProgress;
  absl::StatusOr<std::vector<Report>> reports = Evaluate(**dataset, borrowed, options, SystemClock());
  if (isatty(STDERR_FILENO) != 0) std::cerr << "\r\033[K";
  return reports;
}

absl::StatusOr<std::vector<Report>> EvaluateSuite(const EvaluateRequest& request, EvaluationMethods& methods) {
  const auto evaluate = [&](const PublishedResult& published, const std::string& folder) {
    EvaluationDataOptions data = request.data;
    data.format = published.format;
    data.dir = folder;
    if (data.points == 0) data.points = published.points;
    return EvaluateData(data, request.processing_size.empty() ? published.processing_size : request.processing_size,
                        methods);
  };
  const std::vector<SuiteRow> rows = RunSuite(PaperResults(), request.data.dir, evaluate);
  std::cout << FormatSuite(rows);
  std::vector<Report> reports;
  for (const SuiteRow& row : rows) {
    if (!row.ours.ok()) continue;
    for (Report report : *row.ours) {
      report.method = absl::StrCat(row.published.title, ": ", report.method);
      reports.push_back(std::move(report));
    }
  }
  return reports;
}

// Writes the evaluated weights with what their estimates say about confidence.
absl::Status Calibrate(const EvaluateRequest& request, const EvaluationMethods& methods) {
  const absl::StatusOr<Calibration> calibration = FitCalibration(methods.judged());
  if (!calibration.ok()) return calibration.status();
  const std::string json = calibration->ToJson();
  std::cout << "confidence, fitted to " << methods.judged().size() << " estimates: " << json << "\n";
  return CopyWithMetadata(request.methods.engine.weights_path, request.calibrate, Calibration::kMetadataKey, json);
}

// An hour's evaluation shall not end at a name that was wrong from the start.
absl::Status CheckOutputs(const EvaluateRequest& request) {
  absl::Status status;
  for (const std::string& path : {request.json, request.calibrate}) {
    if (!path.empty()) status.Update(CheckWritable(path));
  }
  return status;
}

absl::Status Run() {
  const absl::StatusOr<EvaluateRequest> request = RequestFromFlags();
  if (!request.ok()) return request.status();
  if (absl::Status writable = CheckOutputs(*request); !writable.ok()) return writable;
  cv::setNumThreads(1);  // as in the server: OpenCV's own threads would take the network's cores
  absl::StatusOr<std::unique_ptr<EvaluationMethods>> methods = EvaluationMethods::Create(request->methods);
  if (!methods.ok()) return methods.status();
  const absl::StatusOr<std::vector<Report>> reports =
      request->suite ? EvaluateSuite(*request, **methods)
                     : EvaluateData(request->data, request->processing_size, **methods);
  if (!reports.ok()) return reports.status();
  if (!request->suite) {
    for (const Report& report : *reports) std::cout << FormatReport(report) << "\n";
  }
  absl::Status status;
  if (!request->json.empty()) status = WriteFileAtomically(request->json, ReportsToJson(*reports, SettingsFromFlags()));
  if (!request->calibrate.empty()) status.Update(Calibrate(*request, **methods));
  return status;
}

int Main(const std::vector<std::string>& args) {
  if (AnswerQuestion(kProgram, args, std::cout)) return EXIT_SUCCESS;
  absl::Status status = SetFlags(args, std::getenv);
  if (status.ok()) status = Run();
  if (status.ok()) return EXIT_SUCCESS;
  std::cerr << "holdfast-eval: " << status.message() << "\n";
  return absl::IsInvalidArgument(status) ? kUsageError : kFailure;
}

}  // namespace
}  // namespace holdfast

int main(int argc, char** argv) {
  holdfast::PrepareForNetwork(argv);
  return holdfast::Main({argv + 1, argv + argc});
}
