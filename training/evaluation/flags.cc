// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/flags.h"

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "absl/flags/flag.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "program/flags.h"

// A flag that is not given leaves what the options say by themselves.
namespace holdfast {
namespace {

const EvaluateRequest& Defaults() {
  static const auto* const defaults = new EvaluateRequest;  // flags are made before main and may outlive statics
  return *defaults;
}

}  // namespace
}  // namespace holdfast

using holdfast::Defaults;

// What is evaluated.
ABSL_FLAG(std::string, weights, Defaults().methods.engine.weights_path,
          "Evaluates the network with these weights (safetensors). Empty: the baseline alone.");
ABSL_FLAG(std::string, baseline, "",
          "Evaluates a baseline on the very same clips, at their own size; lk: pyramidal Lucas-Kanade. Empty: none.");
ABSL_FLAG(std::string, suite, "",
          "Evaluates a collection of data sets in place of --format; paper: those of the paper that are below --data, "
          "with its figures beside ours. Empty: no collection.");
ABSL_FLAG(std::string, calibrate, Defaults().calibrate,
          "Fits the confidence of estimates to this data, as the probability of being right, and writes the weights "
          "with it to this file. Fit on other clips than those of an evaluation. Empty: fits nothing.");
ABSL_FLAG(std::string, json, Defaults().json, "Writes the reports to this file too, as JSON. Empty: to no file.");

// How the network is run.
ABSL_FLAG(holdfast::ImageSize, processing_size, {},
          "Resizes the network's frames to WIDTHxHEIGHT, multiples of 32. Results and time depend much on it. Empty: "
          "the engine's default, 512x384, or the paper's size with --suite.");
ABSL_FLAG(
    int, iterations, 0,
    "Refines the positions of a window this many times at most: more take longer. 0: as often as the engine does by "
    "default, 16 times with --suite.");
ABSL_FLAG(double, least_step, Defaults().methods.engine.least_step,
          "Ends the window of a point early, after an iteration that moved the point by less than this many pixels of "
          "the processing size on every frame. 0: never. Has no effect with --chaining=published and --suite.");
ABSL_FLAG(int, hop, 0,
          "Begins a window this many frames after the one before it: fewer take longer. 0: the engine's default, 23 "
          "with --chaining=published.");
ABSL_FLAG(std::string, chaining, "standard",
          "Says what a window takes over from the one before it. standard: positions, as in serving; published: the "
          "templates too, as the published test script does.");
ABSL_FLAG(bool, motion_prior, Defaults().methods.engine.motion_prior,
          "Starts windows from where optical flow leads; without it they start from the last known position. Has no "
          "effect with --chaining=published.");
ABSL_FLAG(bool, polish, Defaults().methods.engine.polish,
          "Moves final positions to where the picture says, by optical flow. Has no effect with --chaining=published.");
ABSL_FLAG(std::string, precision, "auto",
          "Computes in float32 or bfloat16; auto: in bfloat16 where the device is faster with it and its results agree "
          "with those of float32.");
ABSL_FLAG(std::string, device, Defaults().methods.engine.device,
          "Runs the network on this device, as LibTorch names it: cpu, cuda, cuda:1.");
ABSL_FLAG(int, threads, Defaults().methods.engine.compute_threads,
          "Computes with this many threads; 0: as many as there are cores that the process may use.");

// On what.
ABSL_FLAG(std::string, format, Defaults().data.format,
          "Names the kind of data set: neutral, pointodyssey, tapvid, crohd or synthetic (made up, needs no files).");
ABSL_FLAG(std::string, data, Defaults().data.dir,
          "Reads the data set from this directory; with --suite, the one that holds the data sets.");
ABSL_FLAG(std::string, split, Defaults().data.split, "Names the part of PointOdyssey to evaluate on.");
ABSL_FLAG(std::string, pictures, Defaults().data.pictures,
          "Takes the pictures of synthetic clips from this directory's objects/ and backgrounds/. Empty: procedural "
          "textures.");
ABSL_FLAG(double, alike_share, Defaults().data.alike_share,
          "Lets the objects of this share of the synthetic clips look like one another or like the background.");
ABSL_FLAG(holdfast::ImageSize, clip_size, Defaults().data.size, "Makes synthetic clips of WIDTHxHEIGHT pixels.");
ABSL_FLAG(int64_t, frames, Defaults().data.frames,
          "Takes at most this many frames of a clip. 0: whole sequences, 24 frames of a synthetic clip.");
ABSL_FLAG(
    int64_t, points, Defaults().data.points,
    "Follows at most this many points of a clip. 0: all of them, 64 in a synthetic clip, 256 of PointOdyssey with "
    "--suite.");
ABSL_FLAG(int64_t, count, static_cast<int64_t>(Defaults().data.count),
          "Evaluates at most this many sequences. 0: all of them, 20 synthetic clips.");
ABSL_FLAG(uint64_t, seed, Defaults().data.seed, "Seeds the synthetic clips: the same seed makes the same clips.");

namespace holdfast {
namespace {

// The value that 'text' names.
template <typename T>
absl::StatusOr<T> ParseChoice(absl::string_view flag, const std::string& text,
                              const std::map<std::string, T>& choices) {
  const auto choice = choices.find(text);
  if (choice != choices.end()) return choice->second;
  const auto name = [](std::string* out, const auto& entry) { out->append(entry.first); };
  return absl::InvalidArgumentError(
      absl::StrCat("--", flag, ": expected one of ", absl::StrJoin(choices, ", ", name), "; got \"", text, "\""));
}

absl::Status FillEngine(bool suite, EngineOptions& engine) {
  const auto chaining = ParseChoice<Chaining>("chaining", absl::GetFlag(FLAGS_chaining),
                                              {{"standard", Chaining::kStandard}, {"published", Chaining::kPublished}});
  if (!chaining.ok()) return chaining.status();
  const auto precision = ParseChoice<Precision>(
      "precision", absl::GetFlag(FLAGS_precision),
      {{"auto", Precision::kAuto}, {"float32", Precision::kFloat32}, {"bfloat16", Precision::kBFloat16}});
  if (!precision.ok()) return precision.status();
  engine.weights_path = absl::GetFlag(FLAGS_weights);
  engine.device = absl::GetFlag(FLAGS_device);
  engine.compute_threads = absl::GetFlag(FLAGS_threads);
  engine.chaining = *chaining;
  engine.precision = *precision;
  engine.least_step = suite ? 0 : absl::GetFlag(FLAGS_least_step);  // published figures have every iteration
  engine.motion_prior = absl::GetFlag(FLAGS_motion_prior);
  engine.polish = absl::GetFlag(FLAGS_polish);
  if (*chaining == Chaining::kPublished) engine.hop_frames = 23;
  if (absl::GetFlag(FLAGS_hop) != 0) engine.hop_frames = absl::GetFlag(FLAGS_hop);
  if (suite) engine.iterations = 16;
  if (absl::GetFlag(FLAGS_iterations) != 0) engine.iterations = absl::GetFlag(FLAGS_iterations);
  // One trusted user: the limits that protect a server do not apply.
  engine.limits = {/*max_points=*/1 << 20, /*max_frame_bytes=*/int64_t{1} << 30, /*max_frame_pixels=*/int64_t{1} << 28,
                   /*max_frames=*/0};
  engine.max_processing_pixels = int64_t{1} << 24;
  engine.cache_budget_bytes = int64_t{1} << 38;
  engine.max_iterations = std::max(engine.max_iterations, engine.iterations);
  return absl::OkStatus();
}

absl::StatusOr<EvaluationDataOptions> DataFromFlags() {
  EvaluationDataOptions data;
  data.size = absl::GetFlag(FLAGS_clip_size);
  data.format = absl::GetFlag(FLAGS_format);
  data.dir = absl::GetFlag(FLAGS_data);
  data.split = absl::GetFlag(FLAGS_split);
  data.pictures = absl::GetFlag(FLAGS_pictures);
  data.alike_share = absl::GetFlag(FLAGS_alike_share);
  data.frames = absl::GetFlag(FLAGS_frames);
  data.points = absl::GetFlag(FLAGS_points);
  if (absl::GetFlag(FLAGS_count) < 0) return absl::InvalidArgumentError("--count: must not be negative");
  data.count = absl::GetFlag(FLAGS_count);
  data.seed = absl::GetFlag(FLAGS_seed);
  return data;
}

}  // namespace

std::map<std::string, std::string> SettingsFromFlags() {
  std::map<std::string, std::string> settings;
  for (const absl::CommandLineFlag* flag : ProgramFlags()) {
    if (flag->CurrentValue() != flag->DefaultValue()) settings.emplace(flag->Name(), flag->CurrentValue());
  }
  return settings;
}

absl::StatusOr<EvaluateRequest> RequestFromFlags() {
  EvaluateRequest request;
  const auto suite = ParseChoice<bool>("suite", absl::GetFlag(FLAGS_suite), {{"", false}, {"paper", true}});
  if (!suite.ok()) return suite.status();
  request.suite = *suite;
  const auto baseline = ParseChoice<bool>("baseline", absl::GetFlag(FLAGS_baseline), {{"", false}, {"lk", true}});
  if (!baseline.ok()) return baseline.status();
  request.methods.lucas_kanade = *baseline;
  if (absl::Status filled = FillEngine(*suite, request.methods.engine); !filled.ok()) return filled;
  request.processing_size = absl::GetFlag(FLAGS_processing_size);
  absl::StatusOr<EvaluationDataOptions> data = DataFromFlags();
  if (!data.ok()) return data.status();
  request.data = *std::move(data);
  if (request.suite && request.data.dir.empty()) {
    return absl::InvalidArgumentError("--data: --suite needs the directory that holds the data sets");
  }
  request.json = absl::GetFlag(FLAGS_json);
  request.calibrate = absl::GetFlag(FLAGS_calibrate);
  request.methods.calibrate = !request.calibrate.empty();
  if (request.methods.calibrate && request.methods.engine.weights_path.empty()) {
    return absl::InvalidArgumentError("--calibrate: needs --weights");
  }
  return request;
}

}  // namespace holdfast
