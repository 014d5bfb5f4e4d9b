// SPDX-License-Identifier: Apache-2.0
// Whatever strangers send, the server lives and forgets them.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <random>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/fake_engine.h"
#include "tests/support/status_matchers.h"
#include "tests/support/test_server.h"
#include "tests/support/track_call.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

class RobustnessTest : public ::testing::Test {
 protected:
  void ExpectAlive() {
    TrackCall call(server_.NewChannel(), JpegConfig());
    call.SendFrames(2);
    EXPECT_THAT(call.FinishAndReadToEnd(), IsOk());
  }

  FakeEngine engine_;
  TestServer server_{&engine_};
};

std::string RandomBytes(std::mt19937& random, size_t count) {
  std::string bytes(count, '\0');
  for (char& byte : bytes) byte = static_cast<char>(random());
  return bytes;
}

// Opens a connection, writes 'bytes' and closes it without reading.
void WriteToPort(int port, const std::string& bytes) {
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof(address)), 0);
  (void)!send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  close(fd);
}

TEST_F(RobustnessTest, GarbageOnThePortIsSurvived) {
  std::mt19937 random(1);
  for (int i = 0; i < 20; ++i) WriteToPort(server_.server().port(), RandomBytes(random, 1 + random() % 3000));
  for (int i = 0; i < 20; ++i) {
    WriteToPort(server_.server().port(), "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + RandomBytes(random, 1 + random() % 3000));
  }
  ExpectAlive();
}

// Sends one message of raw bytes to Track; how the call ended.
grpc::Status SendRaw(const std::shared_ptr<grpc::Channel>& channel, const std::string& bytes) {
  grpc::GenericStub stub(channel);
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  const grpc::Slice slice(bytes);
  const grpc::ByteBuffer message(&slice, 1);
  grpc::ByteBuffer answer;
  grpc::Status status;
  auto call = stub.PrepareCall(&context, "/holdfast.v1.PointTracking/Track", &queue);
  void* tag;
  bool ok = false;
  call->StartCall(nullptr);
  queue.Next(&tag, &ok);
  call->WriteLast(message, grpc::WriteOptions(), nullptr);
  queue.Next(&tag, &ok);
  do {  // a status comes after the last message only
    call->Read(&answer, nullptr);
    queue.Next(&tag, &ok);
  } while (ok);
  call->Finish(&status, nullptr);
  queue.Next(&tag, &ok);
  queue.Shutdown();
  while (queue.Next(&tag, &ok)) {
  }
  return status;
}

TEST_F(RobustnessTest, MessagesThatAreNoMessagesEndTheirOwnCall) {
  std::mt19937 random(2);
  const auto channel = server_.NewChannel();
  const std::string good = [] {
    v1::TrackRequest request;
    *request.mutable_config() = ToProto(JpegConfig());
    return request.SerializeAsString();
  }();
  EXPECT_FALSE(SendRaw(channel, "\xff\xff\xff\xff").ok());
  for (int i = 0; i < 200; ++i) {
    std::string bytes = i % 2 == 0 ? RandomBytes(random, random() % 200) : good;
    if (i % 2 == 1) bytes[random() % bytes.size()] = static_cast<char>(random());
    SendRaw(channel, bytes);
  }
  ExpectAlive();
}

TEST_F(RobustnessTest, AMillionBadPointsAreRefusedBeforeTheyAreParsed) {
  v1::TrackRequest config, add;
  for (int i = 0; i < 1'000'000; ++i) {
    config.mutable_config()->add_points()->set_x(-1);
    add.mutable_add_points()->add_points()->set_x(-1);
  }
  EXPECT_THAT(FromGrpcStatus(SendRaw(server_.NewChannel(), config.SerializeAsString())),
              StatusIs(kExhausted, HasSubstr("points of a session: at most 2048")));
  TrackCall call(server_.NewChannel(), JpegConfig());
  call.SendFrames(2);
  call.Send(add);
  EXPECT_THAT(call.ReadToEnd(), StatusIs(kExhausted, HasSubstr("points of a session: at most 2048")));
  EXPECT_EQ(call.tracks[7].size(), 2U) << "what came before is still tracked";
  ExpectAlive();
}

TEST_F(RobustnessTest, BytesThatAreNoMessageAreAnsweredAsSuch) {
  v1::TrackRequest config;
  *config.mutable_config() = ToProto(JpegConfig());
  EXPECT_THAT(FromGrpcStatus(SendRaw(server_.NewChannel(), config.SerializeAsString() + "\xff\xff")),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("request: is not a message")));
}

// Streams cancelled by their clients at points in time that differ from run to run.
void CancelAtRandom(const TestServer& server, unsigned seed, int rounds) {
  std::mt19937 random(seed);
  const auto channel = server.NewChannel();
  for (int i = 0; i < rounds; ++i) {
    TrackCall call(channel);
    std::thread canceller;
    const int steps = static_cast<int>(random() % 8);
    if (random() % 2 == 0) {
      canceller = std::thread([&call, spins = random() % 20000] {
        for (volatile unsigned spin = 0; spin < spins;) spin = spin + 1;
        call.Cancel();
      });
    }
    if (steps > 0) call.SendConfig(ToProto(JpegConfig()));
    for (int frame = 0; frame + 1 < steps; ++frame) call.SendFrame(frame);
    if (random() % 3 == 0) call.HalfClose();
    if (steps > 0 && random() % 3 == 0) call.ReadOne();
    if (canceller.joinable()) canceller.join();
    call.Cancel();
    (void)call.ReadToEnd();
  }
}

TEST_F(RobustnessTest, CancellingAtAnyMomentLeavesNothingBehind) {
  std::vector<std::thread> clients;
  for (unsigned seed = 0; seed < 4; ++seed) {
    clients.emplace_back([&, seed] { CancelAtRandom(server_, seed, 100); });
  }
  for (std::thread& client : clients) client.join();
  ExpectAlive();
  server_.server().Drain();  // returns once the last stream is gone
  EXPECT_EQ(engine_.live_sessions(), 0);
}

TEST_F(RobustnessTest, ClientsThatVanishInTheMiddleAreForgotten) {
  for (int i = 0; i < 20; ++i) {
    TrackCall call(server_.NewChannel(), JpegConfig());
    call.SendFrames(i);
    call.Cancel();
  }
  ExpectAlive();
  server_.server().Drain();
  EXPECT_EQ(engine_.live_sessions(), 0);
}

}  // namespace
}  // namespace holdfast
