// SPDX-License-Identifier: Apache-2.0
#include "server/tracing/otlp_exporter.h"

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "api/clock.h"
#include "opentelemetry/trace_service.grpc.pb.h"
#include "server/logging.h"
#include "tests/support/fake_engine.h"
#include "tests/support/status_matchers.h"
#include "tests/support/test_server.h"
#include "tests/support/track_call.h"

namespace holdfast {
namespace {

namespace otlp = opentelemetry::proto::collector::trace::v1;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr char kTrace[] = "4bf92f3577b34da6a3ce929d0e0e4736";
constexpr char kParent[] = "00f067aa0ba902b7";

// Keeps the spans that it gets. 'on_export' is called first; so many spans of every batch are 'rejected'.
class Collector final : public otlp::TraceService::Service {
 public:
  explicit Collector(std::function<void()> on_export = nullptr, int64_t rejected = 0)
      : on_export_(std::move(on_export)), rejected_(rejected) {
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
    builder.RegisterService(this);
    server_ = builder.BuildAndStart();
  }
  std::string address() const { return absl::StrCat("127.0.0.1:", port_); }

  grpc::Status Export(grpc::ServerContext*, const otlp::ExportTraceServiceRequest* request,
                      otlp::ExportTraceServiceResponse* response) override {
    if (on_export_) on_export_();
    absl::MutexLock lock(&mutex_);
    for (const auto& resource : request->resource_spans()) {
      for (const auto& attribute : resource.resource().attributes()) {
        resource_[attribute.key()] = attribute.value().string_value();
      }
      for (const auto& span : resource.scope_spans(0).spans()) spans_.push_back(span);
    }
    response->mutable_partial_success()->set_rejected_spans(rejected_);
    return grpc::Status::OK;
  }

  std::vector<otlp::Span> spans() const {
    absl::MutexLock lock(&mutex_);
    return spans_;
  }
  std::map<std::string, std::string> resource() const {
    absl::MutexLock lock(&mutex_);
    return resource_;
  }

 private:
  const std::function<void()> on_export_;
  const int64_t rejected_;
  int port_ = 0;
  mutable absl::Mutex mutex_;
  std::vector<otlp::Span> spans_;
  std::map<std::string, std::string> resource_;
  std::unique_ptr<grpc::Server> server_;
};

// A session of 'frames' through a server that tells 'endpoint' of it, and is gone when this returns.
void RunSession(const std::string& endpoint, const std::string& trace_parent, const std::vector<std::string>& frames) {
  FakeEngine engine;
  ServerOptions options;
  options.otlp_endpoint = endpoint;
  TestServer server(&engine, options);
  TrackCall call(server.NewChannel(), trace_parent);
  ASSERT_TRUE(call.SendConfig(ToProto(JpegConfig())));
  ASSERT_TRUE(call.ReadAccepted());
  for (size_t i = 0; i < frames.size(); ++i) call.SendFrame(static_cast<int64_t>(i), frames[i]);
  call.FinishAndReadToEnd().IgnoreError();
  server.server().Drain();
}

std::string TraceParent(const char* flags) { return absl::StrCat("00-", kTrace, "-", kParent, "-", flags); }

std::map<std::string, std::string> TextsOf(const otlp::Span& span) {
  std::map<std::string, std::string> texts;
  for (const auto& attribute : span.attributes()) texts[attribute.key()] = attribute.value().string_value();
  return texts;
}

TEST(OtlpExporterTest, ASessionIsASpanOfItsCallersTraceAndItsWorkAreSpansBelow) {
  Collector collector;
  RunSession(collector.address(), TraceParent("01"), {"good", "good", "good"});
  const std::vector<otlp::Span> spans = collector.spans();
  ASSERT_THAT(spans, SizeIs(4));
  EXPECT_EQ(collector.resource()["service.name"], "holdfast-server");
  const otlp::Span& session = spans.back();
  EXPECT_EQ(session.name(), "holdfast.v1.PointTracking/Track");
  EXPECT_EQ(session.kind(), otlp::Span::KIND_SERVER);
  EXPECT_EQ(absl::BytesToHexString(session.parent_span_id()), kParent);
  EXPECT_THAT(session.span_id(), SizeIs(8));
  EXPECT_THAT(TextsOf(session)["holdfast.session"], HasSubstr("session-"));
  EXPECT_EQ(session.status().code(), otlp::SpanStatus::CODE_UNSET);
  EXPECT_LE(session.start_time_unix_nano(), session.end_time_unix_nano());
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(absl::BytesToHexString(spans[i].trace_id()), kTrace);
    EXPECT_EQ(spans[i].name(), "refine");
    EXPECT_EQ(spans[i].kind(), otlp::Span::KIND_INTERNAL);
    EXPECT_EQ(spans[i].parent_span_id(), session.span_id());
    EXPECT_NE(spans[i].span_id(), session.span_id());
    EXPECT_EQ(spans[i].attributes(0).key(), "holdfast.first_frame");
    EXPECT_EQ(spans[i].attributes(0).value().int_value(), static_cast<int64_t>(i));
  }
}

TEST(OtlpExporterTest, AFailedSessionIsAnErrorThatTellsNoText) {
  Collector collector;
  RunSession(absl::StrCat("http://", collector.address()), "", {"good", "bad"});
  ASSERT_THAT(collector.spans(), SizeIs(2));
  const otlp::Span session = collector.spans().back();
  EXPECT_EQ(session.status().code(), otlp::SpanStatus::CODE_ERROR);
  EXPECT_EQ(session.status().message(), "INVALID_ARGUMENT");
  EXPECT_EQ(session.parent_span_id(), "");
  EXPECT_THAT(session.trace_id(), SizeIs(16));
}

TEST(OtlpExporterTest, WhatTheCallerDoesNotRecordIsNotRecorded) {
  Collector collector;
  RunSession(collector.address(), TraceParent("00"), {"good"});
  EXPECT_THAT(collector.spans(), IsEmpty());
}

class QueueTest : public ::testing::Test {
 protected:
  std::unique_ptr<OtlpExporter> Start(const std::string& endpoint) {
    options_.endpoint = endpoint;
    auto exporter = OtlpExporter::Create(options_, metrics_, MakeLogger(LogFormat::kText, "off"));
    EXPECT_THAT(exporter, IsOk());
    return *std::move(exporter);
  }
  static Span MakeSpan() {
    Span span;
    span.trace_id = kTrace;
    span.span_id = kParent;
    return span;
  }
  int Count(const std::string& result) const {
    const std::string text = metrics_.Text(), line = absl::StrCat("holdfast_spans_total{result=\"", result, "\"} ");
    return std::stoi(text.substr(text.find(line) + line.size()));
  }

  PrometheusMetrics metrics_{MakeLogger(LogFormat::kText, "off")};
  OtlpExporter::Options options_;
};

TEST_F(QueueTest, WhatACollectorHasNoTimeForIsDroppedAndCounted) {
  absl::Notification asked, go_on;
  Collector collector([&] {
    if (!asked.HasBeenNotified()) asked.Notify();
    go_on.WaitForNotification();
  });
  options_.period = absl::InfiniteDuration();
  options_.max_batch = 2;
  options_.max_queue = 4;
  auto exporter = Start(collector.address());
  exporter->Take(MakeSpan());
  exporter->Take(MakeSpan());
  asked.WaitForNotification();  // these two are on their way
  for (int i = 0; i < 10; ++i) exporter->Take(MakeSpan());
  EXPECT_EQ(Count("dropped"), 6);
  go_on.Notify();
  exporter.reset();
  EXPECT_EQ(Count("sent"), 6);
  EXPECT_EQ(Count("dropped"), 6);
  EXPECT_THAT(collector.spans(), SizeIs(6));
}

TEST_F(QueueTest, WhatACollectorRefusesIsCounted) {
  Collector collector(nullptr, /*rejected=*/1);
  auto exporter = Start(collector.address());
  for (int i = 0; i < 3; ++i) exporter->Take(MakeSpan());
  exporter.reset();
  EXPECT_EQ(Count("sent") + Count("dropped"), 3);
  EXPECT_GE(Count("dropped"), 1);
}

TEST_F(QueueTest, ACollectorThatIsAwayCostsSpansAlone) {
  std::string nobody;
  {
    const Collector gone;
    nobody = gone.address();
  }
  auto exporter = Start(nobody);
  exporter->Take(MakeSpan());
  exporter.reset();
  EXPECT_EQ(Count("dropped"), 1);
}

TEST_F(QueueTest, ACollectorThatStallsHoldsNoShutdownUp) {
  absl::Notification asked, go_on;
  Collector collector([&] {
    if (!asked.HasBeenNotified()) asked.Notify();
    go_on.WaitForNotification();
  });
  options_.period = absl::InfiniteDuration();
  options_.timeout = absl::Seconds(15);
  options_.max_batch = 1;
  auto exporter = Start(collector.address());
  for (int i = 0; i < 8; ++i) exporter->Take(MakeSpan());
  asked.WaitForNotification();
  const SystemClock clock;
  const SteadyTime begin = clock.SteadyNow();
  exporter.reset();
  EXPECT_LT(clock.Since(begin), options_.timeout / 2) << "not even one batch has all of its time";
  EXPECT_EQ(Count("sent"), 0);
  go_on.Notify();
}

TEST_F(QueueTest, AnEndpointIsCheckedAtStart) {
  for (const char* endpoint : {"collector", "http://collector", "https://collector:4317/v1/traces", "http://"}) {
    options_.endpoint = endpoint;
    EXPECT_THAT(OtlpExporter::Create(options_, metrics_, MakeLogger(LogFormat::kText, "off")),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("otlp_endpoint")))
        << endpoint;
  }
}

}  // namespace
}  // namespace holdfast
