// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_command.h"

#include <filesystem>
#include <iterator>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "client/cli/sending.h"
#include "client/cli/track_output.h"
#include "client/cli/track_run.h"
#include "client/cli/track_writer.h"
#include "client/cli/video.h"
#include "io/atomic_file.h"

namespace holdfast {
namespace {

constexpr int64_t kMostFrames = int64_t{1} << 40;

// What is written beside --out; empty: nothing is.
std::string ObjectsFile(const TrackOptions& options) {
  return options.points.mask.empty() ? "" : ObjectsFileOf(options.out);
}

// No output takes the place of what is read, or of another one.
absl::Status CheckDistinct(const TrackOptions& options) {
  const std::string objects = ObjectsFile(options);
  const std::pair<absl::string_view, const std::string&> names[] = {
      {"INPUT", options.input},     {"--points", options.points.file},    {"--mask", options.points.mask},
      {"--out", options.out},       {"--overlay", options.overlay.video}, {"--still", options.overlay.still},
      {"objects of --out", objects}};
  constexpr size_t kFirstOutput = 3;
  std::error_code ignored;
  for (size_t i = kFirstOutput; i < std::size(names); ++i) {
    const auto& [flag, output] = names[i];
    if (output.empty() || output == "-") continue;
    for (size_t j = 0; j < i; ++j) {
      const std::string& other = names[j].second;
      if (other.empty()) continue;
      const bool same =
          std::filesystem::equivalent(output, other, ignored) ||
          std::filesystem::weakly_canonical(output, ignored) == std::filesystem::weakly_canonical(other, ignored);
      if (same) return absl::InvalidArgumentError(absl::StrCat(flag, "=", output, ": is ", names[j].first, ", too"));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckOutputs(const TrackOptions& options) {
  if (absl::Status distinct = CheckDistinct(options); !distinct.ok()) return distinct;
  for (const std::string& path : {options.overlay.video, options.overlay.still, ObjectsFile(options)}) {
    const absl::Status writable = path.empty() ? absl::OkStatus() : CheckWritable(path);
    if (!writable.ok()) return writable;
  }
  return TrackOutput::Check(options.out);
}

absl::StatusOr<std::unique_ptr<PictureView>> OpenView(const TrackOptions& options,
                                                      const TrackEnvironment& environment) {
  if (!options.overlay.show) return nullptr;
  return environment.open_view([&environment] { environment.stop.Stop(); });
}

absl::Status ValidateFrames(const TrackOptions& options) {
  if (options.start_frame < 0 || options.start_frame > kMostFrames) {
    return absl::InvalidArgumentError(absl::StrCat("--start_frame: expected 0..", kMostFrames));
  }
  if (options.every < 1 || options.every > kMostFrames) {
    return absl::InvalidArgumentError(absl::StrCat("--every: expected 1..", kMostFrames));
  }
  const auto check = [&options](absl::string_view flag, int64_t frame) {
    if (frame < 0 || frame >= options.start_frame) return absl::OkStatus();
    return absl::InvalidArgumentError(
        absl::StrCat(flag, ": frame ", frame, " lies before --start_frame=", options.start_frame));
  };
  absl::Status status = check("--query_frame", options.points.query_frame);
  status.Update(check("--still_frame", options.overlay.still_frame));
  if (options.both && (options.live || options.overlay.show)) {
    status.Update(absl::InvalidArgumentError(absl::StrCat(
        "--both: what lies before a query is tracked at the end; not with ", options.live ? "--live" : "--show")));
  }
  return status;
}

}  // namespace

absl::Status TrackOptions::Validate() const {
  if (out.empty() && !overlay.wanted()) {
    return absl::InvalidArgumentError("nothing to write: give --out, --overlay, --still or --show");
  }
  if (absl::Status status = TrackOutput::ValidatePath(out); !status.ok()) return status;
  if (absl::Status status = overlay.Validate(); !status.ok()) return status;
  if (absl::Status status = points.Validate(); !status.ok()) return status;
  const absl::Status sending = CheckSending(max_side, jpeg_quality, processing_size, promise_fps);
  if (!sending.ok()) return sending;
  if (absl::Status status = ValidateFrames(*this); !status.ok()) return status;
  if (max_frames < 0) return absl::InvalidArgumentError("--max_frames: expected 0 or more");
  if (iterations < 0) return absl::InvalidArgumentError("--iterations: expected 0 or more");
  return absl::OkStatus();
}

absl::Status RunTrack(const TrackOptions& options, const TrackEnvironment& environment) {
  const absl::Status outputs = CheckOutputs(options);
  if (!outputs.ok()) return outputs;
  const auto view = OpenView(options, environment);
  if (!view.ok()) return view.status();
  auto source = FrameSource::Open(options.input, options.start_frame);
  if (!source.ok()) return source.status();
  if ((*source)->fps_is_guess()) {
    environment.log << "warning: " << options.input << ": does not say how many frames a second it has; taken for "
                    << (*source)->fps() << "\n";
  }
  auto points = CollectPoints(options.points, (*source)->size(), options.start_frame);
  if (!points.ok()) return points.status();
  auto object = CollectObject(options.points, (*source)->size(), *points, options.start_frame);
  if (!object.ok()) return object.status();
  const auto tracker = environment.connect();
  if (!tracker.ok()) return tracker.status();
  return TrackInput(options, environment, {*std::move(source), *std::move(points), *std::move(object), view->get()},
                    **tracker);
}

}  // namespace holdfast
