// SPDX-License-Identifier: Apache-2.0
// What the server offers beside Track: health, reflection, information, and one port of its own.
#include "server/server.h"

#include <gmock/gmock.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/logging.h"
#include "tests/support/fake_engine.h"
#include "tests/support/status_matchers.h"
#include "tests/support/test_server.h"
#include "tests/support/track_call.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

// One unary-like exchange of raw bytes: 'request' out, the first answer back.
std::string Exchange(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                     const std::string& request) {
  grpc::GenericStub stub(channel);
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  const grpc::Slice slice(request);
  grpc::ByteBuffer answer;
  grpc::Status status;
  void* tag;
  bool ok = false;
  auto call = stub.PrepareCall(&context, method, &queue);
  call->StartCall(nullptr);
  queue.Next(&tag, &ok);
  call->WriteLast(grpc::ByteBuffer(&slice, 1), grpc::WriteOptions(), nullptr);
  queue.Next(&tag, &ok);
  call->Read(&answer, nullptr);
  queue.Next(&tag, &ok);
  call->Finish(&status, nullptr);
  queue.Next(&tag, &ok);
  grpc::Slice bytes;
  if (!status.ok() || !answer.TrySingleSlice(&bytes).ok()) return "error: " + status.error_message();
  return std::string(bytes.begin(), bytes.end());
}

enum HealthStatus : char { kServing = 1, kNotServing = 2 };

// grpc.health.v1 by its bytes: field 1 of the request is the service's name, field 1 of the answer the status.
char CheckHealth(const TestServer& server, const std::string& service) {
  const std::string request = service.empty() ? "" : std::string("\x0a") + static_cast<char>(service.size()) + service;
  const std::string answer = Exchange(server.NewChannel(), "/grpc.health.v1.Health/Check", request);
  return answer.size() == 2 ? answer[1] : '?';
}

TEST(ServerTest, HealthFollowsTheLifecycle) {
  FakeEngine engine;
  TestServer server(nullptr);
  for (const std::string service : {"", "holdfast.v1.PointTracking"}) {
    EXPECT_EQ(CheckHealth(server, service), kNotServing) << service;
  }
  server.server().Serve(engine);
  for (const std::string service : {"", "holdfast.v1.PointTracking"}) {
    EXPECT_EQ(CheckHealth(server, service), kServing) << service;
  }
  const auto channel = server.NewChannel();
  TrackCall running(channel, JpegConfig());
  std::thread drain([&] { server.server().Drain(); });
  while (CheckHealth(server, "") != kNotServing) std::this_thread::yield();
  EXPECT_EQ(CheckHealth(server, "holdfast.v1.PointTracking"), kNotServing);
  EXPECT_THAT(running.FinishAndReadToEnd(), IsOk());
  drain.join();
}

// A call whose client has said nothing yet.
class SilentCall {
 public:
  SilentCall(const TestServer& server, const std::string& method) : stub_(server.NewChannel()) {
    context_.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));  // where it hangs
    call_ = stub_.PrepareCall(&context_, method, &queue_);
    call_->StartCall(nullptr);
    Wait();
  }
  ~SilentCall() { Cancel(); }
  std::string Read() {
    grpc::ByteBuffer answer;
    call_->Read(&answer, nullptr);
    grpc::Slice bytes;
    return Wait() && answer.TrySingleSlice(&bytes).ok() ? std::string(bytes.begin(), bytes.end()) : "";
  }
  grpc::Status Finish() {
    grpc::Status status;
    call_->Finish(&status, nullptr);
    Wait();
    return status;
  }
  void Cancel() { context_.TryCancel(); }

 private:
  bool Wait() {
    void* tag;
    bool ok = false;
    return queue_.Next(&tag, &ok) && ok;
  }
  grpc::GenericStub stub_;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> call_;
};

TEST(ServerTest, UnaryCallsAreAnsweredWithoutTakingInWhatTheyAsk) {
  FakeEngine engine;
  TestServer server(&engine);
  SilentCall health(server, "/grpc.health.v1.Health/Check"), info(server, "/holdfast.v1.PointTracking/GetServerInfo");
  EXPECT_EQ(health.Read(), "\x08\x01");
  EXPECT_TRUE(health.Finish().ok());
  v1::GetServerInfoResponse told;
  EXPECT_TRUE(told.ParseFromString(info.Read()));
  EXPECT_EQ(told.model_name(), "fake");
  EXPECT_TRUE(info.Finish().ok());
}

TEST(ServerTest, WatchersHearOfEachChangeOfHealth) {
  FakeEngine engine;
  TestServer server(nullptr);
  SilentCall watcher(server, "/grpc.health.v1.Health/Watch");
  EXPECT_EQ(watcher.Read(), "\x08\x02");
  server.server().Serve(engine);
  EXPECT_EQ(watcher.Read(), "\x08\x01");
  std::thread drain([&] { server.server().Drain(); });
  EXPECT_EQ(watcher.Read(), "\x08\x02");
  drain.join();
}

TEST(ServerTest, SoManyWatchHealthAndThoseWhoGoMakeRoom) {
  TestServer server(nullptr);
  std::vector<std::unique_ptr<SilentCall>> watchers;
  for (int i = 0; i < HealthService::kMaxWatchers; ++i) {
    watchers.push_back(std::make_unique<SilentCall>(server, "/grpc.health.v1.Health/Watch"));
    EXPECT_EQ(watchers.back()->Read(), "\x08\x02");
  }
  EXPECT_EQ(SilentCall(server, "/grpc.health.v1.Health/Watch").Finish().error_code(),
            grpc::StatusCode::RESOURCE_EXHAUSTED);
  watchers.pop_back();
  while (SilentCall(server, "/grpc.health.v1.Health/Watch").Read() != "\x08\x02") std::this_thread::yield();
}

TEST(ServerTest, NothingIsAdmittedBeforeTheModelIsLoaded) {
  TestServer server(nullptr);
  EXPECT_THAT(TrackCall(server.NewChannel()).ReadToEnd(),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("loading")));
  EXPECT_THAT(server.metrics().Text(), HasSubstr("holdfast_admission_rejected_total{reason=\"loading\"} 1"));
  grpc::ClientContext context;
  v1::GetServerInfoResponse info;
  EXPECT_EQ(v1::PointTracking::NewStub(server.NewChannel())->GetServerInfo(&context, {}, &info).error_code(),
            grpc::StatusCode::UNAVAILABLE);
}

TEST(ServerTest, TellsWhatItRuns) {
  FakeEngine engine;
  TestServer server(&engine);
  grpc::ClientContext context;
  v1::GetServerInfoResponse info;
  ASSERT_TRUE(v1::PointTracking::NewStub(server.NewChannel())->GetServerInfo(&context, {}, &info).ok());
  EXPECT_EQ(info.model_name(), "fake");
  EXPECT_FALSE(info.build().empty());
  EXPECT_EQ(info.default_processing_size().width(), 512U);
  EXPECT_EQ(info.limits().max_points(), 2048U);
}

TEST(ServerTest, ReflectionListsTheServices) {
  FakeEngine engine;
  TestServer server(&engine);
  // Field 7 of the request, list_services: "*".
  const std::string answer =
      Exchange(server.NewChannel(), "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", "\x3a\x01*");
  EXPECT_THAT(answer, HasSubstr("holdfast.v1.PointTracking"));
  EXPECT_THAT(answer, HasSubstr("grpc.health.v1.Health"));
}

TEST(ServerTest, APortInUseIsAnError) {
  TestServer first(nullptr);
  ServerOptions options;
  options.listen = first.address();
  SimulatedClock clock;
  PrometheusMetrics metrics(MakeLogger(LogFormat::kText, "off"));
  EXPECT_THAT(Server::Start(options, clock, metrics, MakeLogger(LogFormat::kText, "off")),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("cannot listen on")));
}

TEST(ServerTest, ASessionMovesTheCounters) {
  PrometheusMetrics metrics(MakeLogger(LogFormat::kText, "off"));
  FakeEngine engine(FakeEngine::Options(), &metrics);
  TestServer server(&engine);
  TrackCall call(server.NewChannel(), JpegConfig());
  EXPECT_THAT(metrics.Text(), HasSubstr("holdfast_sessions_active 1"));
  call.SendFrames(3);
  EXPECT_THAT(call.FinishAndReadToEnd(), IsOk());
  server.server().Drain();
  EXPECT_THAT(metrics.Text(), HasSubstr("holdfast_sessions_active 0"));
  EXPECT_THAT(metrics.Text(), HasSubstr("holdfast_sessions_total{outcome=\"completed\"} 1"));
  EXPECT_THAT(metrics.Text(), HasSubstr("holdfast_frames_total{result=\"tracked\"} 3"));
}

}  // namespace
}  // namespace holdfast
