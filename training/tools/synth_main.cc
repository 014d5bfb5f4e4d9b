// SPDX-License-Identifier: Apache-2.0
// holdfast-synth: writes synthetic clips in the neutral format, with previews, or measures how fast they are made.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <iostream>
#include <opencv2/core/utility.hpp>
#include <string>
#include <vector>

#include "absl/flags/flag.h"
#include "absl/strings/str_format.h"
#include "program/flags.h"
#include "training/data/preview.h"
#include "training/data/readers/neutral.h"
#include "training/data/synthetic/synthetic_dataset.h"
#include "training/data/synthetic/synthetic_options.h"

// A flag that is not given leaves what the options say by themselves.
namespace holdfast {
namespace {

const SyntheticOptions& Defaults() {
  static const auto* const defaults = new SyntheticOptions;  // flags are made before main and may outlive statics
  return *defaults;
}

}  // namespace
}  // namespace holdfast

using holdfast::Defaults;

ABSL_FLAG(int64_t, count, 4, "Makes this many clips.");
ABSL_FLAG(std::string, out, "",
          "Writes each clip to a folder of its own in this directory, in the neutral format. It must be given, "
          "except with --benchmark.");
ABSL_FLAG(uint64_t, seed, Defaults().seed,
          "Seeds the clips: clip i is a function of the seed, of i and of the other flags.");
ABSL_FLAG(int64_t, frames, Defaults().frames, "Makes each clip this many frames long.");
ABSL_FLAG(int, height, Defaults().height, "Makes frames this many pixels high.");
ABSL_FLAG(int, width, Defaults().width, "Makes frames this many pixels wide.");
ABSL_FLAG(int64_t, points, Defaults().points, "Follows this many points in each clip.");
ABSL_FLAG(std::string, pictures, Defaults().pictures,
          "Takes pictures from this directory's objects/ and backgrounds/. Empty: procedural textures alone.");
ABSL_FLAG(double, motion, Defaults().motion_strength,
          "Scales every motion by this number from 0 (nothing moves) to 1.");
ABSL_FLAG(bool, photometric, Defaults().photometric, "Adds colour drift, noise, blur and compression to the pictures.");
ABSL_FLAG(bool, preview, true, "Writes preview.avi and sheet.png beside each clip too, with the points drawn.");
ABSL_FLAG(bool, benchmark, false, "Writes nothing and prints how many clips one core makes in a second.");

namespace holdfast {
namespace {

constexpr Program kProgram = {"holdfast-synth", "holdfast-synth --out=DIR [flags]"};
constexpr int kUsageError = 2;

SyntheticOptions OptionsFromFlags() {
  SyntheticOptions options;
  options.count = static_cast<size_t>(std::max<int64_t>(absl::GetFlag(FLAGS_count), 0));
  options.seed = absl::GetFlag(FLAGS_seed);
  options.frames = absl::GetFlag(FLAGS_frames);
  options.height = absl::GetFlag(FLAGS_height);
  options.width = absl::GetFlag(FLAGS_width);
  options.points = absl::GetFlag(FLAGS_points);
  options.pictures = absl::GetFlag(FLAGS_pictures);
  options.motion_strength = absl::GetFlag(FLAGS_motion);
  options.photometric = absl::GetFlag(FLAGS_photometric);
  return options;
}

absl::Status WriteClip(Sample& sample, const std::filesystem::path& folder) {
  sample.fps = 8;  // slow enough to look at
  if (absl::Status status = WriteNeutral(sample, folder.string()); !status.ok()) return status;
  if (!absl::GetFlag(FLAGS_preview)) return absl::OkStatus();
  constexpr int kColumns = 6;
  if (absl::Status status = WritePreviewVideo(sample, (folder / "preview.avi").string()); !status.ok()) return status;
  return WriteContactSheet(sample, kColumns, (folder / "sheet.png").string());
}

absl::Status Run() {
  absl::StatusOr<std::unique_ptr<SyntheticDataset>> clips = SyntheticDataset::Create(OptionsFromFlags());
  if (!clips.ok()) return clips.status();
  const bool benchmark = absl::GetFlag(FLAGS_benchmark);
  const std::filesystem::path out = absl::GetFlag(FLAGS_out);
  if (!benchmark && out.empty()) return absl::InvalidArgumentError("--out is missing");
  Rng unused(0);
  const std::clock_t start = std::clock();
  for (size_t i = 0; i < (*clips)->size(); ++i) {
    absl::StatusOr<Sample> sample = (*clips)->Get(i, unused);
    absl::Status status = sample.status();
    if (status.ok() && !benchmark) status = WriteClip(*sample, out / absl::StrFormat("%05d", i));
    if (!status.ok()) return status;
  }
  // Processor time: what other programs do at the same moment does not count.
  const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  const double rate = static_cast<double>((*clips)->size()) / seconds;
  std::cout << absl::StrFormat("%d clips in %.2f s of one core: %.2f clips/s\n", (*clips)->size(), seconds, rate);
  return absl::OkStatus();
}

int Main(const std::vector<std::string>& args) {
  if (AnswerQuestion(kProgram, args, std::cout)) return EXIT_SUCCESS;
  absl::Status status = SetFlags(args, std::getenv);
  cv::setNumThreads(1);  // clips are made in parallel, if at all, not their pixels
  if (status.ok()) status = Run();
  if (status.ok()) return EXIT_SUCCESS;
  std::cerr << "holdfast-synth: " << status.message() << "\n";
  return absl::IsInvalidArgument(status) ? kUsageError : EXIT_FAILURE;
}

}  // namespace
}  // namespace holdfast

int main(int argc, char** argv) { return holdfast::Main({argv + 1, argv + argc}); }
