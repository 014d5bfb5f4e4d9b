// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_arrays.h"

#include <iconv.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
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
  std::vector<std::pair<std::string, std::string>> arrays = {
      {"tracks", Array({points, extent.frames, 2}, estimates.xy)},
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
  return arrays;
}

}  // namespace holdfast
