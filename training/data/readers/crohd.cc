// SPDX-License-Identifier: Apache-2.0
#include "training/data/readers/crohd.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "training/data/image_files.h"
#include "training/data/track_selection.h"

namespace holdfast {
namespace {

namespace fs = std::filesystem;

constexpr float kBorder = 32;           // pixels; labels nearer to it are wrong too often
constexpr int64_t kMaxFrame = 1000000;  // of a sequence; a larger number in a row is damage

// One head in one frame.
struct Row {
  int64_t frame = 0;  // from 0
  int64_t head = 0;
  cv::Point2f centre;  // pixels
  bool visible = false;
};

// frame, id, left, top, width, height, conf, class, visibility
absl::StatusOr<Row> ParseRow(absl::string_view line) {
  const std::vector<absl::string_view> fields = absl::StrSplit(line, ',');
  std::array<double, 9> value = {};
  if (fields.size() < value.size()) return absl::DataLossError("a row has fewer than 9 fields");
  for (size_t i = 0; i < value.size(); ++i) {
    if (!absl::SimpleAtod(fields[i], &value[i]) || !std::isfinite(value[i])) {
      return absl::DataLossError(absl::StrCat("field ", i + 1, " is not a number"));
    }
  }
  if (value[0] < 1 || value[0] > kMaxFrame) return absl::DataLossError("a frame number is out of range");
  if (std::abs(value[1]) > kMaxFrame) return absl::DataLossError("a head's number is out of range");
  Row row;
  row.frame = static_cast<int64_t>(value[0]) - 1;
  row.head = static_cast<int64_t>(value[1]);
  row.centre = {static_cast<float>(value[2] + value[4] / 2), static_cast<float>(value[3] + value[5] / 2)};
  row.visible = value[8] > 0;
  return row;
}

// Rows of frames first .. first + count - 1, by head.
absl::StatusOr<std::map<int64_t, std::vector<Row>>> ReadRows(const std::string& path, int64_t first, int64_t count) {
  std::ifstream file(path);
  if (!file) return absl::NotFoundError(absl::StrCat("no file ", path));
  std::map<int64_t, std::vector<Row>> heads;
  std::string line;
  for (int64_t number = 1; std::getline(file, line); ++number) {
    if (line.empty() || line == "\r") continue;
    absl::StatusOr<Row> row = ParseRow(line);
    if (!row.ok()) return absl::DataLossError(absl::StrCat(path, ":", number, ": ", row.status().message()));
    if (row->frame < first || row->frame >= first + count) continue;
    row->frame -= first;
    heads[row->head].push_back(*row);
  }
  return heads;
}

void SetLabels(const std::map<int64_t, std::vector<Row>>& heads, ImageSize native, Sample& sample) {
  sample.AllocatePoints(static_cast<int64_t>(heads.size()));
  int64_t n = 0;
  for (const auto& [head, rows] : heads) {
    for (const Row& row : rows) {
      const size_t at = sample.At(row.frame, n);
      sample.SetPosition(row.frame, n, row.centre);
      const bool inside = row.centre.x >= kBorder && row.centre.y >= kBorder &&
                          row.centre.x <= static_cast<float>(native.width) - kBorder &&
                          row.centre.y <= static_cast<float>(native.height) - kBorder;
      sample.valid[at] = inside ? 1 : 0;
      sample.visible[at] = inside && row.visible ? 1 : 0;
    }
    ++n;
  }
}

// Pixels along the valid positions of a track.
double PathLength(const Sample& sample, int64_t n) {
  double length = 0;
  int64_t last = -1;
  for (int64_t s = 0; s < sample.num_frames(); ++s) {
    if (!sample.Valid(s, n)) continue;
    if (last >= 0) {
      const cv::Point2f step = sample.Position(s, n) - sample.Position(last, n);
      length += std::hypot(step.x, step.y);
    }
    last = s;
  }
  return length;
}

class CrohdDataset : public Dataset {
 public:
  struct Clip {
    fs::path sequence;
    int64_t first = 0;  // frame
    int64_t count = 0;  // frames
  };

  CrohdDataset(const CrohdOptions& options, std::vector<Clip> clips) : options_(options), clips_(std::move(clips)) {}

  size_t size() const override { return clips_.size(); }

  absl::StatusOr<Sample> Get(size_t index, Rng&) const override {
    const Clip& clip = clips_[index];
    Sample sample;
    sample.source = absl::StrCat("crohd/", clip.sequence.filename().string(), "/", clip.first);
    sample.fps = 25;
    absl::StatusOr<std::map<int64_t, std::vector<Row>>> heads =
        ReadRows((clip.sequence / "gt" / "gt.txt").string(), clip.first, clip.count);
    if (!heads.ok()) return heads.status();
    absl::StatusOr<cv::Mat> first = ReadFrame(FramePath(clip, 0));
    if (!first.ok()) return first.status();
    const ImageSize native = {first->cols, first->rows};
    std::vector<std::string> paths;
    for (int64_t s = 0; s < clip.count; ++s) paths.push_back(FramePath(clip, s));
    if (absl::Status status = ReadFrames(paths, options_.size, sample); !status.ok()) return status;
    SetLabels(*heads, native, sample);
    SelectTracks(sample);
    if (sample.num_points() == 0)
      return absl::FailedPreconditionError(absl::StrCat(sample.source, " has no good track"));
    ScaleTracks(native, sample);
    return sample;
  }

 private:
  static std::string FramePath(const Clip& clip, int64_t s) {
    return (clip.sequence / "img1" / absl::StrFormat("%06d.jpg", clip.first + s + 1)).string();
  }

  void SelectTracks(Sample& sample) const {
    std::vector<int64_t> good;
    const int64_t start = std::min<int64_t>(2, sample.num_frames());
    for (int64_t n = 0; n < sample.num_points(); ++n) {
      bool seen = true;
      for (int64_t s = 0; s < start; ++s) seen = seen && sample.Visible(s, n);
      if (seen && PathLength(sample, n) >= options_.min_path_px) good.push_back(n);
    }
    sample.SelectPoints(EvenlyPicked(good, options_.points));
  }

  const CrohdOptions options_;
  const std::vector<Clip> clips_;
};

int64_t CountImages(const fs::path& folder) {
  std::error_code error;
  int64_t count = 0;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    if (it->path().extension() == ".jpg") ++count;
  }
  return count;
}

std::vector<fs::path> FindSequences(const fs::path& root) {
  for (const fs::path& folder : {root, root / "train", root / "HT21" / "train"}) {
    std::vector<fs::path> found;
    std::error_code error;
    for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
      if (Exists(it->path() / "gt" / "gt.txt")) found.push_back(it->path());
    }
    std::sort(found.begin(), found.end());
    if (!found.empty()) return found;
  }
  return {};
}

}  // namespace

absl::StatusOr<std::unique_ptr<Dataset>> Crohd::Create(const CrohdOptions& options) {
  if (options.clip_frames < 2 || options.min_frames < 2) {
    return absl::InvalidArgumentError("clips must have two frames at least");
  }
  std::vector<CrohdDataset::Clip> clips;
  for (const fs::path& sequence : FindSequences(options.root)) {
    const int64_t frames = CountImages(sequence / "img1");
    for (int64_t first = 0; first < frames; first += std::max<int64_t>(options.clip_frames / 2, 1)) {
      const int64_t count = std::min(options.clip_frames, frames - first);
      if (count >= options.min_frames) clips.push_back({sequence, first, count});
    }
  }
  if (clips.empty()) return absl::NotFoundError(absl::StrCat("no CroHD sequences below ", options.root));
  return std::unique_ptr<Dataset>(std::make_unique<CrohdDataset>(options, std::move(clips)));
}

}  // namespace holdfast
