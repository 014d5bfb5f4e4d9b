// SPDX-License-Identifier: Apache-2.0
#include "server/tracing/otlp_exporter.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "api/errors.h"
#include "opentelemetry/trace_service.grpc.pb.h"
#include "program/flags.h"
#include "proto/grpc_deadline.h"

namespace holdfast {
namespace {

namespace otlp = opentelemetry::proto::collector::trace::v1;

constexpr absl::Duration kLastWords = absl::Seconds(2);  // for all batches that are left at the end
constexpr char kService[] = "holdfast-server";

void AddText(const std::string& key, const std::string& value, otlp::KeyValue* out) {
  out->set_key(key);
  out->mutable_value()->set_string_value(value);
}

void ToOtlp(const Span& span, otlp::Span* out) {
  out->set_trace_id(absl::HexStringToBytes(span.trace_id));
  out->set_span_id(absl::HexStringToBytes(span.span_id));
  out->set_parent_span_id(absl::HexStringToBytes(span.parent_id));
  out->set_name(span.name);
  out->set_kind(span.name.find('/') == std::string::npos ? otlp::Span::KIND_INTERNAL : otlp::Span::KIND_SERVER);
  out->set_start_time_unix_nano(static_cast<uint64_t>(absl::ToUnixNanos(span.begin)));
  out->set_end_time_unix_nano(static_cast<uint64_t>(absl::ToUnixNanos(span.end)));
  for (const auto& [key, value] : span.texts) AddText(key, value, out->add_attributes());
  for (const auto& [key, value] : span.numbers) {
    otlp::KeyValue* const attribute = out->add_attributes();
    attribute->set_key(key);
    attribute->mutable_value()->set_int_value(value);
  }
  if (span.status.ok()) return;
  out->mutable_status()->set_code(otlp::SpanStatus::CODE_ERROR);
  out->mutable_status()->set_message(absl::StatusCodeToString(span.status.code()));
}

otlp::ExportTraceServiceRequest ToOtlp(const std::vector<Span>& spans) {
  otlp::ExportTraceServiceRequest request;
  otlp::ResourceSpans* const resource = request.add_resource_spans();
  AddText("service.name", kService, resource->mutable_resource()->add_attributes());
  AddText("service.version", std::string(ProgramVersion()), resource->mutable_resource()->add_attributes());
  otlp::ScopeSpans* const scope = resource->add_scope_spans();
  scope->mutable_scope()->set_name("holdfast");
  for (const Span& span : spans) ToOtlp(span, scope->add_spans());
  return request;
}

}  // namespace

class OtlpExporter::Collector {
 public:
  explicit Collector(const std::shared_ptr<grpc::Channel>& channel) : stub_(otlp::TraceService::NewStub(channel)) {}

  // How many spans it refused. One thread at a time.
  absl::StatusOr<int64_t> Export(const std::vector<Span>& spans, absl::Duration timeout) {
    grpc::ClientContext context;
    context.set_deadline(SteadyDeadline(timeout));
    otlp::ExportTraceServiceResponse response;
    if (!Begin(context)) return absl::CancelledError("no more is sent");
    const grpc::Status status = stub_->Export(&context, ToOtlp(spans), &response);
    End();
    if (!status.ok()) return absl::UnavailableError(status.error_message());
    return std::clamp<int64_t>(response.partial_success().rejected_spans(), 0, static_cast<int64_t>(spans.size()));
  }

  // Cancels the export that is going on, and those to come.
  void GiveUp() {
    absl::MutexLock lock(&mutex_);
    given_up_ = true;
    if (current_ != nullptr) current_->TryCancel();
  }

 private:
  bool Begin(grpc::ClientContext& context) {
    absl::MutexLock lock(&mutex_);
    if (!given_up_) current_ = &context;
    return !given_up_;
  }
  void End() {
    absl::MutexLock lock(&mutex_);
    current_ = nullptr;
  }

  const std::unique_ptr<otlp::TraceService::Stub> stub_;
  absl::Mutex mutex_;
  grpc::ClientContext* current_ ABSL_GUARDED_BY(mutex_) = nullptr;  // of the export that is going on
  bool given_up_ ABSL_GUARDED_BY(mutex_) = false;
};

absl::StatusOr<std::unique_ptr<OtlpExporter>> OtlpExporter::Create(const Options& options, ServerEvents& events,
                                                                   std::shared_ptr<spdlog::logger> log) {
  absl::string_view address = options.endpoint;
  const bool tls = absl::ConsumePrefix(&address, "https://");
  if (!tls) absl::ConsumePrefix(&address, "http://");
  absl::ConsumeSuffix(&address, "/");
  if (!absl::StrContains(address, ':') || absl::StrContains(address, '/')) {
    return InvalidFieldError("otlp_endpoint", absl::StrCat("is \"", options.endpoint,
                                                           "\", expected host:port, http://host:port or "
                                                           "https://host:port"));
  }
  const auto credentials =
      tls ? grpc::SslCredentials(grpc::SslCredentialsOptions()) : grpc::InsecureChannelCredentials();
  auto collector = std::make_unique<Collector>(grpc::CreateChannel(std::string(address), credentials));
  return std::unique_ptr<OtlpExporter>(new OtlpExporter(options, std::move(collector), events, std::move(log)));
}

OtlpExporter::OtlpExporter(const Options& options, std::unique_ptr<Collector> collector, ServerEvents& events,
                           std::shared_ptr<spdlog::logger> log)
    : options_(options), collector_(std::move(collector)), events_(events), log_(std::move(log)), thread_([this] {
        Run();
      }) {}

OtlpExporter::~OtlpExporter() {
  {
    absl::MutexLock lock(&mutex_);
    stopping_ = true;
    work_.Notify();
  }
  if (!done_.WaitFor(kLastWords)) collector_->GiveUp();
  thread_.join();
}

void OtlpExporter::Take(Span span) {
  {
    absl::MutexLock lock(&mutex_);
    if (queue_.size() < options_.max_queue) {
      queue_.push_back(std::move(span));
      if (queue_.size() >= options_.max_batch) work_.Notify();
      return;
    }
  }
  events_.SpansDone(SpanResult::kDropped, 1);
}

void OtlpExporter::Run() {
  for (bool last = false; !last;) {
    work_.WaitFor(options_.period);
    last = stopping();
    for (std::vector<Span> batch = NextBatch(); !batch.empty(); batch = NextBatch()) {
      Send(batch);
      if (failing_ && stopping()) break;
    }
  }
  done_.Notify();
}

bool OtlpExporter::stopping() const {
  absl::MutexLock lock(&mutex_);
  return stopping_;
}

std::vector<Span> OtlpExporter::NextBatch() {
  absl::MutexLock lock(&mutex_);
  const auto end = queue_.begin() + static_cast<std::ptrdiff_t>(std::min(queue_.size(), options_.max_batch));
  std::vector<Span> batch(std::make_move_iterator(queue_.begin()), std::make_move_iterator(end));
  queue_.erase(queue_.begin(), end);
  return batch;
}

void OtlpExporter::Send(const std::vector<Span>& batch) {
  const auto spans = static_cast<int64_t>(batch.size());
  const absl::StatusOr<int64_t> refused = collector_->Export(batch, options_.timeout);
  events_.SpansDone(SpanResult::kSent, refused.ok() ? spans - *refused : 0);
  events_.SpansDone(SpanResult::kDropped, refused.ok() ? *refused : spans);
  if (refused.ok() == !failing_) return;  // once for each change
  failing_ = !refused.ok();
  if (failing_) {
    log_->warn(absl::StrCat("spans are lost: ", options_.endpoint, ": ", refused.status().message()));
  } else {
    log_->info(absl::StrCat("spans reach ", options_.endpoint, " again"));
  }
}

}  // namespace holdfast
