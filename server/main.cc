// SPDX-License-Identifier: Apache-2.0
// holdfast-server: flags -> options -> objects -> run. Exit status: 0 after a signal, 1 when it could not start, 2 for
// wrong flags. With --healthcheck it asks another one how it is.
#include <spdlog/logger.h>

#include <cstdlib>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "api/clock.h"
#include "program/flags.h"
#include "program/network_process.h"
#include "program/termination.h"
#include "server/checkpoint/token_sealer.h"
#include "server/engine/engine.h"
#include "server/flags.h"
#include "server/health_check.h"
#include "server/http_endpoint.h"
#include "server/logging.h"
#include "server/port_file.h"
#include "server/prometheus_metrics.h"
#include "server/server.h"

namespace holdfast {
namespace {

constexpr absl::Duration kHealthTimeout = absl::Seconds(3);
constexpr Program kProgram = {
    "holdfast-server",
    "Tracks points in streamed video over gRPC. Every flag can also be set by an environment variable,\n"
    "HOLDFAST_MAX_SESSIONS for --max_sessions; the command line wins."};

std::string Describe(const TrackerInfo& info) {
  return absl::StrCat(info.model_name, " (", info.preset, "), weights ", info.weights_sha256.substr(0, 12), ", ",
                      info.precision, " on ", info.device);
}

absl::StatusOr<std::unique_ptr<Engine>> CreateEngine(EngineOptions options, const CheckpointSealer& sealer,
                                                     Clock& clock, EngineMetrics& metrics) {
  options.sealer = &sealer;
  return Engine::Create(options, clock, metrics);
}

// Serves until 'asked_to_stop'.
absl::Status Run(const ServerOptions& options, const absl::Notification& asked_to_stop,
                 const std::shared_ptr<spdlog::logger>& log) {
  SystemClock clock;
  PrometheusMetrics metrics(log);
  const auto sealer = TokenSealer::Create({options.checkpoint_keys, options.checkpoint_max_age}, clock, log);
  if (!sealer.ok()) return sealer.status();
  std::unique_ptr<Engine> engine;  // outlives the server's streams
  auto server = Server::Start(options, clock, metrics, log);
  if (!server.ok()) return server.status();
  auto http = StartHttpEndpoint(
      options.metrics_listen, [&metrics] { return metrics.Text(); },
      [&server] { return (*server)->state() == LifecycleState::kServing; });
  if (!http.ok()) return http.status();
  log->info(absl::StrCat("gRPC on port ", (*server)->port(), " (", options.listen, "), HTTP on port ", (*http)->port(),
                         " (", options.metrics_listen, "); loading the model"));
  if ((*server)->web_port() != 0) {
    log->info(absl::StrCat("the page for browsers on port ", (*server)->web_port(), " (", options.web_listen, ")"));
  }

  if (!options.port_file.empty()) {
    if (absl::Status status = PreparePortFile(options.port_file); !status.ok()) return status;
  }
  auto created = CreateEngine(options.engine, **sealer, clock, metrics);
  if (!created.ok()) return created.status();
  engine = *std::move(created);
  metrics.ModelLoaded(engine->info());
  if (asked_to_stop.HasBeenNotified()) {
    log->info("asked to stop before it was ready");
    return absl::OkStatus();
  }
  (*server)->Serve(*engine);
  log->info(absl::StrCat("ready: ", Describe(engine->info())));
  if (!options.port_file.empty()) {
    const absl::Status written = WritePortFile(
        options.port_file, {{"grpc", (*server)->port()}, {"metrics", (*http)->port()}, {"web", (*server)->web_port()}});
    if (!written.ok()) return written;
  }

  asked_to_stop.WaitForNotification();
  log->info(absl::StrCat("shutting down; sessions have ", absl::FormatDuration(options.grace_period), " to finish"));
  (*server)->Drain();
  if (!options.port_file.empty()) RemovePortFile(options.port_file);
  log->info("bye");
  return absl::OkStatus();
}

int Complain(const absl::Status& status, int exit_status) {
  std::cerr << "holdfast-server: " << status.message() << "\n";
  return exit_status;
}

int AnswerHealthCheck(const std::string& address) {
  const absl::Status health = CheckHealth(address, kHealthTimeout);
  return health.ok() ? 0 : Complain(health, 1);
}

// Sets the flags and does what takes no network; nothing: serve.
std::optional<int> RunWithoutNetwork(const std::vector<std::string>& args) {
  if (AnswerQuestion(kProgram, args, std::cout)) return 0;
  if (const absl::Status set = SetFlags(args, std::getenv); !set.ok()) return Complain(set, 2);
  if (const auto address = AddressToCheck()) return AnswerHealthCheck(*address);
  return std::nullopt;
}

int Serve() {
  const absl::StatusOr<ServerOptions> options = OptionsFromFlags();
  if (!options.ok()) return Complain(options.status(), absl::IsNotFound(options.status()) ? 1 : 2);
  absl::Notification asked_to_stop;
  StopSignal stop;
  stop.SetCallback([&asked_to_stop] { asked_to_stop.Notify(); });
  const TerminationWatcher watcher(stop);
  const auto log = MakeLogger(options->log_format, options->log_level);
  const absl::Status status = Run(*options, asked_to_stop, log);
  if (!status.ok()) log->error(absl::StrCat("cannot serve: ", status.message()));
  return status.ok() ? 0 : 1;
}

}  // namespace
}  // namespace holdfast

int main(int argc, char** argv) {
  // Questions first: what prepares for the network may execute the program once more.
  if (const auto exit_status = holdfast::RunWithoutNetwork({argv + 1, argv + argc})) return *exit_status;
  holdfast::PrepareForNetwork(argv);
  return holdfast::Serve();
}
