// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/suite.h"

#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "training/evaluation/report.h"

namespace holdfast {
namespace {

Metrics Published(double delta_avg, double survival_50, double mte) {
  Metrics metrics;
  metrics.delta_avg = delta_avg;
  metrics.survival_50 = survival_50;
  metrics.mte = mte;
  return metrics;
}

std::vector<std::string> MakeRow(const std::string& title, const std::string& who, const std::string& size,
                                 const Metrics& metrics) {
  std::vector<std::string> row = {title, who, size};
  for (const MetricColumn& column : MetricColumns()) row.push_back(FormatMetric(metrics.*column.value));
  return row;
}

}  // namespace

std::vector<PublishedResult> PaperResults() {
  std::vector<PublishedResult> results = {
      {"PointOdyssey (test)",
       "pointodyssey",
       "pointodyssey",
       "https://pointodyssey.com",
       {896, 512},
       Published(32.8, 52.1, 37.6)},
      {"TAP-Vid-DAVIS",
       "tapvid",
       "tapvid_davis",
       "https://storage.googleapis.com/dm-tapnet/tapvid_davis.zip and convert it with training/tools/convert_tapvid.py",
       {896, 512},
       Published(69.5, 94.6, 4.8)},
      {"CroHD",
       "crohd",
       "crohd",
       "https://motchallenge.net/data/Head_Tracking_21",
       {1280, 768},
       Published(50.9, 83.0, 13.5)}};
  results[0].published.delta_vis = 36.3;
  results[0].published.delta_occ = 23.7;
  results[0].points = 256;
  results[2].differs = "heads by the motion of their valid positions; the published test's choice has more of them";
  return results;
}

std::vector<SuiteRow> RunSuite(const std::vector<PublishedResult>& results, const std::string& root,
                               const EvaluateFolder& evaluate) {
  std::vector<SuiteRow> rows;
  for (const PublishedResult& published : results) {
    const std::string folder = (std::filesystem::path(root) / published.folder).string();
    std::error_code ignored;
    if (std::filesystem::is_directory(folder, ignored)) {
      rows.push_back({published, evaluate(published, folder)});
    } else {
      rows.push_back({published, absl::NotFoundError(absl::StrCat("absent: there is no folder ", folder, "; get it at ",
                                                                  published.where))});
    }
  }
  return rows;
}

std::string FormatSuite(const std::vector<SuiteRow>& rows) {
  std::vector<std::vector<std::string>> table = {{"data set", "result", "processed"}};
  for (const MetricColumn& column : MetricColumns()) table[0].push_back(column.header);
  std::string notes;
  for (const SuiteRow& row : rows) {
    const PublishedResult& published = row.published;
    table.push_back(MakeRow(published.title, "paper", ToString(published.processing_size), published.published));
    if (!row.ours.ok()) {
      absl::StrAppend(&notes, published.title, ": ", row.ours.status().message(), "\n");
      continue;
    }
    for (const Report& report : *row.ours) {
      table.push_back(
          MakeRow("", report.method.substr(0, report.method.find(' ')), ProcessingSizes(report), report.mean));
    }
    if (!published.differs.empty()) absl::StrAppend(&notes, published.title, ": ", published.differs, "\n");
    if (!row.ours->front().skipped.empty()) {
      absl::StrAppend(&notes, published.title, ": ", row.ours->front().skipped.size(), " sequences skipped\n");
    }
  }
  return FormatColumns(table) + notes;
}

}  // namespace holdfast
