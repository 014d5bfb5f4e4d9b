// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace holdfast {
namespace {

using Json = nlohmann::ordered_json;

void AppendMetrics(const Metrics& metrics, std::vector<std::string>& row) {
  for (const MetricColumn& column : MetricColumns()) row.push_back(FormatMetric(metrics.*column.value));
}

Json SizeToJson(ImageSize size) { return {{"width", size.width}, {"height", size.height}}; }

Json MetricsToJson(const Metrics& metrics) {
  Json json = Json::object();
  for (const MetricColumn& column : MetricColumns()) {
    const std::optional<double>& value = metrics.*column.value;
    json[column.key] = value && std::isfinite(*value) ? Json(*value) : Json();
  }
  return json;
}

Json ReliabilityToJson(const Reliability& reliability) {
  Json json = {{"claims", reliability.claims},
               {"ece", reliability.ece},
               {"brier", reliability.brier},
               {"auc", reliability.auc ? Json(*reliability.auc) : Json()},
               {"bins", Json::array()}};
  for (const ReliabilityBin& bin : reliability.bins) {
    json["bins"].push_back({{"claims", bin.claims}, {"confidence", bin.confidence}, {"right", bin.right}});
  }
  return json;
}

Json ReportToJson(const Report& report) {
  Json json = {{"method", report.method}, {"sequences", Json::array()}, {"skipped", Json::array()}};
  for (const SequenceReport& sequence : report.sequences) {
    json["sequences"].push_back({{"name", sequence.name},
                                 {"frames", sequence.frames},
                                 {"points", sequence.points},
                                 {"frame_size", SizeToJson(sequence.frame_size)},
                                 {"processing_size", SizeToJson(sequence.processing_size)},
                                 {"seconds", sequence.seconds},
                                 {"iterations", sequence.iterations ? Json(*sequence.iterations) : Json()},
                                 {"metrics", MetricsToJson(sequence.metrics)}});
  }
  for (const SkippedSequence& skipped : report.skipped) {
    json["skipped"].push_back({{"name", skipped.name}, {"reason", skipped.reason}});
  }
  json["mean"] = MetricsToJson(report.mean);
  json["iterations"] = report.iterations ? Json(*report.iterations) : Json();
  json["reliability"] = report.reliability ? ReliabilityToJson(*report.reliability) : Json();
  return json;
}

}  // namespace

std::string ProcessingSizes(const Report& report) {
  std::set<std::string> sizes;
  for (const SequenceReport& sequence : report.sequences) sizes.insert(ToString(sequence.processing_size));
  return sizes.size() > 3 ? absl::StrCat(sizes.size(), " sizes") : absl::StrJoin(sizes, ",");
}

std::string FormatMetric(const std::optional<double>& value) { return value ? absl::StrFormat("%.1f", *value) : "-"; }

std::string FormatColumns(const std::vector<std::vector<std::string>>& rows) {
  std::vector<size_t> widths;
  for (const std::vector<std::string>& row : rows) {
    widths.resize(std::max(widths.size(), row.size()));
    for (size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string text;
  for (const std::vector<std::string>& row : rows) {
    for (size_t i = 0; i < row.size(); ++i) {
      const std::string padding(widths[i] - row[i].size(), ' ');
      absl::StrAppend(&text, i == 0 ? "" : "  ", i == 0 ? row[i] + padding : padding + row[i]);
    }
    text.erase(text.find_last_not_of(' ') + 1);
    text += '\n';
  }
  return text;
}

std::string FormatReport(const Report& report) {
  std::vector<std::vector<std::string>> rows = {{"sequence", "frames", "points", "source", "processed", "seconds"}};
  for (const MetricColumn& column : MetricColumns()) rows[0].push_back(column.header);
  double seconds = 0;
  for (const SequenceReport& sequence : report.sequences) {
    seconds += sequence.seconds;
    rows.push_back({sequence.name, absl::StrCat(sequence.frames), absl::StrCat(sequence.points),
                    ToString(sequence.frame_size), ToString(sequence.processing_size),
                    absl::StrFormat("%.1f", sequence.seconds)});
    AppendMetrics(sequence.metrics, rows.back());
  }
  rows.push_back({absl::StrCat("mean of ", report.sequences.size()), "", "", "", ProcessingSizes(report),
                  absl::StrFormat("%.1f", seconds)});
  AppendMetrics(report.mean, rows.back());
  std::string text = absl::StrCat("# ", report.method, ", processed at ", ProcessingSizes(report), "\n");
  absl::StrAppend(&text, FormatColumns(rows));
  if (report.reliability) {
    const Reliability& reliability = *report.reliability;
    absl::StrAppend(&text, "confidence: ECE ", absl::StrFormat("%.3f, Brier %.3f", reliability.ece, reliability.brier),
                    reliability.auc ? absl::StrFormat(", AUC %.3f", *reliability.auc) : "", " over ",
                    reliability.claims, " estimates\n");
  }
  if (report.iterations) {
    absl::StrAppend(&text, "iterations of a point's window, mean: ", absl::StrFormat("%.2f", *report.iterations), "\n");
  }
  for (const SkippedSequence& skipped : report.skipped) {
    absl::StrAppend(&text, "skipped ", skipped.name, ": ", skipped.reason, "\n");
  }
  return text;
}

std::string ReportsToJson(const std::vector<Report>& reports, const std::map<std::string, std::string>& settings) {
  Json json = {{"settings", settings}, {"reports", Json::array()}};
  for (const Report& report : reports) json["reports"].push_back(ReportToJson(report));
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace holdfast
