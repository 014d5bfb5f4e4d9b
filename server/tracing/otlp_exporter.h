// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/logger.h>

#include <cstddef>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/steady_event.h"
#include "server/events.h"
#include "server/tracing/span.h"

namespace holdfast {

// Sends spans to a collector in batches, over OTLP/gRPC, on a thread of its own. A collector that is away or slow costs
// spans, never a stream's time: what does not fit into the queue, or is not taken in time, is dropped and counted.
class OtlpExporter final : public SpanSink {
 public:
  struct Options {
    std::string endpoint;                        // host:port or http://host:port; https://host:port over TLS
    absl::Duration period = absl::Seconds(1);    // between batches
    absl::Duration timeout = absl::Seconds(10);  // for one to be taken
    size_t max_batch = 512;                      // spans of one batch, which is sent before the period is over
    size_t max_queue = 8192;                     // spans that wait
  };
  // INVALID_ARGUMENT for an endpoint that is none. 'events' must outlive the exporter.
  static absl::StatusOr<std::unique_ptr<OtlpExporter>> Create(const Options& options, ServerEvents& events,
                                                              std::shared_ptr<spdlog::logger> log);
  // Sends what waits, as far as the collector takes it within two seconds.
  ~OtlpExporter() override;

  void Take(Span span) override ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  class Collector;
  OtlpExporter(const Options& options, std::unique_ptr<Collector> collector, ServerEvents& events,
               std::shared_ptr<spdlog::logger> log);
  void Run() ABSL_LOCKS_EXCLUDED(mutex_);
  bool stopping() const ABSL_LOCKS_EXCLUDED(mutex_);
  std::vector<Span> NextBatch() ABSL_LOCKS_EXCLUDED(mutex_);
  void Send(const std::vector<Span>& batch);

  const Options options_;
  const std::unique_ptr<Collector> collector_;
  ServerEvents& events_;
  const std::shared_ptr<spdlog::logger> log_;
  bool failing_ = false;  // the exporter's thread: the last batch was not taken

  mutable absl::Mutex mutex_;
  std::vector<Span> queue_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  SteadyEvent done_;    // nothing is sent any more
  SteadyEvent work_;    // a batch is full, or stopping_ was set
  std::thread thread_;  // last: it uses the rest
};

}  // namespace holdfast
