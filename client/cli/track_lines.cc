// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_lines.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/time/time.h"

namespace holdfast {
namespace {

const char* Word(bool value) { return value ? "true" : "false"; }

// JSON knows no other numbers.
std::string Number(float value) { return std::isfinite(value) ? absl::StrFormat("%.3f", value) : "null"; }

std::string Captured(int64_t frame, const TrackTable& table) {
  const auto time = table.CaptureTime(frame);
  return time ? absl::StrCat(", \"capture_time\": \"", absl::FormatTime(*time, absl::UTCTimeZone()), "\"") : "";
}

}  // namespace

TrackLines::TrackLines(const std::vector<StartPoint>& points, std::ostream& out) : out_(out) {
  using nlohmann::json;
  for (const StartPoint& point : points) {
    names_[point.query.id] = json(point.name).dump(-1, ' ', false, json::error_handler_t::replace);
  }
}

bool TrackLines::Write(const TrackUpdate& update, const TrackTable& table) {
  for (const PointRun& run : update.runs) {
    for (size_t i = 0; i < run.x.size(); ++i) out_ << Line(run, i, table);
  }
  for (const ObjectRun& run : update.objects) {
    for (size_t i = 0; i < run.samples.size(); ++i) out_ << Line(run, i, table);
  }
  return static_cast<bool>(out_.flush());
}

std::string TrackLines::Line(const PointRun& run, size_t i, const TrackTable& table) {
  const int64_t frame = run.first_frame + static_cast<int64_t>(i);
  auto name = names_.find(run.id);
  // A point of an object, of which one hears only now.
  if (name == names_.end()) name = names_.emplace(run.id, absl::StrFormat("\"%d\"", run.id)).first;
  return absl::StrFormat(
      "{\"id\": %d, \"name\": %s, \"frame\": %d, \"x\": %s, \"y\": %s, \"visible\": %s, \"confidence\": %s, "
      "\"final\": %s%s}\n",
      run.id, name->second, table.Number(frame), Number(run.x[i]), Number(run.y[i]), Word(run.visible[i] != 0),
      Number(run.confidence[i]), Word(static_cast<int64_t>(i) < run.final_count), Captured(frame, table));
}

std::string TrackLines::Line(const ObjectRun& run, size_t i, const TrackTable& table) {
  const int64_t frame = run.first_frame + static_cast<int64_t>(i);
  const ObjectSample& sample = run.samples[i];
  return absl::StrFormat(
      "{\"object\": %d, \"frame\": %d, \"x\": %s, \"y\": %s, \"scale\": %s, \"rotation\": %s, \"visible\": %s, "
      "\"left\": [%s], \"joined\": [%s], \"final\": %s%s}\n",
      run.id, table.Number(frame), Number(sample.centre.x), Number(sample.centre.y), Number(sample.scale),
      Number(sample.rotation), Number(sample.visible), absl::StrJoin(sample.left, ", "),
      absl::StrJoin(sample.joined, ", "), Word(static_cast<int64_t>(i) < run.final_count), Captured(frame, table));
}

bool TrackLines::End(const TrackExtent& extent) {
  out_ << absl::StrFormat("{\"complete\": %s, \"frames\": %d, \"final_frames\": %d, \"expected_frames\": %d}\n",
                          Word(extent.complete), extent.frames, extent.final_frames, extent.expected_frames);
  return static_cast<bool>(out_.flush());
}

}  // namespace holdfast
