// SPDX-License-Identifier: Apache-2.0
// The port for browsers: what it serves, and streams over WebSockets, which are as good as gRPC's.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>
#include <vector>

#include "absl/strings/escaping.h"
#include "server/logging.h"
#include "tests/support/fake_engine.h"
#include "tests/support/socket_call.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/test_server.h"
#include "tests/support/track_call.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr char kToken[] = "a-token-of-more-than-16-bytes";

ServerOptions WithWeb() {
  ServerOptions options;
  options.web_listen = "127.0.0.1:0";
  return options;
}

absl::StatusCode CodeOf(const v1::TrackResponse& response) {
  return response.has_error() ? static_cast<absl::StatusCode>(response.error().code()) : absl::StatusCode::kOk;
}

// The code of the answer to a request for a socket.
unsigned AskForSocket(int port, HttpFields fields) {
  fields.insert({{"Connection", "Upgrade"},
                 {"Upgrade", "websocket"},
                 {"Sec-WebSocket-Version", "13"},
                 {"Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ=="}});
  return Fetch(port, "/v1/track", fields).result_int();
}

// Until the engine has let go of the last session.
void AwaitNoSession(const FakeEngine& engine) {
  while (engine.live_sessions() > 0) std::this_thread::yield();
}

class WebServerTest : public ::testing::Test {
 protected:
  int port() { return server_.server().web_port(); }

  FakeEngine engine_;
  TestServer server_{&engine_, WithWeb()};
};

TEST_F(WebServerTest, ServesFilesThatAreInTheProgram) {
  const auto clip = Fetch(port(), "/clip.mp4?once");
  EXPECT_EQ(clip.result_int(), 200U);
  EXPECT_EQ(clip["content-type"], "video/mp4");
  EXPECT_EQ(clip.body().substr(4, 4), "ftyp");
  const auto head = Fetch(port(), "/clip.mp4", {}, boost::beast::http::verb::head);
  EXPECT_EQ(head["content-length"], std::to_string(clip.body().size()));
  EXPECT_EQ(Fetch(port(), "/clip.mp4", {{"Range", "bytes=4-7"}}).body(), "ftyp");
  EXPECT_EQ(Fetch(port(), "/metrics").result_int(), 404U);
}

TEST_F(WebServerTest, ThePagesFilesAreCompressedForBrowsers) {
  const HttpFields browser = {{"Accept-Encoding", "gzip, deflate, br"}};
  for (const std::string path : {"/", "/app.js", "/app.css"}) {
    const auto plain = Fetch(port(), path);
    const auto compressed = Fetch(port(), path, browser);
    EXPECT_EQ(compressed["content-encoding"], "gzip") << path;
    EXPECT_EQ(compressed["content-type"], plain["content-type"]);
    EXPECT_EQ(compressed.body().substr(0, 2), "\x1f\x8b");
    EXPECT_LT(compressed.body().size(), plain.body().size()) << path;
  }
  EXPECT_EQ(Fetch(port(), "/clip.mp4", browser).count("content-encoding"), 0U);
}

TEST_F(WebServerTest, TellsWhatItRuns) {
  const auto answer = Fetch(port(), "/v1/info");
  EXPECT_EQ(answer.result_int(), 200U);
  const auto info = nlohmann::json::parse(answer.body());
  EXPECT_EQ(info["modelName"], "fake");
  EXPECT_EQ(info["limits"]["maxPoints"], 2048);
  EXPECT_FALSE(info["build"].get<std::string>().empty());
}

TEST_F(WebServerTest, ASessionIsAcceptedTrackedAndSummedUp) {
  SocketCall call(port(), JpegConfig());
  EXPECT_EQ(call.http_code(), 101);
  EXPECT_EQ(call.subprotocol(), "holdfast.v1");
  EXPECT_EQ(call.accepted.window_frames(), 24U);
  call.SendFrames(30);
  call.Finish();
  const v1::TrackResponse last = call.ReadToEnd();
  ASSERT_TRUE(last.has_summary()) << last.ShortDebugString();
  EXPECT_EQ(last.summary().frames(), 30);
  EXPECT_THAT(call.finals[7], SizeIs(30));
  EXPECT_EQ(call.finals[7][29], 39);  // one pixel a frame from 10
  EXPECT_EQ(call.close_code(), 1000);
}

TEST_F(WebServerTest, SessionsOfBothCarriersAreServedAlike) {
  TrackCall grpc(server_.NewChannel(), JpegConfig());
  SocketCall socket(port(), JpegConfig());
  grpc.SendFrames(5);
  socket.SendFrames(5);
  socket.Finish();
  EXPECT_TRUE(socket.ReadToEnd().has_summary());
  ASSERT_THAT(grpc.FinishAndReadToEnd(), IsOk());
  for (const auto& [frame, sample] : grpc.tracks[7]) EXPECT_EQ(socket.finals[7][frame], sample.x);
}

// gRPC's clients may say so too.
TEST_F(WebServerTest, FinishIsWhatHalfClosingIs) {
  TrackCall call(server_.NewChannel(), JpegConfig());
  call.SendFrames(3);
  v1::TrackRequest request;
  request.mutable_finish();
  call.Send(request);
  EXPECT_THAT(call.ReadToEnd(), IsOk());
  EXPECT_THAT(call.summaries, SizeIs(1));
}

TEST_F(WebServerTest, AMistakeIsToldAndWhatCameBeforeIsKept) {
  SocketCall call(port(), JpegConfig());
  call.SendFrames(3);
  call.SendFrame(7);
  const v1::TrackResponse last = call.ReadToEnd();
  EXPECT_EQ(CodeOf(last), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(last.error().message(), HasSubstr("frame.index: is 7, expected 3"));
  EXPECT_GT(last.error().details_size(), 0);
  EXPECT_THAT(call.finals[7], SizeIs(3));
  EXPECT_EQ(call.close_code(), 1008);
}

TEST_F(WebServerTest, WhatIsNoMessageEndsTheStream) {
  SocketCall text(port(), JpegConfig());
  text.SendText("{}");
  EXPECT_THAT(text.ReadToEnd().error().message(), HasSubstr("text message"));
  SocketCall garbage(port());
  garbage.SendBytes("\xff\xff\xff");
  EXPECT_THAT(garbage.ReadToEnd().error().message(), HasSubstr("not a message of this protocol"));
  SocketCall early(port());
  early.Finish();
  EXPECT_THAT(early.ReadToEnd().error().message(), HasSubstr("config: is missing"));
}

TEST_F(WebServerTest, AMessageThatIsTooLargeIsAMistakeLikeOthers) {
  SocketCall call(port(), JpegConfig());
  call.SendFrames(3);
  call.SendBytes(std::string((16 << 20) + (2 << 20), 'x'));
  const v1::TrackResponse last = call.ReadToEnd();
  EXPECT_EQ(CodeOf(last), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(last.error().message(), HasSubstr("request: has more than 17825792 bytes"));
  EXPECT_THAT(call.finals[7], SizeIs(3));
  EXPECT_EQ(call.close_code(), 1008);
  AwaitNoSession(engine_);
}

TEST_F(WebServerTest, AClientThatIsTooLateHasMadeAMistake) {
  SocketCall call(port());
  std::atomic<bool> over = false;
  std::thread time([&] {  // from when on the server counts it is not known
    while (!over) server_.clock().Advance(absl::Seconds(1));
  });
  EXPECT_EQ(CodeOf(call.ReadToEnd()), absl::StatusCode::kDeadlineExceeded);
  EXPECT_EQ(call.close_code(), 1008);
  over = true;
  time.join();
}

TEST_F(WebServerTest, ASessionIsOfTheTraceThatItsRequestNames) {
  SocketCall call(port(), "holdfast.v1", {{"traceparent", "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"}});
  v1::TrackRequest request;
  *request.mutable_config() = ToProto(JpegConfig());
  call.Send(request);
  call.Finish();
  call.ReadToEnd();
  EXPECT_EQ(call.accepted.trace_id(), "0af7651916cd43dd8448eb211c80319c");
}

// Frames with reserved bits, no mask, lengths beyond all bounds, fragments of nothing.
TEST_F(WebServerTest, GarbageOnASocketEndsThatSocketAlone) {
  SocketCall bystander(port(), JpegConfig());
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    SocketCall call(port(), JpegConfig());
    std::string bytes(std::uniform_int_distribution<size_t>(1, 200)(random), '\0');
    for (char& byte : bytes) byte = static_cast<char>(random());
    if (i % 2 == 0) bytes[0] = '\x82', bytes[1 % bytes.size()] = '\xff';  // a binary frame of 64 bits of length
    call.SendRaw(bytes);
    call.ReadToEnd();
  }
  bystander.SendFrames(3);
  bystander.Finish();
  EXPECT_EQ(bystander.ReadToEnd().summary().frames(), 3);
  AwaitNoSession(engine_);
}

TEST_F(WebServerTest, AClientThatLeavesTakesItsSessionAlong) {
  for (const bool cleanly : {true, false}) {
    SocketCall call(port(), JpegConfig());
    call.SendFrames(3);
    call.Leave(cleanly);
    AwaitNoSession(engine_);
  }
}

// Though nothing more is wanted of it.
TEST_F(WebServerTest, AClientThatHasSaidAllAndLeavesTakesItsSessionAlong) {
  engine_.Hold();
  for (const bool talkative : {false, true}) {
    SocketCall call(port(), JpegConfig());
    call.SendFrames(3);
    call.Finish();
    if (talkative) call.SendFrame(3);
    call.Leave(/*cleanly=*/false);
    AwaitNoSession(engine_);
  }
}

// At points in time that differ from run to run.
void ComeAndGo(int port, unsigned seed) {
  std::mt19937 random(seed);
  v1::TrackRequest config;
  *config.mutable_config() = ToProto(JpegConfig());
  for (int i = 0; i < 50; ++i) {
    SocketCall call(port);
    const auto steps = static_cast<int>(random() % 8);
    if (steps > 0) call.Send(config);
    if (steps > 1) call.SendFrames(steps - 1);
    if (random() % 3 == 0) call.Finish();
    if (steps > 0 && random() % 3 == 0) (void)call.Read();
    call.Leave(/*cleanly=*/random() % 4 == 0);
  }
}

TEST_F(WebServerTest, LeavingAtAnyMomentLeavesNothingBehind) {
  std::vector<std::thread> clients;
  for (unsigned seed = 0; seed < 4; ++seed) clients.emplace_back(ComeAndGo, port(), seed);
  for (std::thread& client : clients) client.join();
  server_.server().Drain();  // returns once the last stream is gone
  EXPECT_EQ(engine_.live_sessions(), 0);
}

TEST_F(WebServerTest, WhoOffersAnotherProtocolGetsNoSocket) {
  EXPECT_EQ(AskForSocket(port(), {}), 426U);
  EXPECT_EQ(AskForSocket(port(), {{"Sec-WebSocket-Protocol", "holdfast.v2"}}), 426U);
  EXPECT_EQ(AskForSocket(port(), {{"Sec-WebSocket-Protocol", "holdfast.v2, holdfast.v1"}}), 101U);
  EXPECT_EQ(Fetch(port(), "/v1/track").result_int(), 426U);
}

TEST_F(WebServerTest, AnotherSitesPageIsTurnedAway) {
  const HttpFields protocol = {{"Sec-WebSocket-Protocol", "holdfast.v1"}};
  HttpFields foreign = protocol, own = protocol;
  foreign["Origin"] = "http://evil.example";
  own["Origin"] = absl::StrCat("http://localhost:", port());
  EXPECT_EQ(AskForSocket(port(), foreign), 403U);
  EXPECT_EQ(AskForSocket(port(), own), 101U);
  EXPECT_EQ(Fetch(port(), "/v1/info", {{"Host", "evil.example"}}).result_int(), 403U);
}

// A client that does not read is not read from, whatever carries its stream.
TEST_F(WebServerTest, AFullSessionHoldsItsClientBack) {
  engine_.Hold();
  SocketCall call(port(), JpegConfig());
  std::thread sender([&call] { call.SendFrames(40); });
  SocketCall other(port(), JpegConfig());  // the port's thread does not wait with it
  EXPECT_EQ(other.http_code(), 101);
  EXPECT_LE(engine_.frames_taken(), 5);
  engine_.Release();
  sender.join();
  call.Finish();
  EXPECT_EQ(call.ReadToEnd().summary().frames(), 40);
  other.Finish();
  EXPECT_TRUE(other.ReadToEnd().has_summary());
}

TEST_F(WebServerTest, ADrainLetsItFinishAndRefusesOthers) {
  SocketCall running(port(), JpegConfig());
  std::thread drain([&] { server_.server().Drain(); });
  while (server_.server().state() != LifecycleState::kDraining) std::this_thread::yield();
  v1::TrackResponse refused;
  while (!refused.has_error()) refused = SocketCall(port()).ReadToEnd();
  EXPECT_EQ(CodeOf(refused), absl::StatusCode::kUnavailable);
  running.SendFrames(3);
  running.Finish();
  EXPECT_EQ(running.ReadToEnd().summary().frames(), 3);
  drain.join();
}

TEST(WebServerStartTest, ASocketIsRefusedByAMessageWhileTheModelLoads) {
  TestServer server(nullptr, WithWeb());
  SocketCall call(server.server().web_port());
  EXPECT_EQ(CodeOf(call.ReadToEnd()), absl::StatusCode::kUnavailable);
  EXPECT_EQ(call.close_code(), 1013);
  EXPECT_EQ(Fetch(server.server().web_port(), "/v1/info").result_int(), 503U);
}

TEST(WebServerStartTest, APortInUseIsAnError) {
  TestServer first(nullptr, WithWeb());
  ServerOptions options = WithWeb();
  options.listen = "127.0.0.1:0";
  for (const auto& [address, said] : std::vector<std::pair<std::string, std::string>>{
           {absl::StrCat("127.0.0.1:", first.server().web_port()), "cannot listen on"},
           {"nowhere", "expected host:port"},
           {"127.0.0.1:http", "expected host:port"}}) {
    options.web_listen = address;
    SimulatedClock clock;
    PrometheusMetrics metrics(MakeLogger(LogFormat::kText, "off"));
    const auto server = Server::Start(options, clock, metrics, MakeLogger(LogFormat::kText, "off"));
    EXPECT_THAT(server.status().message(), HasSubstr(said));
  }
}

// A server that lets one caller in.
class WebServerTokenTest : public ::testing::Test {
 protected:
  // 'limits': as they stand behind the token.
  int Serve(const std::string& limits) {
    std::ofstream(dir_.File("tokens")) << "someone:" << kToken << limits << "\n";
    ServerOptions options = WithWeb();
    options.token_file = dir_.File("tokens");
    server_ = std::make_unique<TestServer>(&engine_, options);
    return server_->server().web_port();
  }

  const TempDir dir_;
  FakeEngine engine_;
  std::unique_ptr<TestServer> server_;
};

TEST_F(WebServerTokenTest, ATokenComesAsASubprotocolOrAsAHeader) {
  const int port = Serve("");
  const std::string bearer = absl::StrCat("Bearer ", kToken);
  EXPECT_EQ(Fetch(port, "/v1/info").result_int(), 401U);
  EXPECT_EQ(Fetch(port, "/v1/info", {{"Authorization", bearer}}).result_int(), 200U);
  SocketCall without(port);
  EXPECT_EQ(CodeOf(without.ReadToEnd()), absl::StatusCode::kUnauthenticated);
  EXPECT_EQ(without.close_code(), 1008);
  SocketCall page(port, absl::StrCat("holdfast.v1, bearer.", absl::WebSafeBase64Escape(kToken)));
  SocketCall program(port, "holdfast.v1", {{"Authorization", bearer}});
  for (SocketCall* call : {&page, &program}) {
    v1::TrackRequest request;
    *request.mutable_config() = ToProto(JpegConfig());
    call->Send(request);
    call->Finish();
    EXPECT_TRUE(call->ReadToEnd().has_summary());
  }
}

TEST_F(WebServerTokenTest, WhoHearsOfTheEndMayComeBackAtOnce) {
  const int port = Serve(" max_sessions=1");
  const HttpFields bearer = {{"Authorization", absl::StrCat("Bearer ", kToken)}};
  for (int i = 0; i < 50; ++i) {
    SocketCall call(port, "holdfast.v1", bearer);
    v1::TrackRequest request;
    *request.mutable_config() = ToProto(JpegConfig());
    call.Send(request);
    call.Finish();
    std::optional<v1::TrackResponse> response;
    while ((response = call.Read()) && !response->has_summary()) ASSERT_FALSE(response->has_error()) << i;
  }
}

// Answers to pings wait behind messages that the server does not read yet.
TEST(WebServerIdleTest, AClientThatIsHeldBackIsNotTakenForDead) {
  FakeEngine engine;
  ServerOptions options = WithWeb();
  options.keepalive_time = absl::Milliseconds(500);
  TestServer server(&engine, options);
  engine.Hold();
  SocketCall held(server.server().web_port(), JpegConfig());
  held.SendFrames(8);
  held.Finish();
  engine.AwaitFramesTaken(4);
  const SocketCall silent(server.server().web_port(), JpegConfig());  // answers no ping
  while (engine.live_sessions() > 1) std::this_thread::yield();
  engine.Release();
  EXPECT_EQ(held.ReadToEnd().summary().frames(), 8);
}

// Results that nobody takes: the connection's buffers fill up, the stream is cut off, and others do not wait for it.
TEST(WebServerSlowTest, AClientThatDoesNotReadIsCutOff) {
  FakeEngine::Options results;
  results.padding_samples = 20'000;  // 260 kB a frame
  FakeEngine engine(results);
  TestServer server(&engine, WithWeb());
  const int port = server.server().web_port();
  SocketCall stuck(port, JpegConfig());
  stuck.SendFrames(240);
  engine.AwaitFramesTaken(6);
  while (engine.live_sessions() > 0) {
    server.clock().Advance(absl::Minutes(1));
    SocketCall other(port);
    other.Finish();
    EXPECT_EQ(CodeOf(other.ReadToEnd()), absl::StatusCode::kInvalidArgument);
  }
  EXPECT_LT(engine.frames_taken(), 100);  // 26 MB
  EXPECT_FALSE(stuck.ReadToEnd().has_summary());
}

}  // namespace
}  // namespace holdfast
