// SPDX-License-Identifier: Apache-2.0
#include "training/data/synthetic/synthetic_dataset.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "absl/memory/memory.h"
#include "absl/strings/str_cat.h"
#include "training/data/photometric.h"
#include "training/data/synthetic/point_choice.h"
#include "training/data/synthetic/renderer.h"
#include "training/data/synthetic/scene.h"

namespace holdfast {
namespace {

constexpr int32_t kBackground = 1;
constexpr float kFarOutside = 64;  // pixels; labels further out are not valid
constexpr uint64_t kGrainSeed = 7;

absl::Status CheckShare(const char* name, double value) {
  if (value >= 0 && value <= 1) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(name, " must be in [0, 1], got ", value));
}

double MotionOf(const SyntheticOptions& options, size_t index) {
  if (options.motion_ramp_clips <= 0) return options.motion_strength;
  const double done = std::min(1.0, static_cast<double>(index) / static_cast<double>(options.motion_ramp_clips));
  return options.motion_strength * (options.motion_ramp_start + (1 - options.motion_ramp_start) * done);
}

const Layer& LayerOf(const Scene& scene, int32_t id) { return scene.layers[static_cast<size_t>(id - kBackground)]; }

bool NearFrame(cv::Point2f xy, cv::Size size) {
  return xy.x >= -kFarOutside && xy.y >= -kFarOutside && xy.x <= static_cast<float>(size.width) - 1 + kFarOutside &&
         xy.y <= static_cast<float>(size.height) - 1 + kFarOutside;
}

// Sets the labels of point n on every frame from the layer and the place on its plane.
void TrackPoint(const Scene& scene, const std::vector<PlaneMap>& maps, cv::Point2d plane, int64_t n, Sample& sample) {
  const int32_t id = sample.object_ids[static_cast<size_t>(n)];
  for (int64_t s = 0; s < sample.num_frames(); ++s) {
    const cv::Point2d exact = maps[static_cast<size_t>(s)].ImageFromPlane(plane);
    const cv::Point2f xy(static_cast<float>(exact.x), static_cast<float>(exact.y));
    const size_t at = sample.At(s, n);
    sample.SetPosition(s, n, xy);
    sample.valid[at] = NearFrame(xy, scene.size) ? 1 : 0;
    sample.visible[at] = sample.Inside(xy) && sample.IdAt(s, xy) == id ? 1 : 0;
  }
}

void TrackPoints(const Scene& scene, const std::vector<cv::Point2d>& starts, Sample& sample) {
  std::vector<std::vector<PlaneMap>> maps(scene.layers.size());  // of every layer and frame, made when needed
  for (int64_t n = 0; n < sample.num_points(); ++n) {
    const cv::Point2d start = starts[static_cast<size_t>(n)];
    const int32_t id = sample.masks[0].at<int32_t>(cvRound(start.y), cvRound(start.x));
    const Layer& layer = LayerOf(scene, id);
    std::vector<PlaneMap>& layer_maps = maps[static_cast<size_t>(id - kBackground)];
    for (int64_t s = static_cast<int64_t>(layer_maps.size()); s < sample.num_frames(); ++s) {
      layer_maps.push_back(scene.MapAt(layer, static_cast<double>(s)));
    }
    sample.object_ids[static_cast<size_t>(n)] = id;
    TrackPoint(scene, layer_maps, layer_maps[0].PlaneFromImage(start), n, sample);
  }
}

Sample RenderClip(const Scene& scene, int64_t frames) {
  Sample sample;
  sample.frames.resize(static_cast<size_t>(frames));
  sample.masks.resize(static_cast<size_t>(frames));
  Renderer renderer(scene);
  for (size_t s = 0; s < sample.frames.size(); ++s) {
    renderer.Render(static_cast<double>(s), sample.frames[s], sample.masks[s]);
  }
  return sample;
}

}  // namespace

absl::Status SyntheticOptions::Validate() const {
  constexpr int kMaxSide = 8192;
  if (frames < 2 || frames > 100000) return absl::InvalidArgumentError("frames must be in [2, 100000]");
  if (height < 32 || width < 32 || height > kMaxSide || width > kMaxSide) {
    return absl::InvalidArgumentError(absl::StrCat("clips must have sides of 32 to ", kMaxSide, " pixels"));
  }
  if (points < 1 || points > 100000) return absl::InvalidArgumentError("points must be in [1, 100000]");
  if (count < 1) return absl::InvalidArgumentError("count must be positive");
  if (motion_ramp_clips < 0) return absl::InvalidArgumentError("motion_ramp_clips must not be negative");
  for (const auto& [name, value] : {std::pair{"picture_share", picture_share},
                                    {"motion_strength", motion_strength},
                                    {"motion_ramp_start", motion_ramp_start},
                                    {"still_share", still_share},
                                    {"plain_share", plain_share},
                                    {"alike_share", alike_share}}) {
    if (absl::Status status = CheckShare(name, value); !status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<SyntheticDataset>> SyntheticDataset::Create(const SyntheticOptions& options) {
  if (absl::Status status = options.Validate(); !status.ok()) return status;
  std::unique_ptr<PictureLibrary> library;
  if (!options.pictures.empty()) {
    absl::StatusOr<std::unique_ptr<PictureLibrary>> opened = PictureLibrary::Create(options.pictures);
    if (!opened.ok()) return opened.status();
    library = *std::move(opened);
  }
  return absl::WrapUnique(new SyntheticDataset(options, std::move(library)));
}

SyntheticDataset::SyntheticDataset(const SyntheticOptions& options, std::unique_ptr<PictureLibrary> library)
    : options_(options), library_(std::move(library)), grain_(MakeGrain({options.width, options.height}, kGrainSeed)) {}

absl::StatusOr<Sample> SyntheticDataset::Get(size_t index, Rng&) const {
  try {
    Rng rng(options_.seed, index);
    absl::StatusOr<Scene> scene = RandomScene(options_, MotionOf(options_, index), library_.get(), rng);
    if (!scene.ok()) return scene.status();
    Sample sample = RenderClip(*scene, options_.frames);
    sample.source = absl::StrCat("synthetic/", options_.seed, "/", index);
    sample.AllocatePoints(options_.points);
    TrackPoints(*scene, ChoosePoints(sample.frames[0], sample.masks[0], kBackground, options_.points, rng), sample);
    if (!options_.photometric) return sample;
    const Photometric look = Photometric::Random(rng, static_cast<double>(options_.frames - 1), grain_);
    for (size_t s = 0; s < sample.frames.size(); ++s) look.Apply(static_cast<double>(s), rng, sample.frames[s]);
    return sample;
  } catch (const cv::Exception& e) {
    return absl::InternalError(absl::StrCat("synthetic clip ", index, ": ", e.what()));
  }
}

}  // namespace holdfast
