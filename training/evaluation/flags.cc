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

ABSL_FLAG(std::string, data, "", "directory of the data set; with --suite, the one that holds the data sets");
ABSL_FLAG(std::string, format, "synthetic", "neutral, pointodyssey, tapvid, crohd or synthetic");
ABSL_FLAG(std::string, weights, "", "checkpoint (safetensors); empty: the baseline alone");
ABSL_FLAG(std::string, baseline, "", "lk: pyramidal Lucas-Kanade on the same clips, at their own size");
ABSL_FLAG(std::string, suite, "", "paper: the paper's data sets below --data, with its figures beside ours");
ABSL_FLAG(std::string, json, "", "file that gets the reports as JSON");
ABSL_FLAG(holdfast::ImageSize, processing_size, {},
          "WIDTHxHEIGHT of the network's frames, multiples of 32; empty: 512x384, or the paper's");
ABSL_FLAG(int, iterations, 0, "refinement iterations of a window; 0: the engine's default, 16 with --suite");
ABSL_FLAG(int, hop, 0, "new frames between windows; 0: the engine's default, 23 with --chaining=published");
ABSL_FLAG(std::string, chaining, "standard",
          "standard, or published: windows carry their templates over as the published script does");
ABSL_FLAG(bool, motion_prior, true, "windows start from where optical flow leads; not with --chaining=published");
ABSL_FLAG(bool, polish, true, "final positions are moved to where the picture says; not with --chaining=published");
ABSL_FLAG(std::string, precision, "auto", "auto, float32 or bfloat16");
ABSL_FLAG(std::string, device, "cpu", "as LibTorch names it: cpu, cuda, cuda:1");
ABSL_FLAG(int, threads, 0, "threads of one tensor operation; 0: all cores");
ABSL_FLAG(std::string, split, "test", "of pointodyssey");
ABSL_FLAG(std::string, pictures, "",
          "directory with objects/ and backgrounds/ for synthetic clips; empty: procedural textures");
ABSL_FLAG(holdfast::ImageSize, clip_size, holdfast::EvaluationDataOptions().size, "WIDTHxHEIGHT of synthetic clips");
ABSL_FLAG(int64_t, frames, 0, "of a clip at most; 0: whole sequences, 24 for synthetic");
ABSL_FLAG(int64_t, points, 0, "of a clip at most; 0: all, 64 for synthetic");
ABSL_FLAG(int64_t, count, 0, "sequences at most; 0: all, 20 for synthetic");
ABSL_FLAG(uint64_t, seed, 1000, "of synthetic clips");

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
  return request;
}

}  // namespace holdfast
