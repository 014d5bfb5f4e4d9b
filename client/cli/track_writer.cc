// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_writer.h"

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <ostream>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/time/time.h"
#include "client/cli/track_arrays.h"
#include "client/cli/track_exports.h"
#include "io/atomic_file.h"
#include "io/npz_writer.h"

namespace holdfast {
namespace {

using nlohmann::json;

// A thousandth of a pixel is far below what tracking can tell.
double Rounded(float value) { return std::round(static_cast<double>(value) * 1000) / 1000; }

json PointToJson(const TrackTable& table, const TableTrack& track) {
  json frames = json::array(), xy = json::array(), visible = json::array(), confidence = json::array();
  for (size_t i = 0; i < track.samples.size(); ++i) {
    const TrackSample& sample = track.samples[i];
    if (sample.is_absent()) continue;
    frames.push_back(table.Number(track.first_frame + static_cast<int64_t>(i)));
    xy.push_back({Rounded(sample.x), Rounded(sample.y)});
    visible.push_back(sample.visible);
    confidence.push_back(Rounded(sample.confidence));
  }
  return {{"id", track.start.query.id}, {"name", track.start.name},      {"frames", std::move(frames)},
          {"xy", std::move(xy)},        {"visible", std::move(visible)}, {"confidence", std::move(confidence)}};
}

// Of the frames that have one.
json CaptureTimes(const TrackTable& table, const TrackExtent& extent) {
  json times = json::array();
  for (int64_t frame = 0; frame < extent.frames; ++frame) {
    const auto time = table.CaptureTime(frame);
    if (time) times.push_back({table.Number(frame), absl::FormatTime(*time, absl::UTCTimeZone())});
  }
  return times;
}

// The object on the frames it is known on.
json ObjectToJson(const TrackTable& table, const TrackExtent& extent) {
  const TableObject& object = *table.object();
  json points = json::array(), frames = json::array(), xy = json::array(), scale = json::array();
  json rotation = json::array(), visible = json::array(), outline = json::array(), left = json::array();
  json joined = json::array();
  for (const TableTrack& track : table.tracks()) {
    if (table.IsOfObject(track)) points.push_back(track.start.query.id);
  }
  for (int64_t frame = object.query_frame; frame < extent.frames; ++frame) {
    const ObjectSample* sample = table.ObjectEstimate(frame);
    if (sample == nullptr) continue;
    frames.push_back(table.Number(frame));
    xy.push_back({Rounded(sample->centre.x), Rounded(sample->centre.y)});
    scale.push_back(Rounded(sample->scale));
    rotation.push_back(Rounded(sample->rotation));
    visible.push_back(Rounded(sample->visible));
    json corners = json::array();
    for (const Pixel& corner : sample->outline) corners.push_back({Rounded(corner.x), Rounded(corner.y)});
    outline.push_back(std::move(corners));
    left.push_back(sample->left);
    joined.push_back(sample->joined);
  }
  return {{"id", object.start.query.id},   {"points", std::move(points)},   {"frames", std::move(frames)},
          {"xy", std::move(xy)},           {"scale", std::move(scale)},     {"rotation", std::move(rotation)},
          {"visible", std::move(visible)}, {"outline", std::move(outline)}, {"left", std::move(left)},
          {"joined", std::move(joined)}};
}

// Point by point, so that the tree of values never holds a whole video.
void WriteJson(std::ostream& out, const TrackTable& table, const VideoFacts& video, const TrackExtent& extent) {
  out << absl::StrFormat("{\"width\": %d, \"height\": %d, \"fps\": %s, \"frames\": %d, ", video.size.width,
                         video.size.height, nlohmann::json(video.fps).dump(), extent.frames);
  out << absl::StrFormat("\"complete\": %s, \"final_frames\": %d, \"expected_frames\": %d, ",
                         extent.complete ? "true" : "false", extent.final_frames, extent.expected_frames);
  const json times = CaptureTimes(table, extent);
  if (!times.empty()) out << "\"capture_times\": " << times.dump() << ", ";
  out << "\"points\": [";
  const char* separator = "\n";
  for (const TableTrack& track : table.tracks()) {
    out << separator << PointToJson(table, track).dump(-1, ' ', false, json::error_handler_t::replace);
    separator = ",\n";
  }
  out << "\n]";
  if (table.object()) out << ",\n\"objects\": [" << ObjectToJson(table, extent).dump() << "]";
  out << "}\n";
}

void WriteCsv(std::ostream& out, const TrackTable& table) {
  out << "id,frame,x,y,visible,confidence\n";
  for (const TableTrack& track : table.tracks()) {
    for (size_t i = 0; i < track.samples.size(); ++i) {
      const TrackSample& s = track.samples[i];
      if (s.is_absent()) continue;
      out << absl::StrFormat("%d,%d,%.3f,%.3f,%d,%.3f\n", track.start.query.id,
                             table.Number(track.first_frame + static_cast<int64_t>(i)), s.x, s.y, s.visible ? 1 : 0,
                             s.confidence);
    }
  }
}

void WriteObjectsCsv(std::ostream& out, const TrackTable& table, const TrackExtent& extent) {
  out << "object,frame,x,y,scale,rotation,visible,outline,left,joined\n";
  for (int64_t frame = 0; frame < extent.frames; ++frame) {
    const ObjectSample* s = table.ObjectEstimate(frame);
    if (s == nullptr) continue;
    const auto corner = [](std::string* text, const Pixel& at) {
      absl::StrAppendFormat(text, "%.3f %.3f", at.x, at.y);
    };
    out << absl::StrFormat("%d,%d,%.3f,%.3f,%.4f,%.4f,%.4f,%s,%s,%s\n", table.object()->start.query.id,
                           table.Number(frame), s->centre.x, s->centre.y, s->scale, s->rotation, s->visible,
                           absl::StrJoin(s->outline, ";", corner), absl::StrJoin(s->left, " "),
                           absl::StrJoin(s->joined, " "));
  }
}

absl::Status WriteObjects(const std::string& path, const TrackTable& table, const TrackExtent& extent) {
  return WriteAtomically(path, [&](const std::string& temporary) {
    std::ofstream out(temporary, std::ios::binary);
    WriteObjectsCsv(out, table, extent);
    out.close();
    return out ? absl::OkStatus() : absl::InternalError("cannot be written");
  });
}

absl::Status WriteText(const std::string& path, TrackFormat format, const TrackTable& table, const VideoFacts& video,
                       const TrackExtent& extent) {
  std::ofstream out(path, std::ios::binary);
  switch (format) {
    case TrackFormat::kJson:
      WriteJson(out, table, video, extent);
      break;
    case TrackFormat::kDeepLabCut:
      WriteDeepLabCut(out, table, extent);
      break;
    case TrackFormat::kCvat:
      WriteCvat(out, table, video, extent);
      break;
    case TrackFormat::k3de:
      Write3de(out, table, video);
      break;
    default:
      WriteCsv(out, table);
  }
  out.close();
  return out ? absl::OkStatus() : absl::InternalError("cannot be written");
}

}  // namespace

absl::StatusOr<TrackFormat> TrackFormatOf(absl::string_view path) {
  if (absl::EndsWithIgnoreCase(path, ".json")) return TrackFormat::kJson;
  if (absl::EndsWithIgnoreCase(path, ".dlc.csv")) return TrackFormat::kDeepLabCut;
  if (absl::EndsWithIgnoreCase(path, ".csv")) return TrackFormat::kCsv;
  if (absl::EndsWithIgnoreCase(path, ".npz")) return TrackFormat::kNpz;
  if (absl::EndsWithIgnoreCase(path, ".xml")) return TrackFormat::kCvat;
  if (absl::EndsWithIgnoreCase(path, ".3de.txt")) return TrackFormat::k3de;
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": track files end in .json, .csv, .npz, .dlc.csv, .xml or .3de.txt"));
}

std::string ObjectsFileOf(absl::string_view path) {
  constexpr absl::string_view kSuffix = ".csv";
  const absl::StatusOr<TrackFormat> format = TrackFormatOf(path);
  if (!format.ok() || *format != TrackFormat::kCsv) return "";
  return absl::StrCat(path.substr(0, path.size() - kSuffix.size()), ".objects",
                      path.substr(path.size() - kSuffix.size()));
}

absl::Status WriteTracks(const std::string& path, const TrackTable& table, const VideoFacts& video,
                         const TrackExtent& extent) {
  const absl::StatusOr<TrackFormat> format = TrackFormatOf(path);
  if (!format.ok()) return format.status();
  const absl::Status written = WriteAtomically(path, [&](const std::string& temporary) {
    if (*format == TrackFormat::kNpz) return WriteNpz(temporary, TrackArrays(table, video, extent));
    return WriteText(temporary, *format, table, video, extent);
  });
  const std::string objects = table.object() ? ObjectsFileOf(path) : "";
  return !written.ok() || objects.empty() ? written : WriteObjects(objects, table, extent);
}

}  // namespace holdfast
