// SPDX-License-Identifier: Apache-2.0
#include "training/data/readers/point_odyssey.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "io/npz_reader.h"
#include "training/data/image_files.h"
#include "training/data/track_selection.h"

namespace holdfast {
namespace {

namespace fs = std::filesystem;

constexpr int kHolePixels = 128;  // holes of a mask that are larger get filled

struct Sequence {
  fs::path folder;
  fs::path annotations;
  int64_t frames = 0;
  bool has_masks = false;
};

// The rows of the label arrays at the clip's frames.
struct Labels {
  int64_t points = 0;
  std::vector<float> xy;       // [S, P, 2]
  std::vector<float> visible;  // [S, P] 1 is visible
  std::vector<float> valid;    // [S, P] 0 is invalid
};

absl::StatusOr<std::vector<float>> ReadFlags(const NpzFile& npz, absl::string_view name, const NpyRows& trajectories,
                                             const std::vector<int64_t>& rows) {
  absl::StatusOr<NpyRows> flags = npz.ReadRows(name, rows);
  if (!flags.ok()) return flags.status();
  if (flags->shape != std::vector<int64_t>{trajectories.shape[0], trajectories.shape[1]}) {
    return absl::DataLossError(absl::StrCat("'", name, "' does not have the frames and points of 'trajs_2d'"));
  }
  return std::move(flags->values);
}

absl::StatusOr<Labels> ReadLabels(const std::string& path, const std::vector<int64_t>& rows) {
  absl::StatusOr<NpzFile> npz = NpzFile::Open(path);
  if (!npz.ok()) return npz.status();
  absl::StatusOr<NpyRows> trajectories = npz->ReadRows("trajs_2d", rows);
  if (!trajectories.ok()) return trajectories.status();
  if (trajectories->shape.size() != 3 || trajectories->shape[2] != 2) {
    return absl::DataLossError(absl::StrCat(path, ": 'trajs_2d' is not [frames, points, 2]"));
  }
  const bool older = !npz->Has("visibs");  // one array: 1 visible, 0 hidden, 2 and more invalid
  absl::StatusOr<std::vector<float>> visible = ReadFlags(*npz, older ? "visibilities" : "visibs", *trajectories, rows);
  if (!visible.ok()) return absl::Status(visible.status().code(), absl::StrCat(path, ": ", visible.status().message()));
  Labels labels{trajectories->shape[1], std::move(trajectories->values), *std::move(visible), {}};
  if (older || !npz->Has("valids")) {
    for (const float v : labels.visible) labels.valid.push_back(v < 2 ? 1.f : 0.f);
    return labels;
  }
  absl::StatusOr<std::vector<float>> valid = ReadFlags(*npz, "valids", *trajectories, rows);
  if (!valid.ok()) return absl::Status(valid.status().code(), absl::StrCat(path, ": ", valid.status().message()));
  labels.valid = *std::move(valid);
  return labels;
}

void SetLabels(const Labels& labels, Sample& sample) {
  constexpr float kFar = 1e6f;  // pixels; beyond, differences of positions lose their meaning
  sample.AllocatePoints(labels.points);
  for (size_t i = 0; i < sample.valid.size(); ++i) {
    const float x = labels.xy[2 * i], y = labels.xy[2 * i + 1];
    if (!(std::abs(x) < kFar && std::abs(y) < kFar)) continue;  // NaN and infinity too
    sample.tracks[2 * i] = x;
    sample.tracks[2 * i + 1] = y;
    sample.valid[i] = labels.valid[i] != 0 ? 1 : 0;
    sample.visible[i] = sample.valid[i] != 0 && labels.visible[i] == 1 ? 1 : 0;
  }
}

class PointOdysseyDataset : public Dataset {
 public:
  struct Clip {
    size_t sequence = 0;
    int64_t start = 0;   // frame of the source
    int64_t stride = 1;  // frames of the source
    int64_t frames = 0;
  };

  PointOdysseyDataset(const PointOdysseyOptions& options, std::vector<Sequence> sequences, std::vector<Clip> clips)
      : options_(options), sequences_(std::move(sequences)), clips_(std::move(clips)) {}

  size_t size() const override { return clips_.size(); }

  absl::StatusOr<Sample> Get(size_t index, Rng&) const override {
    const Clip& clip = clips_[index];
    const Sequence& sequence = sequences_[clip.sequence];
    Sample sample;
    sample.source = absl::StrCat("pointodyssey/", options_.split, "/", sequence.folder.filename().string());
    sample.fps = 30.0 / static_cast<double>(clip.stride);
    std::vector<int64_t> rows;
    for (int64_t s = 0; s < clip.frames; ++s) rows.push_back(clip.start + s * clip.stride);
    absl::StatusOr<Labels> labels = ReadLabels(sequence.annotations.string(), rows);
    if (!labels.ok()) return labels.status();
    if (absl::Status status = ReadPictures(sequence, rows, sample); !status.ok()) return status;
    SetLabels(*labels, sample);
    SelectTracks(sample);
    if (sample.num_points() == 0)
      return absl::FailedPreconditionError(absl::StrCat(sample.source, " has no good track"));
    return sample;
  }

 private:
  absl::Status ReadPictures(const Sequence& sequence, const std::vector<int64_t>& rows, Sample& sample) const {
    std::vector<std::string> frames, masks;
    for (const int64_t row : rows) {
      frames.push_back((sequence.folder / "rgbs" / absl::StrFormat("rgb_%05d.jpg", row)).string());
      masks.push_back((sequence.folder / "masks" / absl::StrFormat("mask_%05d.png", row)).string());
    }
    absl::Status status = ReadFrames(frames, {}, sample);
    if (!status.ok() || !options_.masks || !sequence.has_masks) return status;
    status = ReadMasks(masks, sample);
    for (cv::Mat& mask : sample.masks) FillHoles(kHolePixels, mask);
    return status;
  }

  void SelectTracks(Sample& sample) const {
    const bool whole = options_.frames == 0;
    const TrackRules rules = whole ? TrackRules::Evaluation() : TrackRules::Training();
    MarkOutside(rules, sample);
    std::vector<int64_t> good = GoodTracks(rules, sample);
    if (options_.points > 0) {
      good = whole ? EvenlyPicked(good, options_.points) : SpreadOut(sample, good, options_.points);
    }
    sample.SelectPoints(good);
    for (int64_t n = 0; n < sample.num_points(); ++n) {
      sample.object_ids[static_cast<size_t>(n)] = sample.IdAt(0, sample.Position(0, n));
    }
  }

  const PointOdysseyOptions options_;
  const std::vector<Sequence> sequences_;
  const std::vector<Clip> clips_;
};

int64_t CountFiles(const fs::path& folder, const std::string& extension) {
  std::error_code error;
  int64_t count = 0;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    if (it->path().extension() == extension) ++count;
  }
  return count;
}

std::vector<Sequence> SequencesOf(const fs::path& split) {
  std::vector<Sequence> sequences;
  std::error_code error;
  for (fs::directory_iterator it(split, error), end; !error && it != end; it.increment(error)) {
    for (const char* name : {"anno.npz", "annotations.npz"}) {
      const fs::path annotations = it->path() / name;
      if (!Exists(annotations)) continue;
      sequences.push_back({it->path(), annotations, CountFiles(it->path() / "rgbs", ".jpg"),
                           CountFiles(it->path() / "masks", ".png") > 0});
      break;
    }
  }
  std::sort(sequences.begin(), sequences.end(),
            [](const Sequence& a, const Sequence& b) { return a.folder < b.folder; });
  return sequences;
}

std::vector<PointOdysseyDataset::Clip> FindClips(const PointOdysseyOptions& options,
                                                 const std::vector<Sequence>& sequences) {
  std::vector<PointOdysseyDataset::Clip> clips;
  for (size_t i = 0; i < sequences.size(); ++i) {
    const int64_t all = sequences[i].frames;
    if (options.frames == 0) {
      const int64_t frames = options.max_frames > 0 ? std::min(options.max_frames, all) : all;
      if (frames > 1) clips.push_back({i, 0, 1, frames});
      continue;
    }
    for (const int64_t stride : options.strides) {
      for (int64_t start = 0; start + (options.frames - 1) * stride < all; start += options.start_step) {
        clips.push_back({i, start, stride, options.frames});
      }
    }
  }
  return clips;
}

absl::Status Check(const PointOdysseyOptions& options) {
  const bool strides = std::all_of(options.strides.begin(), options.strides.end(), [](int64_t s) { return s > 0; });
  if (options.frames < 0 || options.frames == 1) return absl::InvalidArgumentError("frames must be 0 or at least 2");
  if (!strides || options.start_step < 1) return absl::InvalidArgumentError("strides and start_step must be positive");
  if (options.points < 0 || options.max_frames < 0) return absl::InvalidArgumentError("counts must not be negative");
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::unique_ptr<Dataset>> PointOdyssey::Create(const PointOdysseyOptions& options) {
  if (absl::Status status = Check(options); !status.ok()) return status;
  const fs::path split = fs::path(options.root) / options.split;
  std::vector<Sequence> sequences = SequencesOf(split);
  std::vector<PointOdysseyDataset::Clip> clips = FindClips(options, sequences);
  if (clips.empty()) return absl::NotFoundError(absl::StrCat("no PointOdyssey sequences in ", split.string()));
  return std::unique_ptr<Dataset>(
      std::make_unique<PointOdysseyDataset>(options, std::move(sequences), std::move(clips)));
}

}  // namespace holdfast
