// SPDX-License-Identifier: Apache-2.0
#include "client/cli/command_line.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "absl/flags/flag.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "api/address.h"
#include "client/cli/info_command.h"
#include "client/cli/load_command.h"
#include "client/cli/track_command.h"
#include "client/remote_tracker.h"
#include "io/file_io.h"

ABSL_FLAG(std::string, server, "localhost:50051",
          "Connects to the tracking server at this host:port. Of several, host:port,host:port, the first that answers; "
          "the others take over when it is lost. dns:///host:port spreads sessions over all addresses of the host.");
ABSL_FLAG(absl::Duration, connect_timeout, holdfast::RemoteTracker::Options().connect_timeout,
          "Gives up when the connection does not stand after this time.");
ABSL_FLAG(bool, tls, false, "Speaks TLS with the server, as the other flags that begin with tls do by themselves.");
ABSL_FLAG(std::string, tls_ca, "",
          "Trusts servers with a certificate of an authority of this file (PEM). Empty: those that the system trusts.");
ABSL_FLAG(std::string, tls_cert, "", "Shows the server the certificate of this file (PEM).");
ABSL_FLAG(std::string, tls_key, "", "Has the private key of --tls_cert in this file (PEM).");
ABSL_FLAG(std::string, tls_server_name, "",
          "Expects this name in the server's certificate. Empty: the host of --server.");
ABSL_FLAG(std::string, token_file, "", "Shows the server the token that this file holds.");
ABSL_FLAG(bool, resume, holdfast::RemoteTracker::Options().resume,
          "Goes on where it was when the server is lost and comes back, or another one of --server takes over.");
ABSL_FLAG(int64_t, buffer_mib, holdfast::RemoteTracker::Options().buffer_bytes >> 20,
          "Keeps at most so many MiB of sent frames for that; waits for the server while it is full.");
ABSL_FLAG(absl::Duration, reconnect_timeout, holdfast::RemoteTracker::Options().reconnect_timeout,
          "Gives up when no server takes over within this time.");
ABSL_FLAG(std::string, points, "",
          "Tracks the points of this file: .csv with lines id,x,y[,frame], or .json with [{id, x, y, frame}]. "
          "load: a number, of points of each session; 64 by default.");
ABSL_FLAG(int, grid, 0, "Tracks about this many points spread over the frame, or this many on --mask.");
ABSL_FLAG(std::string, mask, "",
          "Follows the object that the nonzero pixels of this picture cover, which has the frame's size.");
ABSL_FLAG(bool, reseed, true, "Has points of --mask that have left its object placed anew while it is in sight.");
ABSL_FLAG(int64_t, query_frame, -1,
          "Starts the points of --grid and the object of --mask at this frame. -1: at the first one that is tracked.");
ABSL_FLAG(
    std::string, out, "",
    "Writes the tracks to this file: .json, .csv, .npz, .dlc.csv (DeepLabCut), .xml (CVAT) or .3de.txt (3DEqualizer, "
    "Blender). -: a line of JSON for each estimate as it comes, to standard output.");
ABSL_FLAG(std::string, overlay, "", "Writes a video with the tracks drawn on it to this file: .mp4.");
ABSL_FLAG(std::string, still, "", "Writes one picture of the overlay to this file: .png or .jpg.");
ABSL_FLAG(int64_t, still_frame, holdfast::OverlayVideo::Options().still_frame,
          "Shows this frame in --still. -1: the last one.");
ABSL_FLAG(int, trail_frames, holdfast::OverlayVideo::Options().trail_frames, "Draws trails of this many frames.");
ABSL_FLAG(bool, show, false, "Shows the tracks in a window as soon as they are known. Esc or q ends as Ctrl-C does.");
ABSL_FLAG(int64_t, start_frame, 0, "Tracks from this frame of the input on. Frames keep the numbers of the input.");
ABSL_FLAG(int64_t, every, 1,
          "Tracks every so-many-th frame of the input, from --start_frame on, and those that points start on.");
ABSL_FLAG(int64_t, max_frames, 0, "Stops after having tracked this many frames. 0: at the end of the video.");
ABSL_FLAG(bool, both, false,
          "Follows each point from the frame it starts on back to the first frame, too. Keeps frames in a file below "
          "TMPDIR until the end.");
ABSL_FLAG(int, max_side, 0,
          "Shrinks frames before they are sent, so that their longest side has this many pixels: less to send, less "
          "detail. 0: sends them as they are.");
ABSL_FLAG(int, jpeg_quality, holdfast::TrackOptions().jpeg_quality,
          "Sends frames as JPEG of this quality, 1 to 100. Higher takes more bandwidth and keeps more detail.");
ABSL_FLAG(holdfast::ImageSize, processing_size, {},
          "Asks the server to track at WIDTHxHEIGHT, multiples of 32. Empty: at its default.");
ABSL_FLAG(holdfast::HopBounds, hop, {},
          "Asks for a window after this many new frames; LEAST..MOST: after the fewest at which the server would take "
          "the run when it begins, see --promise_fps; auto: after its default, or up to 16. 0: its default.");
ABSL_FLAG(int, iterations, 0, "Asks for this many refinement iterations of a window. 0: the server's default.");
ABSL_FLAG(bool, live, false,
          "Has every frame answered at once with what optical flow says, and shows that in --overlay, --still and "
          "--show. Of an input that does not wait, such as a camera, frames are left out when they come faster than "
          "answers.");
ABSL_FLAG(double, promise_fps, 0,
          "Asks the server to promise this many frames a second, and ends where it cannot. 0: at the pace that it has "
          "time for.");
ABSL_FLAG(bool, json, false, "Prints the server's answer as JSON.");
ABSL_FLAG(int, sessions, holdfast::LoadOptions().sessions, "Opens so many sessions at once.");
ABSL_FLAG(std::string, fps, "max", "Sends so many frames a second in each session. max: as many as the server takes.");
ABSL_FLAG(double, seconds, absl::ToDoubleSeconds(holdfast::LoadOptions().duration), "Sends for so long.");
ABSL_FLAG(double, ramp, 0, "Opens the sessions one after the other over so many seconds. 0: all at once.");
ABSL_FLAG(double, slow, 0, "Lets so many per cent of the sessions take their time over results.");
ABSL_FLAG(double, cancel, 0, "Lets so many per cent of the sessions go away and come back.");
ABSL_FLAG(double, bad, 0, "Lets so many per cent of the sessions send what is no frame, and come back.");

namespace holdfast {
namespace {

constexpr int kOk = 0;
constexpr int kFailed = 1;
constexpr int kUsage = 2;
constexpr int64_t kMaxBufferMib = 1 << 20;
constexpr int64_t kMaxTokenFileBytes = 4096;

constexpr char kUsageText[] = R"(Tracks points through video with a Holdfast server.

Usage: holdfast track INPUT [flags]   follow points and write their tracks
       holdfast info [flags]          say what the server runs
       holdfast load INPUT [flags]    put many sessions on the server and say how it bears them
       holdfast --help | --version

INPUT is a video file, a directory of .jpg or .png frames, camera:0 or /dev/video0, an address such as rtsp://... or
http://..., or - for JPEGs one after the other on standard input.
Every flag can also be set in the environment: HOLDFAST_SERVER for --server.

When the server is lost, a run goes on as soon as it is back, or with the next of several (--server=a:50051,b:50051).
A run that is cut short (Ctrl-C, no server any more, a broken INPUT) keeps what it has tracked and says which frames are
missing. Exit codes: 0 done, 1 failed, 2 called wrongly, 130 after Ctrl-C, 143 after SIGTERM.

Example: holdfast track walk.mp4 --grid=100 --out=tracks.json --overlay=overlay.mp4
)";

std::string Help() {
  return absl::StrCat(
      kUsageText, "\nServer (all commands):\n",
      DescribeFlags(
          {"server", "connect_timeout", "tls", "tls_ca", "tls_cert", "tls_key", "tls_server_name", "token_file"}),
      "\nWhen the server is lost (track, load):\n", DescribeFlags({"resume", "buffer_mib", "reconnect_timeout"}),
      "\nPoints (track; at least one of points, grid and mask):\n",
      DescribeFlags({"points", "grid", "mask", "reseed", "query_frame"}),
      "\nResults (track; at least one of out, overlay, still and show):\n",
      DescribeFlags({"out", "overlay", "still", "still_frame", "show", "trail_frames"}), "\nTracking (track):\n",
      DescribeFlags({"start_frame", "every", "max_frames", "both", "max_side", "jpeg_quality", "processing_size", "hop",
                     "iterations", "live", "promise_fps"}),
      "\nInfo:\n", DescribeFlags({"json"}),
      "\nLoad (with points, out, max_side, jpeg_quality, processing_size, hop, live and promise_fps of above):\n",
      DescribeFlags({"sessions", "fps", "seconds", "ramp", "slow", "cancel", "bad"}));
}

absl::StatusOr<TrackOptions> TrackOptionsFromFlags(const std::string& input) {
  TrackOptions options;
  options.input = input;
  options.points = {absl::GetFlag(FLAGS_points), absl::GetFlag(FLAGS_mask), absl::GetFlag(FLAGS_grid),
                    absl::GetFlag(FLAGS_query_frame), absl::GetFlag(FLAGS_reseed)};
  options.out = absl::GetFlag(FLAGS_out);
  options.overlay = {absl::GetFlag(FLAGS_overlay), absl::GetFlag(FLAGS_still), absl::GetFlag(FLAGS_still_frame),
                     absl::GetFlag(FLAGS_trail_frames), absl::GetFlag(FLAGS_show)};
  options.start_frame = absl::GetFlag(FLAGS_start_frame);
  options.every = absl::GetFlag(FLAGS_every);
  options.both = absl::GetFlag(FLAGS_both);
  options.max_frames = absl::GetFlag(FLAGS_max_frames);
  options.max_side = absl::GetFlag(FLAGS_max_side);
  options.jpeg_quality = absl::GetFlag(FLAGS_jpeg_quality);
  options.processing_size = absl::GetFlag(FLAGS_processing_size);
  options.hop = absl::GetFlag(FLAGS_hop);
  options.iterations = absl::GetFlag(FLAGS_iterations);
  options.live = absl::GetFlag(FLAGS_live);
  options.promise_fps = absl::GetFlag(FLAGS_promise_fps);
  if (absl::Status status = options.Validate(); !status.ok()) return status;
  return options;
}

// Of --points where that is a number.
absl::StatusOr<int> PointsOfEach() {
  const std::string text = absl::GetFlag(FLAGS_points);
  int points = LoadOptions().points;
  if (text.empty() || absl::SimpleAtoi(text, &points)) return points;
  return absl::InvalidArgumentError(absl::StrCat("--points: load takes a number, got ", text));
}

absl::StatusOr<double> FramesPerSecond() {
  const std::string text = absl::GetFlag(FLAGS_fps);
  double fps = 0;
  if (text == "max" || absl::SimpleAtod(text, &fps)) return fps;
  return absl::InvalidArgumentError(absl::StrCat("--fps: expected a number or max, got ", text));
}

absl::StatusOr<LoadOptions> LoadOptionsFromFlags(const std::string& input) {
  const absl::StatusOr<int> points = PointsOfEach();
  if (!points.ok()) return points.status();
  const absl::StatusOr<double> fps = FramesPerSecond();
  if (!fps.ok()) return fps.status();
  LoadOptions options;
  options.input = input;
  options.sessions = absl::GetFlag(FLAGS_sessions);
  options.points = *points;
  options.fps = *fps;
  options.duration = absl::Seconds(absl::GetFlag(FLAGS_seconds));
  options.ramp = absl::Seconds(absl::GetFlag(FLAGS_ramp));
  options.slow = absl::GetFlag(FLAGS_slow);
  options.cancel = absl::GetFlag(FLAGS_cancel);
  options.bad = absl::GetFlag(FLAGS_bad);
  options.out = absl::GetFlag(FLAGS_out);
  options.max_side = absl::GetFlag(FLAGS_max_side);
  options.jpeg_quality = absl::GetFlag(FLAGS_jpeg_quality);
  options.processing_size = absl::GetFlag(FLAGS_processing_size);
  options.hop = absl::GetFlag(FLAGS_hop);
  options.live = absl::GetFlag(FLAGS_live);
  options.promise_fps = absl::GetFlag(FLAGS_promise_fps);
  if (absl::Status status = options.Validate(); !status.ok()) return status;
  return options;
}

absl::Status CheckServerFlags() {
  if (absl::GetFlag(FLAGS_connect_timeout) <= absl::ZeroDuration()) {
    return absl::InvalidArgumentError("--connect_timeout: expected more than 0");
  }
  if (absl::GetFlag(FLAGS_buffer_mib) < 1 || absl::GetFlag(FLAGS_buffer_mib) > kMaxBufferMib) {
    return absl::InvalidArgumentError(absl::StrCat("--buffer_mib: expected 1..", kMaxBufferMib));
  }
  if (absl::GetFlag(FLAGS_reconnect_timeout) < absl::ZeroDuration()) {
    return absl::InvalidArgumentError("--reconnect_timeout: expected 0 or more");
  }
  return absl::OkStatus();
}

ClientTls TlsFromFlags() {
  ClientTls tls{absl::GetFlag(FLAGS_tls), absl::GetFlag(FLAGS_tls_ca), absl::GetFlag(FLAGS_tls_cert),
                absl::GetFlag(FLAGS_tls_key), absl::GetFlag(FLAGS_tls_server_name)};
  tls.enabled |= !tls.ca.empty() || !tls.cert.empty() || !tls.key.empty() || !tls.server_name.empty();
  return tls;
}

// Empty where no file is named. No error quotes what the file holds.
absl::StatusOr<std::string> TokenFromFlags() {
  const std::string path = absl::GetFlag(FLAGS_token_file);
  if (path.empty()) return "";
  const absl::StatusOr<std::string> text = ReadFile(path, kMaxTokenFileBytes);
  if (!text.ok()) return absl::InvalidArgumentError(absl::StrCat("--token_file: ", text.status().message()));
  const absl::string_view token = absl::StripAsciiWhitespace(*text);
  if (token.empty() || !CheckToken(token).ok()) {
    return absl::InvalidArgumentError(absl::StrCat("--token_file=", path, ": expected one token and nothing else"));
  }
  return std::string(token);
}

// INVALID_ARGUMENT for what is wrong with the flags themselves, before a server is looked for.
absl::StatusOr<RemoteTracker::Options> ServerFromFlags(const Console& console) {
  if (absl::Status status = CheckServerFlags(); !status.ok()) return status;
  RemoteTracker::Options options;
  const std::string servers = absl::GetFlag(FLAGS_server);
  for (const absl::string_view address : absl::StrSplit(servers, ',', absl::SkipWhitespace())) {
    options.addresses.emplace_back(absl::StripAsciiWhitespace(address));
  }
  options.tls = TlsFromFlags();
  if (absl::Status status = options.tls.Validate(); !status.ok()) return status;
  absl::StatusOr<std::string> token = TokenFromFlags();
  if (!token.ok()) return token.status();
  options.token = *std::move(token);
  if (!options.token.empty() && !options.tls.enabled &&
      !std::all_of(options.addresses.begin(), options.addresses.end(), IsLoopback)) {
    console.err << "holdfast: warning: the token travels in plain text; see --tls\n";
  }
  options.connect_timeout = absl::GetFlag(FLAGS_connect_timeout);
  options.resume = absl::GetFlag(FLAGS_resume);
  options.buffer_bytes = absl::GetFlag(FLAGS_buffer_mib) << 20;
  options.reconnect_timeout = absl::GetFlag(FLAGS_reconnect_timeout);
  // All else has been looked at.
  if (const absl::Status status = options.Validate(); !status.ok()) {
    return absl::InvalidArgumentError(absl::StrCat("--server: ", status.message()));
  }
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
    return Fail(console,
                absl::InvalidArgumentError("track: give one INPUT, a video, a directory, a camera, an address or -"),
                kUsage);
  }
  const auto options = TrackOptionsFromFlags(args[0]);
  if (!options.ok()) return Fail(console, options.status(), kUsage);
  const auto server = ServerFromFlags(console);
  if (!server.ok()) return Fail(console, server.status(), kUsage);
  const auto connect = [&server]() -> absl::StatusOr<std::unique_ptr<PointTracker>> {
    return RemoteTracker::Connect(*server);
  };
  const absl::Status status =
      RunTrack(*options, {connect, stop, console.out, console.err, console.terminal,
                          [](std::function<void()> quit) { return OpenPictureWindow("Holdfast", std::move(quit)); }});
  if (status.ok()) return kOk;
  const bool interrupted = absl::IsCancelled(status) && stop.stopped();
  return Fail(console, status, interrupted ? SignalExitCode(stop.signal()) : kFailed);
}

int Info(const std::vector<std::string>& args, const Console& console) {
  if (!args.empty()) {
    return Fail(console, absl::InvalidArgumentError(absl::StrCat("info: unexpected ", args[0])), kUsage);
  }
  const auto server = ServerFromFlags(console);
  if (!server.ok()) return Fail(console, server.status(), kUsage);
  const auto tracker = RemoteTracker::Connect(*server);
  if (!tracker.ok()) return Fail(console, tracker.status(), kFailed);
  const auto info = (*tracker)->Info();
  if (!info.ok()) return Fail(console, info.status(), kFailed);
  console.out << (absl::GetFlag(FLAGS_json) ? ServerAsJson(*info) : DescribeServer(*info));
  return kOk;
}

int Load(const std::vector<std::string>& args, const Console& console, StopSignal& stop) {
  if (args.size() != 1) {
    return Fail(console, absl::InvalidArgumentError("load: give one INPUT, a video or a directory"), kUsage);
  }
  const auto options = LoadOptionsFromFlags(args[0]);
  if (!options.ok()) return Fail(console, options.status(), kUsage);
  const auto server = ServerFromFlags(console);
  if (!server.ok()) return Fail(console, server.status(), kUsage);
  const auto connect = [&server]() -> absl::StatusOr<std::unique_ptr<PointTracker>> {
    return RemoteTracker::Connect(*server);
  };
  const absl::Status status = RunLoad(*options, {connect, stop, console.out});
  if (stop.stopped()) return SignalExitCode(stop.signal());
  return status.ok() ? kOk : Fail(console, status, kFailed);
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
  if (rest->empty()) return Fail(console, absl::InvalidArgumentError("give a command: track, info or load"), kUsage);
  const std::string command = rest->front();
  rest->erase(rest->begin());
  if (command == "track") return Track(*rest, console, stop);
  if (command == "info") return Info(*rest, console);
  if (command == "load") return Load(*rest, console, stop);
  return Fail(console,
              absl::InvalidArgumentError(absl::StrCat("unknown command ", command, ", expected track, info or load")),
              kUsage);
}

}  // namespace holdfast
