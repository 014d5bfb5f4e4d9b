// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_writer.h"

#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <ostream>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/track_exports.h"
#include "io/atomic_file.h"
#include "io/npz_writer.h"

namespace holdfast {
namespace {

using nlohmann::json;

// A thousandth of a pixel is far below what tracking can tell.
double Rounded(float value) { return std::round(static_cast<double>(value) * 1000) / 1000; }

json PointToJson(const TableTrack& track) {
  json frames = json::array(), xy = json::array(), visible = json::array(), confidence = json::array();
  for (size_t i = 0; i < track.samples.size(); ++i) {
    const TrackSample& sample = track.samples[i];
    if (sample.is_absent()) continue;
    frames.push_back(track.start.frame + static_cast<int64_t>(i));
    xy.push_back({Rounded(sample.x), Rounded(sample.y)});
    visible.push_back(sample.visible);
    confidence.push_back(Rounded(sample.confidence));
  }
  return {{"id", track.start.query.id}, {"name", track.start.name},      {"frames", std::move(frames)},
          {"xy", std::move(xy)},        {"visible", std::move(visible)}, {"confidence", std::move(confidence)}};
}

// Point by point, so that the tree of values never holds a whole video.
void WriteJson(std::ostream& out, const TrackTable& table, const VideoFacts& video, const TrackExtent& extent) {
  out << absl::StrFormat("{\"width\": %d, \"height\": %d, \"fps\": %g, \"frames\": %d, ", video.size.width,
                         video.size.height, video.fps, extent.frames);
  out << absl::StrFormat("\"complete\": %s, \"final_frames\": %d, \"expected_frames\": %d, \"points\": [",
                         extent.complete ? "true" : "false", extent.final_frames, extent.expected_frames);
  const char* separator = "\n";
  for (const TableTrack& track : table.tracks()) {
    out << separator << PointToJson(track).dump(-1, ' ', false, json::error_handler_t::replace);
    separator = ",\n";
  }
  out << "\n]}\n";
}

void WriteCsv(std::ostream& out, const TrackTable& table) {
  out << "id,frame,x,y,visible,confidence\n";
  for (const TableTrack& track : table.tracks()) {
    for (size_t i = 0; i < track.samples.size(); ++i) {
      const TrackSample& s = track.samples[i];
      if (s.is_absent()) continue;
      out << absl::StrFormat("%d,%d,%.3f,%.3f,%d,%.3f\n", track.start.query.id,
                             track.start.frame + static_cast<int64_t>(i), s.x, s.y, s.visible ? 1 : 0, s.confidence);
    }
  }
}

// Arrays over points and frames.
class Arrays {
 public:
  Arrays(const TrackTable& table, const TrackExtent& extent)
      : extent_(extent),
        shape_{static_cast<int64_t>(table.tracks().size()), extent.frames},
        xy_(shape_[0] * shape_[1] * 2, std::numeric_limits<float>::quiet_NaN()),
        confidence_(shape_[0] * shape_[1], 0.0f),
        visible_(shape_[0] * shape_[1], '\0') {
    for (size_t n = 0; n < table.tracks().size(); ++n) Fill(table.tracks()[n], static_cast<int64_t>(n) * shape_[1]);
  }

  absl::Status Write(const std::string& path) const {
    const auto bytes = [](const auto& values) {
      return absl::string_view(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(values[0]));
    };
    const auto scalar = [&bytes](int64_t value) { return NpyFile("<i8", {}, bytes(std::vector<int64_t>{value})); };
    return WriteNpz(path, {{"tracks", NpyFile("<f4", {shape_[0], shape_[1], 2}, bytes(xy_))},
                           {"visible", NpyFile("|b1", shape_, bytes(visible_))},
                           {"confidence", NpyFile("<f4", shape_, bytes(confidence_))},
                           {"ids", NpyFile("<i8", {shape_[0]}, bytes(ids_))},
                           {"complete", NpyFile("|b1", {}, std::string(1, extent_.complete ? '\1' : '\0'))},
                           {"final_frames", scalar(extent_.final_frames)},
                           {"expected_frames", scalar(extent_.expected_frames)}});
  }

 private:
  void Fill(const TableTrack& track, int64_t row) {
    ids_.push_back(static_cast<int64_t>(track.start.query.id));
    for (size_t i = 0; i < track.samples.size(); ++i) {
      const TrackSample& sample = track.samples[i];
      if (sample.is_absent()) continue;
      const int64_t at = row + track.start.frame + static_cast<int64_t>(i);
      xy_[2 * at] = sample.x;
      xy_[2 * at + 1] = sample.y;
      confidence_[at] = sample.confidence;
      visible_[at] = sample.visible ? 1 : 0;
    }
  }

  const TrackExtent extent_;
  const std::vector<int64_t> shape_;
  std::vector<float> xy_;
  std::vector<float> confidence_;
  std::string visible_;
  std::vector<int64_t> ids_;
};

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
  return absl::InvalidArgumentError(absl::StrCat(path, ": track files end in .json, .csv, .npz, .dlc.csv or .xml"));
}

absl::Status WriteTracks(const std::string& path, const TrackTable& table, const VideoFacts& video,
                         const TrackExtent& extent) {
  const absl::StatusOr<TrackFormat> format = TrackFormatOf(path);
  if (!format.ok()) return format.status();
  return WriteAtomically(path, [&](const std::string& temporary) {
    if (*format == TrackFormat::kNpz) return Arrays(table, extent).Write(temporary);
    return WriteText(temporary, *format, table, video, extent);
  });
}

}  // namespace holdfast
