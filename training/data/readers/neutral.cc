// SPDX-License-Identifier: Apache-2.0
#include "training/data/readers/neutral.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "training/data/image_files.h"
#include "training/data/track_selection.h"

namespace holdfast {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr double kFar = 1e6;  // pixels; no position is further out

absl::Status Wrong(const std::string& path, absl::string_view what) {
  return absl::DataLossError(absl::StrCat(path, ": ", what));
}

// A number of the object, or 'otherwise' where the key is missing; NaN where it is no number.
double Number(const json& object, const char* key, double otherwise) {
  const auto found = object.find(key);
  if (found == object.end()) return otherwise;
  return found->is_number() ? found->get<double>() : std::nan("");
}

absl::StatusOr<json> ReadTracksFile(const std::string& path) {
  std::ifstream file(path);
  if (!file) return absl::NotFoundError(absl::StrCat("no file ", path));
  json tracks = json::parse(std::istreambuf_iterator<char>(file), {}, nullptr, false);
  if (!tracks.is_object()) return Wrong(path, "not a JSON object");
  const auto points = tracks.find("points");
  if (points == tracks.end() || !points->is_array()) return Wrong(path, "'points' is not a list");
  const double width = Number(tracks, "width", 0), height = Number(tracks, "height", 0);
  if (!(width >= 1 && height >= 1 && width <= 65536 && height <= 65536)) return Wrong(path, "no size of the frames");
  return tracks;
}

// Sets the labels of point n from one entry of 'frames', 'xy' and 'visible'; false if it is malformed. The sample
// begins at frame 'first' of the clip.
bool SetLabel(const json& frame, const json& xy, const json& visible, int64_t first, int64_t n, int64_t& last,
              Sample& sample) {
  if (!frame.is_number_integer() || !(visible.is_boolean() || visible.is_number())) return false;
  const int64_t number = frame.get<int64_t>();
  const bool seen = visible.is_boolean() ? visible.get<bool>() : visible.get<double>() != 0;
  if (number <= last) return false;
  last = number;
  const int64_t s = number - first;
  const bool asked_for = s >= 0 && s < sample.num_frames();  // of a part of the clip, perhaps
  if (xy.is_null()) {
    if (asked_for) sample.SetHidden(s, n);
    return !seen;
  }
  if (!xy.is_array() || xy.size() != 2 || !xy[0].is_number() || !xy[1].is_number()) return false;
  const double x = xy[0].get<double>(), y = xy[1].get<double>();
  if (!(std::abs(x) < kFar && std::abs(y) < kFar)) return false;
  if (!asked_for) return true;
  const cv::Point2f position(static_cast<float>(x), static_cast<float>(y));
  sample.SetPosition(s, n, position);
  sample.valid[sample.At(s, n)] = 1;
  sample.visible[sample.At(s, n)] = seen && sample.Inside(position) ? 1 : 0;
  return true;
}

bool SetPoint(const json& point, int64_t first, int64_t n, Sample& sample) {
  if (!point.is_object()) return false;
  const auto frames = point.find("frames"), xy = point.find("xy"), visible = point.find("visible");
  for (const auto& list : {frames, xy, visible}) {
    if (list == point.end() || !list->is_array() || list->size() != frames->size()) return false;
  }
  int64_t last = -1;
  for (size_t i = 0; i < frames->size(); ++i) {
    if (!SetLabel((*frames)[i], (*xy)[i], (*visible)[i], first, n, last, sample)) return false;
  }
  const double object = Number(point, "object", 0);
  if (!(object >= 0 && object <= 65535)) return false;
  sample.object_ids[static_cast<size_t>(n)] = static_cast<int32_t>(object);
  return true;
}

// The last frame that has a label; -1: none.
int64_t LastLabelled(const json& tracks) {
  int64_t last = -1;
  for (const json& point : tracks["points"]) {
    const auto frames = point.is_object() ? point.find("frames") : point.end();
    if (frames == point.end() || !frames->is_array()) continue;
    for (const json& frame : *frames) {
      if (frame.is_number_integer()) last = std::max(last, frame.get<int64_t>());
    }
  }
  return last;
}

std::string PictureName(int64_t number) { return absl::StrFormat("%05d.jpg", number); }

// Of %05d.jpg or .png.
std::optional<int64_t> NumberOf(const fs::path& file) {
  const std::string extension = file.extension().string(), stem = file.stem().string();
  int64_t number = -1;
  if ((extension != ".jpg" && extension != ".png") || !absl::SimpleAtoi(stem, &number) || number < 0) return {};
  if (absl::StrFormat("%05d", number) != stem) return {};
  return number;
}

absl::Status Missing(const fs::path& folder, int64_t number, absl::string_view why) {
  return absl::DataLossError(absl::StrCat((folder / PictureName(number)).string(), " is missing, though ", why));
}

// The folder's numbered pictures from 0 on, 'most' of them if that is not 0. DATA_LOSS where one is missing before
// another.
absl::StatusOr<std::vector<std::string>> NumberedFiles(const fs::path& folder, int64_t most) {
  std::map<int64_t, std::string> found;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const std::optional<int64_t> number = NumberOf(it->path());
    if (number && (found.count(*number) == 0 || it->path().extension() == ".jpg")) found[*number] = it->path().string();
  }
  std::vector<std::string> paths;
  for (const auto& [number, path] : found) {
    const int64_t count = static_cast<int64_t>(paths.size());
    if (most > 0 && count == most) break;
    if (number != count) return Missing(folder, count, absl::StrCat("there is ", path));
    paths.push_back(path);
  }
  return paths;
}

// 'count' of 'paths' from 'first' on; none of none.
std::vector<std::string> Part(const std::vector<std::string>& paths, int64_t first, int64_t count) {
  if (paths.empty()) return {};
  return {paths.begin() + first, paths.begin() + first + count};
}

class NeutralDataset : public Dataset {
 public:
  NeutralDataset(const NeutralOptions& options, std::vector<fs::path> clips)
      : options_(options), clips_(std::move(clips)) {}

  size_t size() const override { return clips_.size(); }

  absl::StatusOr<Sample> Get(size_t index, Rng& rng) const override {
    const fs::path& clip = clips_[index];
    Sample sample;
    sample.source = absl::StrCat("neutral/", clip.filename().string());
    const std::string tracks_path = (clip / "tracks.json").string();
    absl::StatusOr<json> tracks = ReadTracksFile(tracks_path);
    if (!tracks.ok()) return tracks.status();
    const absl::StatusOr<int64_t> first = ReadPictures(clip, LastLabelled(*tracks), rng, sample);
    if (!first.ok()) return first.status();
    if (absl::Status status = SetPoints(*tracks, tracks_path, *first, sample); !status.ok()) return status;
    std::vector<int64_t> points(static_cast<size_t>(sample.num_points()));
    for (size_t n = 0; n < points.size(); ++n) points[n] = static_cast<int64_t>(n);
    if (options_.points > 0) sample.SelectPoints(EvenlyPicked(points, options_.points));
    // What is hidden nobody knows where is of no use to who wants clips of one length, to train.
    if (options_.frames > 0) sample.hidden.clear();
    return sample;
  }

 private:
  // Those of the part of the clip that is asked for, and no others; returns the first one's number.
  absl::StatusOr<int64_t> ReadPictures(const fs::path& clip, int64_t last_labelled, Rng& rng, Sample& sample) const {
    const fs::path folder = clip / "frames";
    const absl::StatusOr<std::vector<std::string>> frames = NumberedFiles(folder, options_.max_frames);
    if (!frames.ok()) return frames.status();
    if (frames->empty()) return absl::NotFoundError(absl::StrCat("no frames in ", folder.string()));
    const absl::StatusOr<std::vector<std::string>> masks = NumberedFiles(clip / "masks", options_.max_frames);
    if (!masks.ok()) return masks.status();
    if (!masks->empty() && masks->size() != frames->size()) {
      return absl::DataLossError(absl::StrCat(clip.string(), " has masks for some frames only"));
    }
    int64_t first = 0, count = static_cast<int64_t>(frames->size());
    const bool whole = options_.frames == 0 && count != options_.max_frames;
    if (whole && last_labelled >= count) return Missing(folder, count, "points are labelled there or later");
    if (options_.frames > 0) {
      const int64_t spare = count - options_.frames;
      if (spare < 0) {
        return absl::FailedPreconditionError(
            absl::StrCat(sample.source, " has fewer than ", options_.frames, " frames"));
      }
      first = rng.Integer(0, spare);
      count = options_.frames;
      absl::StrAppend(&sample.source, "/", first);
    }
    if (absl::Status status = ReadFrames(Part(*frames, first, count), {}, sample); !status.ok()) return status;
    if (absl::Status status = ReadMasks(Part(*masks, first, count), sample); !status.ok()) return status;
    return first;
  }

  static absl::Status SetPoints(const json& tracks, const std::string& path, int64_t first, Sample& sample) {
    const cv::Size2d size(tracks["width"].get<double>(), tracks["height"].get<double>());
    if (size != cv::Size2d(sample.size().width, sample.size().height))
      return Wrong(path, "another size than the frames");
    sample.fps = Number(tracks, "fps", 0);
    const json& points = tracks["points"];
    sample.AllocatePoints(static_cast<int64_t>(points.size()));
    for (int64_t n = 0; n < sample.num_points(); ++n) {
      if (!SetPoint(points[static_cast<size_t>(n)], first, n, sample))
        return Wrong(path, absl::StrCat("point ", n, " is malformed"));
    }
    return absl::OkStatus();
  }

  const NeutralOptions options_;
  const std::vector<fs::path> clips_;
};

// The pictures and tracks that the format names, and nothing else. Tracks first: without them there is no clip.
absl::Status RemoveClip(const fs::path& root) {
  std::vector<fs::path> files = {root / "tracks.json"};
  std::error_code error;
  for (const char* folder : {"frames", "masks"}) {
    std::error_code none;
    for (fs::directory_iterator it(root / folder, none), end; !none && it != end; it.increment(none)) {
      if (NumberOf(it->path())) files.push_back(it->path());
    }
  }
  for (const fs::path& file : files) {
    fs::remove(file, error);
    if (error && Exists(file)) return absl::UnavailableError(absl::StrCat("cannot remove ", file.string()));
  }
  return absl::OkStatus();
}

json PointJson(const Sample& sample, int64_t n) {
  json point = {{"name", absl::StrCat("p", n)}, {"object", sample.object_ids[static_cast<size_t>(n)]}};
  json &frames = point["frames"] = json::array(), &xy = point["xy"] = json::array(),
       &visible = point["visible"] = json::array();
  for (int64_t s = 0; s < sample.num_frames(); ++s) {
    if (!sample.hidden.empty() && sample.hidden[sample.At(s, n)] != 0) {
      frames.push_back(s);
      xy.push_back(nullptr);
      visible.push_back(false);
    }
    if (!sample.Valid(s, n)) continue;
    const cv::Point2f at = sample.Position(s, n);
    frames.push_back(s);
    xy.push_back({std::round(at.x * 1000.0) / 1000, std::round(at.y * 1000.0) / 1000});
    visible.push_back(sample.Visible(s, n));
  }
  return point;
}

absl::Status WriteTracks(const Sample& sample, const fs::path& path) {
  json tracks = {{"width", sample.size().width}, {"height", sample.size().height}, {"fps", sample.fps}};
  tracks["points"] = json::array();
  for (int64_t n = 0; n < sample.num_points(); ++n) tracks["points"].push_back(PointJson(sample, n));
  std::ofstream file(path);
  file << tracks.dump() << "\n";
  file.close();
  if (!file) return absl::UnavailableError(absl::StrCat("cannot write ", path.string()));
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::unique_ptr<Dataset>> Neutral::Create(const NeutralOptions& options) {
  if (options.frames < 0 || options.max_frames < 0 || options.points < 0) {
    return absl::InvalidArgumentError("counts must not be negative");
  }
  std::vector<fs::path> clips;
  std::error_code error;
  if (Exists(fs::path(options.root) / "tracks.json")) clips.emplace_back(options.root);
  const bool folder_of_clips = clips.empty();
  for (fs::directory_iterator it(options.root, error), end; folder_of_clips && !error && it != end;
       it.increment(error)) {
    if (Exists(it->path() / "tracks.json")) clips.push_back(it->path());
  }
  std::sort(clips.begin(), clips.end());
  if (clips.empty()) return absl::NotFoundError(absl::StrCat("no clips (tracks.json) in ", options.root));
  return std::unique_ptr<Dataset>(std::make_unique<NeutralDataset>(options, std::move(clips)));
}

absl::Status WriteNeutral(const Sample& sample, const std::string& directory) {
  const fs::path root(directory);
  std::error_code error;
  if (absl::Status status = RemoveClip(root); !status.ok()) return status;
  for (const char* folder : {"frames", "masks"}) {
    if (folder[0] == 'm' && !sample.has_masks()) continue;
    fs::create_directories(root / folder, error);
    if (error) return absl::UnavailableError(absl::StrCat("cannot make ", (root / folder).string()));
  }
  for (size_t s = 0; s < sample.frames.size(); ++s) {
    absl::Status written =
        WriteFrame((root / "frames" / PictureName(static_cast<int64_t>(s))).string(), sample.frames[s]);
    if (written.ok() && sample.has_masks()) {
      written = WriteMask((root / "masks" / absl::StrFormat("%05d.png", s)).string(), sample.masks[s]);
    }
    if (!written.ok()) return written;
  }
  return WriteTracks(sample, root / "tracks.json");
}

}  // namespace holdfast
