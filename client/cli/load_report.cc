// SPDX-License-Identifier: Apache-2.0
#include "client/cli/load_report.h"

#include <algorithm>
#include <cstdint>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace holdfast {
namespace {

using nlohmann::ordered_json;

constexpr LoadKind kKinds[] = {LoadKind::kHealthy, LoadKind::kSlow, LoadKind::kCancel, LoadKind::kBad};
constexpr double kPercents[] = {50, 95, 99};
constexpr size_t kMostErrors = 8;  // that a table quotes

// All clients of one kind.
struct Group {
  LoadKind kind = LoadKind::kHealthy;
  int64_t clients = 0;
  LoadResult sum;
  double slowest = 0;  // frames/s of one client
};

std::vector<Group> GroupsOf(const std::vector<LoadResult>& results) {
  std::vector<Group> groups;
  for (const LoadKind kind : kKinds) {
    Group group;
    group.kind = kind;
    for (const LoadResult& result : results) {
      if (result.kind != kind) continue;
      group.slowest = group.clients == 0 ? result.FramesPerSecond() : std::min(group.slowest, result.FramesPerSecond());
      ++group.clients;
      group.sum.sessions += result.sessions;
      group.sum.refused += result.refused;
      group.sum.frames += result.frames;
      group.sum.final_samples += result.final_samples;
      group.sum.first.Add(result.first);
      group.sum.final.Add(result.final);
      group.sum.refusal.Add(result.refusal);
      group.sum.errors.insert(group.sum.errors.end(), result.errors.begin(), result.errors.end());
    }
    if (group.clients > 0) groups.push_back(std::move(group));
  }
  return groups;
}

double PerSecond(int64_t count, absl::Duration took) {
  return took > absl::ZeroDuration() ? static_cast<double>(count) / absl::ToDoubleSeconds(took) : 0;
}

std::string Cell(const Latencies& latencies) {
  if (latencies.count() == 0) return "-";
  return absl::StrFormat("%.0f / %.0f / %.0f", absl::ToDoubleMilliseconds(latencies.Percentile(50)),
                         absl::ToDoubleMilliseconds(latencies.Percentile(95)),
                         absl::ToDoubleMilliseconds(latencies.Percentile(99)));
}

ordered_json ToJson(const Latencies& latencies) {
  ordered_json json = {{"count", latencies.count()}};
  for (const double percent : kPercents) {
    json[absl::StrCat("p", percent)] = absl::ToDoubleMilliseconds(latencies.Percentile(percent));
  }
  return json;
}

ordered_json ToJson(const LoadResult& result) {
  ordered_json errors = ordered_json::array();
  for (const absl::Status& error : result.errors) errors.push_back(error.ToString());
  return {{"kind", NameOf(result.kind)},
          {"sessions", result.sessions},
          {"refused", result.refused},
          {"frames", result.frames},
          {"final_samples", result.final_samples},
          {"frames_per_second", result.FramesPerSecond()},
          {"first_estimate_ms", ToJson(result.first)},
          {"final_ms", ToJson(result.final)},
          {"refusal_ms", ToJson(result.refusal)},
          {"errors", errors}};
}

}  // namespace

std::string DescribeLoad(const std::vector<LoadResult>& results, absl::Duration took) {
  std::string out =
      absl::StrFormat("%-8s %8s %9s %8s %7s %9s %9s  %-22s %-22s %s\n", "clients", "", "sessions", "refused", "errors",
                      "frames/s", "slowest", "first ms 50/95/99 %", "final ms 50/95/99 %", "refusal ms 50/95/99 %");
  std::vector<absl::Status> errors;
  for (const Group& group : GroupsOf(results)) {
    const LoadResult& sum = group.sum;
    absl::StrAppendFormat(&out, "%-8s %8d %9d %8d %7d %9.1f %9.1f  %-22s %-22s %s\n", NameOf(group.kind), group.clients,
                          sum.sessions, sum.refused, sum.errors.size(), PerSecond(sum.frames, took), group.slowest,
                          Cell(sum.first), Cell(sum.final), Cell(sum.refusal));
    errors.insert(errors.end(), sum.errors.begin(), sum.errors.end());
  }
  for (size_t i = 0; i < std::min(errors.size(), kMostErrors); ++i) {
    absl::StrAppend(&out, "error: ", errors[i].ToString(), "\n");
  }
  if (errors.size() > kMostErrors) absl::StrAppend(&out, "and ", errors.size() - kMostErrors, " errors more\n");
  return out;
}

std::string LoadAsJson(const std::vector<LoadResult>& results, absl::Duration took) {
  ordered_json json = {{"seconds", absl::ToDoubleSeconds(took)}, {"clients", ordered_json::array()}};
  for (const LoadResult& result : results) json["clients"].push_back(ToJson(result));
  for (const Group& group : GroupsOf(results)) {
    LoadResult sum = group.sum;
    sum.kind = group.kind;
    ordered_json total = ToJson(sum);
    total["frames_per_second"] = PerSecond(sum.frames, took);
    json["totals"].push_back(total);
  }
  return json.dump(2, ' ', false, ordered_json::error_handler_t::replace) + "\n";
}

absl::Status CheckLoad(const std::vector<LoadResult>& results) {
  int64_t healthy = 0, sessions = 0, failed = 0;
  for (const LoadResult& result : results) {
    if (result.kind != LoadKind::kHealthy) continue;
    ++healthy;
    sessions += result.sessions;
    failed += result.errors.empty() ? 0 : 1;
  }
  if (failed > 0) return absl::InternalError(absl::StrCat(failed, " of ", healthy, " healthy clients saw errors"));
  if (healthy > 0 && sessions == 0) return absl::InternalError("no healthy client got a session");
  return absl::OkStatus();
}

}  // namespace holdfast
