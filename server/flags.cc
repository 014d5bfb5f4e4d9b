// SPDX-License-Identifier: Apache-2.0
#include "server/flags.h"

#include <cmath>
#include <vector>

#include "absl/flags/flag.h"
#include "absl/strings/str_cat.h"
#include "program/program_path.h"
#include "program/shipped_weights.h"

// A flag that is not given leaves what the options say by themselves.
namespace holdfast {
namespace {

const ServerOptions& Defaults() {
  static const auto* const defaults = new ServerOptions;  // flags are made before main and may outlive statics
  return *defaults;
}

constexpr double kMega = 1e6;
constexpr int64_t kMebi = int64_t{1} << 20;

int64_t Mebi(int64_t bytes) { return bytes / kMebi; }

}  // namespace
}  // namespace holdfast

using holdfast::Defaults;
using holdfast::Mebi;

ABSL_FLAG(std::string, listen, Defaults().listen,
          "Serves gRPC on this host:port. Port 0: a free one, which --port_file tells.");
ABSL_FLAG(std::string, metrics_listen, Defaults().metrics_listen,
          "Serves /metrics, /healthz and /readyz over HTTP on this host:port. Port 0: a free one.");
ABSL_FLAG(std::string, web_listen, Defaults().web_listen,
          "Serves the page for browsers, and streams over WebSockets, on this host:port. Port 0: a free one. Empty: to "
          "no browser.");
ABSL_FLAG(std::vector<std::string>, web_origins, Defaults().web_origins,
          "Lets pages of these origins, https://tracks.example,…, open sockets at --web_listen, beside the server's "
          "own page; needed behind a proxy where --web_listen is of this machine alone.");
ABSL_FLAG(
    std::string, port_file, Defaults().port_file,
    "Writes the bound ports to this file once the server is ready, and removes it at the end. Empty: to no file.");
ABSL_FLAG(bool, healthcheck, false,
          "Asks the server that runs with these flags, at --metrics_listen, whether it takes sessions, and ends: exit "
          "status 0 when it does, 1 when not.");
ABSL_FLAG(std::string, weights, "",
          "Loads the network from this safetensors file. Empty: the shipped one, beside the program, of its source "
          "tree or installed.");
ABSL_FLAG(std::string, device, Defaults().engine.device,
          "Computes on this device, as LibTorch names it: cpu, cuda, cuda:1.");
ABSL_FLAG(std::string, precision, "auto",
          "Computes in float32 or bfloat16. auto: bfloat16 where the device computes it faster and a check at start "
          "finds it right. On a processor without AVX-512 bfloat16 takes many times as long.");
ABSL_FLAG(
    int, compute_threads, Defaults().engine.compute_threads,
    "Shares what the network does out among this many threads; fewer leave cores to decoding and to neighbours. 0: all "
    "cores that the process may use, by its affinity and its container's quota.");
ABSL_FLAG(int, decode_threads, Defaults().engine.decode_threads,
          "Decodes frames and computes optical flow on this many threads; of several, one is kept for sessions that "
          "use little.");
ABSL_FLAG(holdfast::ImageSize, processing_size, Defaults().engine.processing_size,
          "Resizes frames to WIDTHxHEIGHT, multiples of 32, where a session names no size. Time and memory grow with "
          "it; small details are lost below the size of the video.");
ABSL_FLAG(int, hop, Defaults().engine.hop_frames,
          "Begins a window after this many new frames, where a session names no number. Fewer revise estimates more "
          "often and cost a window each time.");
ABSL_FLAG(
    int, iterations, Defaults().engine.iterations,
    "Refines the positions of a window this many times at most, where a session names no number. Each costs time.");
ABSL_FLAG(double, least_step, Defaults().engine.least_step,
          "Ends the window of a point early, after an iteration that moved the point by less than this many pixels of "
          "the processing size on every frame. 0: never. Servers that take up each other's sessions need the same.");
ABSL_FLAG(bool, motion_prior, Defaults().engine.motion_prior,
          "Starts windows from where optical flow leads, and looks for points that are lost, where a session leaves it "
          "open. Follows fast motion; costs time of a decode thread on every frame.");
ABSL_FLAG(bool, polish, Defaults().engine.polish,
          "Moves final positions to where the picture says, where a session leaves it open. Finer; costs time of a "
          "decode thread on every frame.");
ABSL_FLAG(int, max_sessions, Defaults().engine.max_sessions, "Refuses further sessions while this many are open.");
ABSL_FLAG(double, max_load, Defaults().engine.max_load,
          "Refuses a session whose work, beside what open ones were promised, would take more than this share of the "
          "computing time, as measured at start and since. 0: sessions are not counted by work.");
ABSL_FLAG(
    double, least_fps, Defaults().engine.least_frames_per_second,
    "Promises this many frames a second to a session that names no rate. One that is alone is taken at any pace.");
ABSL_FLAG(int, max_points, Defaults().engine.limits.max_points, "Refuses more points than this in one session.");
ABSL_FLAG(int, max_frame_mib, static_cast<int>(Mebi(Defaults().engine.limits.max_frame_bytes)),
          "Refuses encoded frames of more than this many MiB.");
ABSL_FLAG(double, max_frame_megapixels, Defaults().engine.limits.max_frame_pixels / holdfast::kMega,
          "Refuses frames of more than this many million pixels.");
ABSL_FLAG(int64_t, max_session_frames, Defaults().engine.limits.max_frames,
          "Ends a session after this many frames. 0: never.");
ABSL_FLAG(
    int64_t, cache_mib, Mebi(Defaults().engine.cache_budget_bytes),
    "Keeps the features and pictures of all sessions within this many MiB; a session that might need more is refused.");
ABSL_FLAG(int, max_batch_rows, Defaults().engine.max_batch_rows,
          "Refines at most this many rows (windows of a point) in one batch. More is more throughput and a longer wait "
          "for the others.");
ABSL_FLAG(int, max_pending_frames, Defaults().engine.max_pending_frames,
          "Lets this many frames of a session wait to be encoded; then the server stops reading its stream.");
ABSL_FLAG(
    absl::Duration, first_message_timeout, Defaults().first_message_timeout,
    "Ends a stream whose configuration has not come after this time, once all places for streams are taken. While "
    "some are free it may take 256 s longer: a checkpoint comes with it, which a thin line carries slowly.");
ABSL_FLAG(
    absl::Duration, idle_timeout, Defaults().idle_timeout,
    "Ends a stream whose client has neither sent nor read for this time. While places for streams are free, what it "
    "sends may take as much longer as the largest frame on a line of 64 KiB/s: it shows once it is there. inf: never.");
ABSL_FLAG(absl::Duration, grace_period, Defaults().grace_period,
          "Leaves running sessions this much time to finish by themselves at shutdown.");
ABSL_FLAG(
    std::string, checkpoint_keys, Defaults().checkpoint_keys,
    "Signs checkpoints with the keys of this file, one id:secret a line, the secret of at least 32 bytes in hex or "
    "Base64: the first one signs, all are taken, and a changed file is read again. Servers that share it take up "
    "each other's sessions. Empty: with a random key, so that sessions are resumed by this process only.");
ABSL_FLAG(std::string, tls_cert, "",
          "Serves gRPC over TLS with the certificate of this file (PEM, then those that lead to its authority). A "
          "changed file counts for new connections. Empty: plain text.");
ABSL_FLAG(std::string, tls_key, "", "Has the private key of --tls_cert in this file (PEM).");
ABSL_FLAG(std::string, tls_client_ca, "",
          "Lets in only clients with a certificate of an authority of this file (PEM). Empty: clients need none.");
ABSL_FLAG(std::string, token_file, "",
          "Lets in only callers with a token of this file, one name:token a line, behind it max_sessions=N and "
          "max_points=N where the name has limits of its own. A changed file is read again. Empty: lets all in.");
ABSL_FLAG(bool, open_health, Defaults().open_health,
          "Answers grpc.health.v1 without a token. false: not at all; /readyz tells the same.");
ABSL_FLAG(
    bool, open_reflection, Defaults().open_reflection,
    "Answers reflection without a token where --token_file is given. Without that file reflection is there anyhow.");
ABSL_FLAG(absl::Duration, checkpoint_max_age, Defaults().checkpoint_max_age,
          "Refuses checkpoints that are older than this. inf: none.");
ABSL_FLAG(absl::Duration, keepalive_time, Defaults().keepalive_time,
          "Pings a client that has been silent for this time, and drops it when it does not answer. inf: never.");
ABSL_FLAG(absl::Duration, max_connection_age, Defaults().max_connection_age,
          "Takes no new streams on a connection that is older than this, so that clients spread over new servers. inf: "
          "always.");
ABSL_FLAG(std::string, otlp_endpoint, Defaults().otlp_endpoint,
          "Sends spans of sessions and of the work for them over OTLP/gRPC to this collector: host:port, or "
          "https://host:port. Callers' traceparent decides which; without one, all. Empty: none.");
ABSL_FLAG(std::string, log_format, "text", "Writes log lines as text or json.");
ABSL_FLAG(std::string, log_level, Defaults().log_level,
          "Logs what is at least this grave: trace, debug, info, warning, error, critical or off.");

namespace holdfast {
namespace {

absl::Status BadFlag(absl::string_view name, absl::string_view value, absl::string_view expected) {
  return absl::InvalidArgumentError(absl::StrCat(name, " is '", value, "', expected ", expected));
}

absl::StatusOr<Precision> ParsePrecision(const std::string& text) {
  if (text == "auto") return Precision::kAuto;
  if (text == "float32") return Precision::kFloat32;
  if (text == "bfloat16") return Precision::kBFloat16;
  return BadFlag("precision", text, "auto, float32 or bfloat16");
}

absl::StatusOr<LogFormat> ParseLogFormat(const std::string& text) {
  if (text == "text") return LogFormat::kText;
  if (text == "json") return LogFormat::kJson;
  return BadFlag("log_format", text, "text or json");
}

// Of flags that the options have by other names or in other units; the options check themselves.
absl::Status CheckRanges() {
  struct Range {
    absl::string_view name;
    double value, lowest, highest;
  };
  constexpr double kMost = 1 << 20;
  for (const Range& flag : {Range{"hop", double(absl::GetFlag(FLAGS_hop)), 1, kMost},
                            {"least_fps", absl::GetFlag(FLAGS_least_fps), 0, kMost},
                            {"max_points", double(absl::GetFlag(FLAGS_max_points)), 1, kMaxPointsInMessage},
                            {"max_frame_mib", double(absl::GetFlag(FLAGS_max_frame_mib)), 1, 2046},
                            {"max_frame_megapixels", absl::GetFlag(FLAGS_max_frame_megapixels), 1e-3, kMost},
                            {"max_session_frames", double(absl::GetFlag(FLAGS_max_session_frames)), 0, 1e18},
                            {"cache_mib", double(absl::GetFlag(FLAGS_cache_mib)), 1, kMost * 1024}}) {
    if (flag.value >= flag.lowest && flag.value <= flag.highest) continue;  // nor is NaN
    return BadFlag(flag.name, absl::StrCat(flag.value), absl::StrCat(flag.lowest, " .. ", flag.highest));
  }
  return absl::OkStatus();
}

// Rounded, so that the default in millions is the default in pixels.
int64_t PixelsFromMega(double megapixels) { return std::llround(megapixels * kMega); }

absl::StatusOr<std::string> WeightsFromFlags() {
  const std::string named = absl::GetFlag(FLAGS_weights);
  if (!named.empty()) return named;
  return FindShippedWeights(ProgramPath());
}

absl::StatusOr<EngineOptions> EngineOptionsFromFlags() {
  if (absl::Status status = CheckRanges(); !status.ok()) return status;
  EngineOptions options;
  const absl::StatusOr<std::string> weights = WeightsFromFlags();
  if (!weights.ok()) return weights.status();
  options.weights_path = *weights;
  options.device = absl::GetFlag(FLAGS_device);
  const auto precision = ParsePrecision(absl::GetFlag(FLAGS_precision));
  if (!precision.ok()) return precision.status();
  options.precision = *precision;
  options.compute_threads = absl::GetFlag(FLAGS_compute_threads);
  options.decode_threads = absl::GetFlag(FLAGS_decode_threads);
  options.processing_size = absl::GetFlag(FLAGS_processing_size);
  options.hop_frames = absl::GetFlag(FLAGS_hop);
  options.iterations = absl::GetFlag(FLAGS_iterations);
  options.least_step = absl::GetFlag(FLAGS_least_step);
  options.motion_prior = absl::GetFlag(FLAGS_motion_prior);
  options.polish = absl::GetFlag(FLAGS_polish);
  options.max_sessions = absl::GetFlag(FLAGS_max_sessions);
  options.max_load = absl::GetFlag(FLAGS_max_load);
  options.least_frames_per_second = absl::GetFlag(FLAGS_least_fps);
  options.max_batch_rows = absl::GetFlag(FLAGS_max_batch_rows);
  options.max_pending_frames = absl::GetFlag(FLAGS_max_pending_frames);
  options.cache_budget_bytes = absl::GetFlag(FLAGS_cache_mib) * kMebi;
  options.limits.max_points = absl::GetFlag(FLAGS_max_points);
  options.limits.max_frame_bytes = absl::GetFlag(FLAGS_max_frame_mib) * kMebi;
  options.limits.max_frame_pixels = PixelsFromMega(absl::GetFlag(FLAGS_max_frame_megapixels));
  options.limits.max_frames = absl::GetFlag(FLAGS_max_session_frames);
  return options;
}

}  // namespace

std::optional<std::string> AddressToCheck() {
  if (!absl::GetFlag(FLAGS_healthcheck)) return std::nullopt;
  return absl::GetFlag(FLAGS_metrics_listen);
}

absl::StatusOr<ServerOptions> OptionsFromFlags() {
  ServerOptions options;
  auto engine = EngineOptionsFromFlags();
  if (!engine.ok()) return engine.status();
  options.engine = *std::move(engine);
  const auto log_format = ParseLogFormat(absl::GetFlag(FLAGS_log_format));
  if (!log_format.ok()) return log_format.status();
  options.log_format = *log_format;
  options.log_level = absl::GetFlag(FLAGS_log_level);
  options.listen = absl::GetFlag(FLAGS_listen);
  options.otlp_endpoint = absl::GetFlag(FLAGS_otlp_endpoint);
  options.metrics_listen = absl::GetFlag(FLAGS_metrics_listen);
  options.web_listen = absl::GetFlag(FLAGS_web_listen);
  options.web_origins = absl::GetFlag(FLAGS_web_origins);
  options.port_file = absl::GetFlag(FLAGS_port_file);
  options.first_message_timeout = absl::GetFlag(FLAGS_first_message_timeout);
  options.idle_timeout = absl::GetFlag(FLAGS_idle_timeout);
  options.grace_period = absl::GetFlag(FLAGS_grace_period);
  options.tls = {absl::GetFlag(FLAGS_tls_cert), absl::GetFlag(FLAGS_tls_key), absl::GetFlag(FLAGS_tls_client_ca)};
  options.token_file = absl::GetFlag(FLAGS_token_file);
  options.open_health = absl::GetFlag(FLAGS_open_health);
  options.open_reflection = absl::GetFlag(FLAGS_open_reflection);
  options.checkpoint_keys = absl::GetFlag(FLAGS_checkpoint_keys);
  options.checkpoint_max_age = absl::GetFlag(FLAGS_checkpoint_max_age);
  options.keepalive_time = absl::GetFlag(FLAGS_keepalive_time);
  options.max_connection_age = absl::GetFlag(FLAGS_max_connection_age);
  if (absl::Status status = options.Validate(); !status.ok()) return status;
  return options;
}

}  // namespace holdfast
