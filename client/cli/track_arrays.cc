// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_arrays.h"

#include <iconv.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "absl/container/flat_hash_map.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "api/limits.h"
#include "io/npz_writer.h"

namespace holdfast {
namespace {

using Shape = std::vector<int64_t>;

template <typename T>
std::string Array(const Shape& shape, const std::vector<T>& values) {
  const char* dtype = std::is_same_v<T, float> ? "<f4" : std::is_same_v<T, double> ? "<f8" : "<i8";
  return NpyFile(dtype, shape, {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)});
}

std::string Flag(bool value) { return NpyFile("|b1", {}, std::string(1, value ? '\1' : '\0')); }

// The code points of UTF-8, up to the first byte that is none.
std::u32string CodePoints(std::string text) {
  static_assert(sizeof(wchar_t) == sizeof(char32_t));
  std::u32string points(text.size(), U'\0');
  char* from = text.data();
  char* to = reinterpret_cast<char*>(points.data());
  size_t left = text.size(), room = points.size() * sizeof(char32_t);
  const iconv_t converter = iconv_open("WCHAR_T", "UTF-8");
  iconv(converter, &from, &left, &to, &room);
  iconv_close(converter);
  points.resize(points.size() - room / sizeof(char32_t));
  return points;
}

// [N] texts, each as long as the longest.
std::string Texts(const std::vector<std::string>& texts) {
  std::vector<std::u32string> unicode;
  size_t longest = 1;
  for (const std::string& text : texts) {
    unicode.push_back(CodePoints(text));
    longest = std::max(longest, unicode.back().size());
  }
  std::u32string all;
  for (std::u32string& text : unicode) all += text.append(longest - text.size(), U'\0');
  return NpyFile(absl::StrCat("<U", longest), {static_cast<int64_t>(texts.size())},
                 {reinterpret_cast<const char*>(all.data()), all.size() * sizeof(char32_t)});
}

// Of estimates: [N, T, 2], [N, T], [N, T].
struct Estimates {
  explicit Estimates(int64_t samples)
      : xy(2 * samples, std::numeric_limits<float>::quiet_NaN()), confidence(samples, 0.0f), visible(samples, '\0') {}

  void Fill(const TableTrack& track, int64_t row) {
    for (size_t i = 0; i < track.samples.size(); ++i) {
      const TrackSample& sample = track.samples[i];
      if (sample.is_absent()) continue;
      const int64_t at = row + track.first_frame + static_cast<int64_t>(i);
      xy[2 * at] = sample.x;
      xy[2 * at + 1] = sample.y;
      confidence[at] = sample.confidence;
      visible[at] = sample.visible ? 1 : 0;
    }
  }

  std::vector<float> xy;
  std::vector<float> confidence;
  std::string visible;
};

// Seconds since 1970 of each frame, NaN where it is not known; empty where it never is.
std::vector<double> CaptureTimes(const TrackTable& table, int64_t frames) {
  std::vector<double> seconds;
  bool known = false;
  for (int64_t frame = 0; frame < frames; ++frame) {
    const auto time = table.CaptureTime(frame);
    known |= time.has_value();
    seconds.push_back(time ? absl::ToDoubleSeconds(*time - absl::UnixEpoch())
                           : std::numeric_limits<double>::quiet_NaN());
  }
  return known ? seconds : std::vector<double>();
}

using Arrays = std::vector<std::pair<std::string, std::string>>;

// Of each point the object that it belongs to and the row of the point whose place it has taken, -1 where there is
// none, and on which frames it has left: [N], [N], [N, T].
void AddMembership(const TrackTable& table, int64_t frames, Arrays& arrays) {
  const auto points = static_cast<int64_t>(table.tracks().size());
  std::vector<int64_t> objects(points, -1), replaces(points, -1);
  std::string left(points * frames, '\0');
  absl::flat_hash_map<PointId, int64_t> rows;
  for (int64_t row = 0; row < points; ++row) rows[table.tracks()[row].start.query.id] = row;
  for (int64_t row = 0; row < points; ++row) {
    const TableTrack& track = table.tracks()[row];
    if (table.IsOfObject(track)) objects[row] = table.object()->start.query.id;
    if (table.WasPlacedAnew(track)) replaces[row] = rows.at(track.start.query.id - kMaxObjectPoints);
  }
  for (int64_t frame = 0; frame < frames; ++frame) {
    const ObjectSample* sample = table.ObjectEstimate(frame);
    if (sample == nullptr) continue;
    for (const PointId id : sample->left) {
      if (const auto row = rows.find(id); row != rows.end()) left[row->second * frames + frame] = 1;
    }
  }
  arrays.emplace_back("of_object", Array({points}, objects));
  arrays.emplace_back("replaces", Array({points}, replaces));
  arrays.emplace_back("left", NpyFile("|b1", {points, frames}, left));
}

// Of the O = 1 objects.
void AddObject(const TrackTable& table, int64_t frames, Arrays& arrays) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  size_t corners = 0;
  for (int64_t frame = 0; frame < frames; ++frame) {
    const ObjectSample* sample = table.ObjectEstimate(frame);
    if (sample != nullptr) corners = std::max(corners, sample->outline.size());
  }
  std::vector<float> centre(2 * frames, kNan), scale(frames, kNan), rotation(frames, kNan), visible(frames, 0);
  std::vector<float> outline(2 * frames * corners, kNan);
  for (int64_t frame = 0; frame < frames; ++frame) {
    const ObjectSample* sample = table.ObjectEstimate(frame);
    if (sample == nullptr) continue;
    centre[2 * frame] = sample->centre.x;
    centre[2 * frame + 1] = sample->centre.y;
    scale[frame] = sample->scale;
    rotation[frame] = sample->rotation;
    visible[frame] = sample->visible;
    size_t at = 2 * frame * corners;
    for (const Pixel& corner : sample->outline) {
      outline[at++] = corner.x;
      outline[at++] = corner.y;
    }
  }
  arrays.emplace_back("object_ids", Array<int64_t>({1}, {table.object()->start.query.id}));
  arrays.emplace_back("object_centre", Array({1, frames, 2}, centre));
  arrays.emplace_back("object_scale", Array({1, frames}, scale));
  arrays.emplace_back("object_rotation", Array({1, frames}, rotation));
  arrays.emplace_back("object_visible", Array({1, frames}, visible));
  arrays.emplace_back("object_outline", Array({1, frames, static_cast<int64_t>(corners), 2}, outline));
}

}  // namespace

std::vector<std::pair<std::string, std::string>> TrackArrays(const TrackTable& table, const VideoFacts& video,
                                                             const TrackExtent& extent) {
  const auto points = static_cast<int64_t>(table.tracks().size());
  Estimates estimates(points * extent.frames);
  std::vector<int64_t> ids, query_frames, frames;
  std::vector<std::string> names;
  for (const TableTrack& track : table.tracks()) {
    estimates.Fill(track, static_cast<int64_t>(ids.size()) * extent.frames);
    ids.push_back(static_cast<int64_t>(track.start.query.id));
    names.push_back(track.start.name);
    query_frames.push_back(track.start.frame);
  }
  for (int64_t frame = 0; frame < extent.frames; ++frame) frames.push_back(table.Number(frame));
  Arrays arrays = {{"tracks", Array({points, extent.frames, 2}, estimates.xy)},
                   {"visible", NpyFile("|b1", {points, extent.frames}, estimates.visible)},
                   {"confidence", Array({points, extent.frames}, estimates.confidence)},
                   {"ids", Array({points}, ids)},
                   {"names", Texts(names)},
                   {"query_frames", Array({points}, query_frames)},
                   {"frames", Array({extent.frames}, frames)},
                   {"size", Array<int64_t>({2}, {video.size.width, video.size.height})},
                   {"fps", Array<double>({}, {video.fps})},
                   {"complete", Flag(extent.complete)},
                   {"final_frames", Array<int64_t>({}, {extent.final_frames})},
                   {"expected_frames", Array<int64_t>({}, {extent.expected_frames})}};
  const std::vector<double> times = CaptureTimes(table, extent.frames);
  if (!times.empty()) arrays.emplace_back("capture_times", Array({extent.frames}, times));
  if (table.object()) {
    AddMembership(table, extent.frames, arrays);
    AddObject(table, extent.frames, arrays);
  }
  return arrays;
}

}  // namespace holdfast
