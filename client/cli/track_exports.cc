// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_exports.h"

#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"

namespace holdfast {
namespace {

constexpr absl::string_view kScorer = "holdfast";
constexpr int k3deColor = 0;                      // of points in 3DEqualizer: red
constexpr absl::string_view kAnyPoint = "point";  // the label of points without a name

std::string IdOf(const TableTrack& track) { return absl::StrCat(track.start.query.id); }

bool HasName(const TableTrack& track) { return !track.start.name.empty() && track.start.name != IdOf(track); }

// A field of a CSV file that may hold separators (RFC 4180).
std::string Quoted(absl::string_view text) {
  if (text.find_first_of(",\"\r\n") == absl::string_view::npos) return std::string(text);
  return absl::StrCat("\"", absl::StrReplaceAll(text, {{"\"", "\"\""}}), "\"");
}

// One for each track, none twice.
std::vector<std::string> UniqueNames(const TrackTable& table) {
  std::vector<std::string> names;
  std::set<std::string> taken;
  for (const TableTrack& track : table.tracks()) {
    std::string name = HasName(track) ? track.start.name : IdOf(track);
    while (!taken.insert(name).second) absl::StrAppend(&name, "_", IdOf(track));
    names.push_back(std::move(name));
  }
  return names;
}

// XML knows no character below a space but these, not even escaped.
std::string Escaped(absl::string_view text) {
  std::string known;
  for (const char c : text) {
    const bool control = static_cast<unsigned char>(c) < 0x20 && c != '\t' && c != '\n' && c != '\r';
    known += control ? ' ' : c;
  }
  return absl::StrReplaceAll(known, {{"&", "&amp;"}, {"<", "&lt;"}, {">", "&gt;"}, {"\"", "&quot;"}});
}

std::string LabelOf(const TableTrack& track) {
  return HasName(track) ? Escaped(track.start.name) : std::string(kAnyPoint);
}

// CVAT does not import a file with a track that has no shape.
bool HasShape(const TableTrack& track, const TrackExtent& extent) {
  for (int64_t frame = track.first_frame; frame < extent.frames; ++frame) {
    if (TrackTable::Estimate(track, frame) != nullptr) return true;
  }
  return false;
}

// In the input. REQUIRES: extent.frames > 0.
int64_t EndOf(const TrackTable& table, const TrackExtent& extent) { return table.Number(extent.frames - 1) + 1; }

void WriteCvatMeta(std::ostream& out, const TrackTable& table, const VideoFacts& video, const TrackExtent& extent) {
  std::set<std::string> labels;
  for (const TableTrack& track : table.tracks()) {
    if (HasShape(track, extent)) labels.insert(LabelOf(track));
  }
  const int64_t size = extent.frames == 0 ? 0 : EndOf(table, extent) + (extent.input_goes_on ? 1 : 0);
  out << "<meta><task><size>" << size << "</size><mode>interpolation</mode>"
      << "<original_size><width>" << video.size.width << "</width><height>" << video.size.height
      << "</height></original_size>\n<labels>\n";
  for (const std::string& label : labels) {
    out << "<label><name>" << label << "</name><type>points</type><attributes></attributes></label>\n";
  }
  out << "</labels></task></meta>\n";
}

// Whether the position is none of the picture's, whose first pixel is around (0, 0).
bool IsBeyond(const TrackSample& sample, ImageSize size) {
  const auto within = [](float at, int length) { return at >= -0.5f && at < static_cast<float>(length) - 0.5f; };
  return !within(sample.x, size.width) || !within(sample.y, size.height);
}

void WriteCvatPoint(std::ostream& out, int64_t frame, const TrackSample& sample, bool outside) {
  out << absl::StrFormat(
      "  <points frame=\"%d\" keyframe=\"1\" outside=\"%d\" occluded=\"%d\" points=\"%.3f,%.3f\" "
      "z_order=\"0\"></points>\n",
      frame, outside ? 1 : 0, sample.visible ? 0 : 1, sample.x, sample.y);
}

// A shape holds until the next one: where nothing is known any more, the last one is repeated as being outside, behind
// the last frame too where the input has another one.
void WriteCvatTrack(std::ostream& out, const TrackTable& table, const TableTrack& track, ImageSize size,
                    const TrackExtent& extent) {
  out << "<track id=\"" << IdOf(track) << "\" label=\"" << LabelOf(track) << "\" source=\"auto\">\n";
  const TrackSample* before = nullptr;
  for (int64_t frame = track.first_frame; frame < extent.frames; ++frame) {
    const TrackSample* sample = TrackTable::Estimate(track, frame);
    if (sample != nullptr) {
      WriteCvatPoint(out, table.Number(frame), *sample, IsBeyond(*sample, size));
    } else if (before != nullptr) {
      WriteCvatPoint(out, table.Number(frame), *before, /*outside=*/true);
    }
    before = sample;
  }
  if (before != nullptr && extent.input_goes_on) WriteCvatPoint(out, EndOf(table, extent), *before, /*outside=*/true);
  out << "</track>\n";
}

std::string OneLine(absl::string_view text) { return absl::StrReplaceAll(text, {{"\r", " "}, {"\n", " "}}); }

// The curve of one point: its number of keys, and those. From the centre of the upper left pixel to the lower left
// corner of the picture, and from frames that count from 0 to frames that count from 1.
std::string Curve3de(const TrackTable& table, const TableTrack& track, ImageSize size, int64_t* keys) {
  std::string curve;
  for (int64_t frame = track.first_frame; frame < track.first_frame + static_cast<int64_t>(track.samples.size());
       ++frame) {
    const TrackSample* sample = TrackTable::Estimate(track, frame);
    if (sample == nullptr || !sample->visible) continue;
    ++*keys;
    absl::StrAppendFormat(&curve, "%d %.6f %.6f\n", table.Number(frame) + 1, sample->x + 0.5,
                          size.height - (sample->y + 0.5));
  }
  return curve;
}

}  // namespace

void WriteDeepLabCut(std::ostream& out, const TrackTable& table, const TrackExtent& extent) {
  std::string scorers = "scorer", parts = "bodyparts", coords = "coords";
  for (const std::string& name : UniqueNames(table)) {
    const std::string part = Quoted(name);
    for (const char* coord : {"x", "y", "likelihood"}) {
      absl::StrAppend(&scorers, ",", kScorer);
      absl::StrAppend(&parts, ",", part);
      absl::StrAppend(&coords, ",", coord);
    }
  }
  out << scorers << "\n" << parts << "\n" << coords << "\n";
  for (int64_t frame = 0; frame < extent.frames; ++frame) {
    out << table.Number(frame);
    for (const TableTrack& track : table.tracks()) {
      const TrackSample* sample = TrackTable::Estimate(track, frame);
      out << (sample == nullptr ? ",,," : absl::StrFormat(",%.3f,%.3f,%.3f", sample->x, sample->y, sample->confidence));
    }
    out << "\n";
  }
}

void WriteCvat(std::ostream& out, const TrackTable& table, const VideoFacts& video, const TrackExtent& extent) {
  out << "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<annotations>\n<version>1.1</version>\n";
  WriteCvatMeta(out, table, video, extent);
  for (const TableTrack& track : table.tracks()) {
    if (HasShape(track, extent)) WriteCvatTrack(out, table, track, video.size, extent);
  }
  out << "</annotations>\n";
}

void Write3de(std::ostream& out, const TrackTable& table, const VideoFacts& video) {
  const std::vector<std::string> names = UniqueNames(table);
  out << table.tracks().size() << "\n";
  for (size_t i = 0; i < names.size(); ++i) {
    int64_t keys = 0;
    const std::string curve = Curve3de(table, table.tracks()[i], video.size, &keys);
    out << OneLine(names[i]) << "\n" << k3deColor << "\n" << keys << "\n" << curve;
  }
}

}  // namespace holdfast
