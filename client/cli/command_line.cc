// SPDX-License-Identifier: Apache-2.0
#include "client/cli/command_line.h"

#include <memory>
#include <utility>

#include "absl/flags/flag.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/cli/info_command.h"
#include "client/cli/track_command.h"
#include "client/remote_tracker.h"

ABSL_FLAG(std::string, server, "localhost:50051", "host:port of the tracking server");
ABSL_FLAG(absl::Duration, connect_timeout, holdfast::RemoteTracker::Options().connect_timeout,
          "how long to wait for the connection to stand");
ABSL_FLAG(std::string, points, "", "file of points: .csv with lines id,x,y[,frame], or .json with [{id, x, y, frame}]");
ABSL_FLAG(int, grid, 0, "track about this many points spread over the frame, or this many on --mask");
ABSL_FLAG(std::string, mask, "", "picture of the frame's size; points are spread over its nonzero pixels");
ABSL_FLAG(int64_t, query_frame, 0, "frame at which the points of --grid and --mask start");
ABSL_FLAG(std::string, out, "", "file for the tracks: .json, .csv or .npz");
ABSL_FLAG(std::string, overlay, "", "video with the tracks drawn on it: .mp4");
ABSL_FLAG(std::string, still, "", "one picture of the overlay: .png or .jpg");
ABSL_FLAG(int64_t, still_frame, holdfast::OverlayVideo::Options().still_frame,
          "frame that --still shows; -1: the last one");
ABSL_FLAG(int, trail_frames, holdfast::OverlayVideo::Options().trail_frames,
          "length of the trails that are drawn, in frames");
ABSL_FLAG(int64_t, max_frames, 0, "stop after so many frames; 0: at the end of the video");
ABSL_FLAG(int, max_side, 0, "longest side of the frames that are sent, in pixels; 0: as they are");
ABSL_FLAG(int, jpeg_quality, holdfast::TrackOptions().jpeg_quality,
          "quality of the JPEG pictures that are sent, 1 to 100; higher costs bandwidth");
ABSL_FLAG(holdfast::ImageSize, processing_size, {},
          "WIDTHxHEIGHT the server tracks at, multiples of 32; empty: its default");
ABSL_FLAG(int, hop, 0, "new frames between windows; 0: the server's default");
ABSL_FLAG(int, iterations, 0, "refinement iterations of a window; 0: the server's default");
ABSL_FLAG(bool, live, false,
          "have every frame answered at once with what optical flow says, and show that in --overlay and --still");
ABSL_FLAG(bool, json, false, "print the server's answer as JSON");

namespace holdfast {
namespace {

constexpr int kOk = 0;
constexpr int kFailed = 1;
constexpr int kUsage = 2;

constexpr char kUsageText[] = R"(Tracks points through video with a Holdfast server.

Usage: holdfast track INPUT [flags]   follow points and write their tracks
       holdfast info [flags]          say what the server runs
       holdfast --help | --version

INPUT is a video file, a directory of .jpg or .png frames, camera:0 or /dev/video0.
Every flag can also be set in the environment: HOLDFAST_SERVER for --server.

A run that is cut short (Ctrl-C, a lost server, a broken INPUT) keeps what it has tracked and says which frames are
missing. Exit codes: 0 done, 1 failed, 2 called wrongly, 130 after Ctrl-C, 143 after SIGTERM.

Example: holdfast track walk.mp4 --grid=100 --out=tracks.json --overlay=overlay.mp4
)";

std::string Help() {
  return absl::StrCat(
      kUsageText, "\nServer (track and info):\n", DescribeFlags({"server", "connect_timeout"}),
      "\nPoints (track; at least one of points, grid and mask):\n",
      DescribeFlags({"points", "grid", "mask", "query_frame"}),
      "\nResults (track; at least one of out, overlay and still):\n",
      DescribeFlags({"out", "overlay", "still", "still_frame", "trail_frames"}), "\nTracking (track):\n",
      DescribeFlags({"max_frames", "max_side", "jpeg_quality", "processing_size", "hop", "iterations", "live"}),
      "\nInfo:\n", DescribeFlags({"json"}));
}

absl::StatusOr<TrackOptions> TrackOptionsFromFlags(const std::string& input) {
  TrackOptions options;
  options.input = input;
  options.points = {absl::GetFlag(FLAGS_points), absl::GetFlag(FLAGS_mask), absl::GetFlag(FLAGS_grid),
                    absl::GetFlag(FLAGS_query_frame)};
  options.out = absl::GetFlag(FLAGS_out);
  options.overlay = {absl::GetFlag(FLAGS_overlay), absl::GetFlag(FLAGS_still), absl::GetFlag(FLAGS_still_frame),
                     absl::GetFlag(FLAGS_trail_frames)};
  options.max_frames = absl::GetFlag(FLAGS_max_frames);
  options.max_side = absl::GetFlag(FLAGS_max_side);
  options.jpeg_quality = absl::GetFlag(FLAGS_jpeg_quality);
  options.processing_size = absl::GetFlag(FLAGS_processing_size);
  options.hop_frames = absl::GetFlag(FLAGS_hop);
  options.iterations = absl::GetFlag(FLAGS_iterations);
  options.live = absl::GetFlag(FLAGS_live);
  if (absl::Status status = options.Validate(); !status.ok()) return status;
  return options;
}

RemoteTracker::Options ServerFromFlags() {
  RemoteTracker::Options options;
  options.address = absl::GetFlag(FLAGS_server);
  options.connect_timeout = absl::GetFlag(FLAGS_connect_timeout);
  return options;
}

// Texts of RemoteTracker begin with the program's name already.
int Fail(const Console& console, const absl::Status& status, int code) {
  console.err << (absl::StartsWith(status.message(), "holdfast: ") ? "" : "holdfast: ") << status.message() << "\n";
  if (code == kUsage) console.err << "Try 'holdfast --help'.\n";
  return code;
}

int Track(const std::vector<std::string>& args, const Console& console, StopSignal& stop) {
  if (args.size() != 1) {
    return Fail(console, absl::InvalidArgumentError("track: give one INPUT, a video, a directory or a camera"), kUsage);
  }
  const auto options = TrackOptionsFromFlags(args[0]);
  if (!options.ok()) return Fail(console, options.status(), kUsage);
  const auto connect = []() -> absl::StatusOr<std::unique_ptr<PointTracker>> {
    return RemoteTracker::Connect(ServerFromFlags());
  };
  const absl::Status status = RunTrack(*options, {connect, stop, console.err, console.terminal});
  if (status.ok()) return kOk;
  const bool interrupted = absl::IsCancelled(status) && stop.stopped();
  return Fail(console, status, interrupted ? SignalExitCode(stop.signal()) : kFailed);
}

int Info(const std::vector<std::string>& args, const Console& console) {
  if (!args.empty()) {
    return Fail(console, absl::InvalidArgumentError(absl::StrCat("info: unexpected ", args[0])), kUsage);
  }
  const auto tracker = RemoteTracker::Connect(ServerFromFlags());
  if (!tracker.ok()) return Fail(console, tracker.status(), kFailed);
  const auto info = (*tracker)->Info();
  if (!info.ok()) return Fail(console, info.status(), kFailed);
  console.out << (absl::GetFlag(FLAGS_json) ? ServerAsJson(*info) : DescribeServer(*info));
  return kOk;
}

}  // namespace

int RunCommandLine(const std::vector<std::string>& args, const Console& console, StopSignal& stop) {
  for (const std::string& arg : args) {
    if (arg == "--help" || arg == "-h" || arg == "help") return console.out << Help(), kOk;
    if (arg == "--version") return console.out << "holdfast " << ProgramVersion() << "\n", kOk;
  }
  const absl::Status environment = SetFlagsFromEnvironment("HOLDFAST_", console.getenv);
  if (!environment.ok()) return Fail(console, environment, kUsage);
  auto rest = ParseFlags(args);
  if (!rest.ok()) return Fail(console, rest.status(), kUsage);
  if (rest->empty()) return Fail(console, absl::InvalidArgumentError("give a command: track or info"), kUsage);
  const std::string command = rest->front();
  rest->erase(rest->begin());
  if (command == "track") return Track(*rest, console, stop);
  if (command == "info") return Info(*rest, console);
  return Fail(console,
              absl::InvalidArgumentError(absl::StrCat("unknown command ", command, ", expected track or info")),
              kUsage);
}

}  // namespace holdfast
