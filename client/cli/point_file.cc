// SPDX-License-Identifier: Apache-2.0
#include "client/cli/point_file.h"

#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "io/file_io.h"

namespace holdfast {
namespace {

using nlohmann::json;

constexpr int64_t kMaxFileBytes = 64 << 20;
// Ids are written to JSON, where larger numbers lose digits in many readers.
constexpr uint64_t kMaxId = (uint64_t{1} << 53) - 1;

absl::Status WrongField(absl::string_view where, absl::string_view field, absl::string_view value,
                        absl::string_view expected) {
  return absl::InvalidArgumentError(absl::StrCat(where, ": ", field, " is ", value, ", expected ", expected));
}

// Collects points and refuses what no source may contain.
class PointList {
 public:
  PointList(ImageSize size, int64_t first_frame) : size_(size), first_frame_(first_frame) {}

  absl::Status Add(const std::string& where, StartPoint point) {
    const auto [x, y] = std::pair(point.query.x, point.query.y);
    if (point.query.id > kMaxId) return WrongField(where, "id", absl::StrCat(point.query.id), "less than 2^53");
    if (!Inside(x, size_.width)) return WrongField(where, "x", absl::StrCat(x), Range(size_.width));
    if (!Inside(y, size_.height)) return WrongField(where, "y", absl::StrCat(y), Range(size_.height));
    if (point.frame < first_frame_) return WrongField(where, "frame", absl::StrCat(point.frame), FramesThere());
    const auto [earlier, is_new] = places_.emplace(point.query.id, where);
    if (!is_new)
      return WrongField(where, "id", absl::StrCat(point.query.id, " again"), "each id once; see " + earlier->second);
    if (point.name.empty()) point.name = absl::StrCat(point.query.id);
    points_.push_back(std::move(point));
    return absl::OkStatus();
  }

  absl::StatusOr<std::vector<StartPoint>> Take() {
    if (points_.empty()) return absl::InvalidArgumentError("has no points");
    return std::move(points_);
  }

 private:
  static bool Inside(float value, int side) {
    return std::isfinite(value) && value >= 0 && value <= static_cast<float>(side - 1);
  }
  static std::string Range(int side) { return absl::StrCat("0..", side - 1, ", inside the frame"); }

  std::string FramesThere() const {
    return first_frame_ == 0 ? "0 or more" : absl::StrCat("--start_frame=", first_frame_, " or more");
  }

  const ImageSize size_;
  const int64_t first_frame_;
  std::map<PointId, std::string> places_;
  std::vector<StartPoint> points_;
};

bool IsHeader(absl::string_view line) { return line == "id,x,y" || line == "id,x,y,frame"; }

absl::StatusOr<StartPoint> ParseCsvLine(const std::string& where, absl::string_view line, int64_t first_frame) {
  const std::vector<absl::string_view> fields = absl::StrSplit(line, ',');
  if (fields.size() != 3 && fields.size() != 4) {
    return WrongField(where, "the line", absl::StrCat("of ", fields.size(), " fields"), "id,x,y or id,x,y,frame");
  }
  StartPoint point;
  point.frame = first_frame;
  if (!absl::SimpleAtoi(fields[0], &point.query.id)) return WrongField(where, "id", fields[0], "a whole number");
  if (!absl::SimpleAtof(fields[1], &point.query.x)) return WrongField(where, "x", fields[1], "a number");
  if (!absl::SimpleAtof(fields[2], &point.query.y)) return WrongField(where, "y", fields[2], "a number");
  if (fields.size() == 4 && !absl::SimpleAtoi(fields[3], &point.frame)) {
    return WrongField(where, "frame", fields[3], "a whole number");
  }
  return point;
}

std::string Shown(const json& value) {
  return value.dump(-1, ' ', false, json::error_handler_t::replace).substr(0, 40);
}

absl::StatusOr<StartPoint> ParseJsonPoint(const std::string& where, const json& value, int64_t first_frame) {
  if (!value.is_object()) return WrongField(where, "the point", Shown(value), "an object with id, x and y");
  StartPoint point;
  point.frame = first_frame;
  const json none;
  const auto field = [&](const char* name) -> const json& { return value.contains(name) ? value.at(name) : none; };
  if (!field("id").is_number_unsigned()) return WrongField(where, "id", Shown(field("id")), "a whole number");
  point.query.id = field("id").get<uint64_t>();
  for (const auto& [name, target] : {std::pair("x", &point.query.x), std::pair("y", &point.query.y)}) {
    if (!field(name).is_number()) return WrongField(where, name, Shown(field(name)), "a number");
    *target = field(name).get<float>();
  }
  if (value.contains("frame")) {
    if (!field("frame").is_number_unsigned()) return WrongField(where, "frame", Shown(field("frame")), "0 or more");
    point.frame = field("frame").get<int64_t>();
  }
  if (value.contains("name")) {
    if (!field("name").is_string()) return WrongField(where, "name", Shown(field("name")), "a text");
    point.name = field("name").get<std::string>();
  }
  return point;
}

absl::StatusOr<json> ParseJson(absl::string_view text) {
  try {
    return json::parse(text.begin(), text.end());
  } catch (const json::exception& e) {
    return absl::InvalidArgumentError(absl::StrCat("is not JSON: ", e.what()));
  }
}

absl::StatusOr<std::string> ReadText(const std::string& path) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) return absl::InvalidArgumentError("is a directory");
  absl::StatusOr<std::string> text = ReadFile(path, kMaxFileBytes);
  if (text.ok()) return text;
  return absl::NotFoundError(absl::IsResourceExhausted(text.status()) ? "is larger than 64 MiB" : "cannot be read");
}

}  // namespace

absl::StatusOr<std::vector<StartPoint>> ParsePointsCsv(absl::string_view text, ImageSize size, int64_t first_frame) {
  PointList points(size, first_frame);
  absl::ConsumePrefix(&text, "\xEF\xBB\xBF");  // the byte order mark of spreadsheets
  int number = 0;
  for (absl::string_view line : absl::StrSplit(text, '\n')) {
    ++number;
    line = absl::StripAsciiWhitespace(line);
    if (line.empty() || line[0] == '#' || IsHeader(line)) continue;
    const std::string where = absl::StrCat("line ", number);
    absl::StatusOr<StartPoint> point = ParseCsvLine(where, line, first_frame);
    if (!point.ok()) return point.status();
    const absl::Status added = points.Add(where, *std::move(point));
    if (!added.ok()) return added;
  }
  return points.Take();
}

absl::StatusOr<std::vector<StartPoint>> ParsePointsJson(absl::string_view text, ImageSize size, int64_t first_frame) {
  const absl::StatusOr<json> document = ParseJson(text);
  if (!document.ok()) return document.status();
  const bool wrapped = document->is_object() && document->contains("points");
  const json& list = wrapped ? document->at("points") : *document;
  if (!list.is_array()) return absl::InvalidArgumentError("expected a list of points, or an object with \"points\"");
  PointList points(size, first_frame);
  for (size_t i = 0; i < list.size(); ++i) {
    const std::string where = absl::StrCat("points[", i, "]");
    absl::StatusOr<StartPoint> point = ParseJsonPoint(where, list[i], first_frame);
    if (!point.ok()) return point.status();
    const absl::Status added = points.Add(where, *std::move(point));
    if (!added.ok()) return added;
  }
  return points.Take();
}

absl::StatusOr<std::vector<StartPoint>> ReadPointFile(const std::string& path, ImageSize size, int64_t first_frame) {
  const bool csv = absl::EndsWithIgnoreCase(path, ".csv");
  if (!csv && !absl::EndsWithIgnoreCase(path, ".json")) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": point files end in .csv or .json"));
  }
  const absl::StatusOr<std::string> text = ReadText(path);
  if (!text.ok()) return absl::Status(text.status().code(), absl::StrCat(path, ": ", text.status().message()));
  auto points = csv ? ParsePointsCsv(*text, size, first_frame) : ParsePointsJson(*text, size, first_frame);
  if (points.ok()) return points;
  return absl::Status(points.status().code(), absl::StrCat(path, ": ", points.status().message()));
}

}  // namespace holdfast
