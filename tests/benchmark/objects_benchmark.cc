// SPDX-License-Identifier: Apache-2.0
// holdfast-objects-benchmark: how well the points of an object hold to it, and tell who of them has left it, on
// synthetic scenes whose every place is known. Objects are asked for by their masks in the first frame, through the
// engine that serves; what is said of them on each frame is held against where the scene has them.
#include <cstdint>
#include <cstdlib>
#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string>
#include <vector>

#include "absl/flags/flag.h"
#include "absl/strings/str_format.h"
#include "api/clock.h"
#include "api/point_tracker.h"
#include "program/flags.h"
#include "program/network_process.h"
#include "program/program_path.h"
#include "program/shipped_weights.h"
#include "server/engine/engine.h"
#include "server/engine/local_tracker.h"
#include "server/engine/metrics.h"
#include "tests/benchmark/objects_judgement.h"
#include "training/data/synthetic/renderer.h"
#include "training/data/synthetic/scene.h"

ABSL_FLAG(int64_t, count, 24, "Makes this many clips.");
ABSL_FLAG(int64_t, first, 0, "Makes the clips from this one on.");
ABSL_FLAG(uint64_t, seed, 70001, "Seeds the clips.");
ABSL_FLAG(int64_t, frames, 64, "Makes each clip this many frames long.");
ABSL_FLAG(double, motion, 0.4,
          "Scales every motion by this number from 0 (nothing moves) to 1, as training clips have.");
ABSL_FLAG(int, points, 48, "Places this many points on an object.");
ABSL_FLAG(bool, reseed, true, "Has points that have left placed anew.");
ABSL_FLAG(std::string, pictures, "", "Takes pictures from this directory's objects/ and backgrounds/.");
ABSL_FLAG(std::string, weights, "", "Tracks with these weights; empty: the shipped ones.");

namespace holdfast {
namespace {

constexpr Program kProgram = {"holdfast-objects-benchmark", "holdfast-objects-benchmark [flags]"};
constexpr size_t kMostObjects = 3;   // of a clip
constexpr double kLeastArea = 0.01;  // of the frame, of an object that is followed
constexpr double kMostArea = 0.5;
constexpr int kRim = 3;  // pixels around an object that still count as on it

std::string MaskOf(const cv::Mat& ids, int32_t id) {
  std::vector<uint8_t> png;
  cv::imencode(".png", ids == id, png);
  return {png.begin(), png.end()};
}

absl::StatusOr<Clip> MakeClip(int64_t index, const PictureLibrary* library) {
  SyntheticOptions options;
  options.width = kClipWidth;
  options.height = kClipHeight;
  options.frames = absl::GetFlag(FLAGS_frames);
  options.still_share = 0;
  Rng rng(absl::GetFlag(FLAGS_seed), static_cast<uint64_t>(index));
  absl::StatusOr<Scene> scene = RandomScene(options, absl::GetFlag(FLAGS_motion), library, rng);
  if (!scene.ok()) return scene.status();
  Clip clip{*std::move(scene)};
  Renderer renderer(clip.scene);
  for (int64_t frame = 0; frame < options.frames; ++frame) {
    renderer.Render(static_cast<double>(frame), clip.frames.emplace_back(), clip.ids.emplace_back());
  }
  return clip;
}

std::optional<Followed> Follow(const Clip& clip, const Layer& layer, ObjectId id) {
  if (layer.endless || layer.texture.channels() != 4) return std::nullopt;
  Followed object;
  object.layer = &layer;
  cv::findNonZero(clip.ids[0] == layer.id, object.covered);
  const double area = static_cast<double>(object.covered.size()) / (kClipWidth * kClipHeight);
  if (area < kLeastArea || area > kMostArea) return std::nullopt;
  cv::extractChannel(layer.texture, object.solid, 3);
  cv::dilate(object.solid >= 128, object.solid,
             cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * kRim + 1, 2 * kRim + 1}));
  object.query.id = id;
  object.query.mask_png = MaskOf(clip.ids[0], layer.id);
  object.query.points = absl::GetFlag(FLAGS_points);
  object.query.reseed = absl::GetFlag(FLAGS_reseed);
  return object;
}

class Finals final : public TrackObserver {
 public:
  explicit Finals(std::vector<Followed>& objects) : objects_(objects) {}
  void OnTracks(TrackUpdate update) override {
    for (PointRun& run : update.runs) {
      const auto [place, added] = objects_[ObjectOf(run.id)].runs.try_emplace(run.id);
      PointRun& whole = place->second;
      if (added) whole.first_frame = run.first_frame;
      whole.id = run.id;
      const auto append = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
      append(whole.x, run.x);
      append(whole.y, run.y);
      append(whole.visible, run.visible);
      append(whole.confidence, run.confidence);
      whole.final_count = static_cast<int64_t>(whole.x.size());
    }
    for (ObjectRun& run : update.objects) {
      std::vector<ObjectSample>& samples = objects_[run.id].said.samples;
      samples.insert(samples.end(), run.samples.begin(), run.samples.end());
    }
  }
  void OnDone(const absl::Status&, const SessionSummary&) override {}

 private:
  std::vector<Followed>& objects_;
};

absl::Status Track(const Clip& clip, std::vector<Followed>& objects, PointTracker& tracker) {
  SessionConfig config;
  config.encoding = FrameEncoding::kRgb24;
  config.raw_size = {kClipWidth, kClipHeight};
  config.send_provisional = false;
  for (const Followed& object : objects) config.objects.push_back(object.query);
  Finals finals(objects);
  auto stream = tracker.Open(config, finals);
  if (!stream.ok()) return stream.status();
  for (size_t i = 0; i < clip.frames.size(); ++i) {
    const cv::Mat& image = clip.frames[i];
    Frame frame;
    frame.index = static_cast<int64_t>(i);
    frame.bytes.assign(reinterpret_cast<const char*>(image.data), image.total() * image.elemSize());
    if (absl::Status pushed = (*stream)->PushFrame(std::move(frame)); !pushed.ok()) return pushed;
  }
  return (*stream)->Finish();
}

std::string Text(const Share& share) {
  const double percent = share.whole == 0 ? 0 : 100.0 * static_cast<double>(share.part) / share.whole;
  return absl::StrFormat("%6.1f %% (%d of %d)", percent, share.part, share.whole);
}

void Print(const char* title, const Findings& findings) {
  std::cout << title << "\n  points that left, found           " << Text(findings.left_found)
            << "\n  points that stayed, flagged       " << Text(findings.stayed_flagged)
            << "\n  estimates off the object, flagged " << Text(findings.off_flagged)
            << "\n  estimates on the object, flagged  " << Text(findings.on_flagged)
            << "\n    of these, at a wrong place      " << Text(findings.flagged_wrong) << "\n";
}

void Print(const Tally& tally) {
  std::cout << absl::StrFormat("%d objects, %d points\n", tally.objects, tally.points);
  Print("where at least half of an object's estimates are on it", tally.held);
  Print("all frames", tally.all);
  std::cout << "placed anew, on the object          " << Text(tally.anew_on) << "\nplaced anew, where it is in sight   "
            << Text(tally.anew_in_sight) << "\n";
  std::cout << "frame  overlap of outlines  hull of all points  centre off (of its size)  objects in sight  points seen"
            << " (of those asked for)  of these on the object\n";
  const auto of = [](const Mean& mean) { return mean.sum / static_cast<double>(mean.count); };
  for (const auto& [frame, overlap] : tally.overlap) {
    std::cout << absl::StrFormat("%5d  %19.3f  %18.3f  %24.3f  %16d  %33.3f  %22.3f\n", frame, of(overlap),
                                 of(tally.points_overlap.at(frame)), of(tally.centre.at(frame)), overlap.count,
                                 of(tally.seen.at(frame)), of(tally.on.at(frame)));
  }
}

absl::Status Run() {
  EngineOptions options;
  options.weights_path = absl::GetFlag(FLAGS_weights);
  if (options.weights_path.empty()) {
    const absl::StatusOr<std::string> shipped = FindShippedWeights(ProgramPath());
    if (!shipped.ok()) return shipped.status();
    options.weights_path = *shipped;
  }
  SystemClock clock;
  NullEngineMetrics metrics;
  absl::StatusOr<std::unique_ptr<Engine>> engine = Engine::Create(options, clock, metrics);
  if (!engine.ok()) return engine.status();
  LocalTracker tracker(**engine);
  std::unique_ptr<PictureLibrary> library;
  if (const std::string pictures = absl::GetFlag(FLAGS_pictures); !pictures.empty()) {
    auto opened = PictureLibrary::Create(pictures);
    if (!opened.ok()) return opened.status();
    library = *std::move(opened);
  }
  Tally tally;
  for (int64_t index = 0; index < absl::GetFlag(FLAGS_count); ++index) {
    const absl::StatusOr<Clip> clip = MakeClip(absl::GetFlag(FLAGS_first) + index, library.get());
    if (!clip.ok()) return clip.status();
    std::vector<Followed> objects;
    for (const Layer& layer : clip->scene.layers) {
      auto object = Follow(*clip, layer, static_cast<ObjectId>(objects.size()));
      if (object && objects.size() < kMostObjects) objects.push_back(*std::move(object));
    }
    if (objects.empty()) continue;
    if (absl::Status status = Track(*clip, objects, tracker); !status.ok()) return status;
    for (const Followed& object : objects) Judge(*clip, object, tally);
    std::cerr << absl::StrFormat("clip %d of %d\n", index + 1, absl::GetFlag(FLAGS_count));
  }
  Print(tally);
  return absl::OkStatus();
}

int Main(const std::vector<std::string>& args) {
  if (AnswerQuestion(kProgram, args, std::cout)) return EXIT_SUCCESS;
  absl::Status status = SetFlags(args, std::getenv);
  if (status.ok()) status = Run();
  if (status.ok()) return EXIT_SUCCESS;
  std::cerr << "holdfast-objects-benchmark: " << status.message() << "\n";
  return EXIT_FAILURE;
}

}  // namespace
}  // namespace holdfast

int main(int argc, char** argv) {
  holdfast::PrepareForNetwork(argv);
  return holdfast::Main({argv + 1, argv + argc});
}
