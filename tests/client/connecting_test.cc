// SPDX-License-Identifier: Apache-2.0
// How a server is reached, or another one in its place.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "client/remote_tracker.h"
#include "tests/client/connect_to.h"
#include "tests/client/fake_service.h"
#include "tests/support/tcp_proxy.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

grpc::Status NoSession(grpc::ServerContext&, FakeService::Stream&) { return grpc::Status::OK; }

TEST(ConnectingTest, AnAbsentServerIsNamedInTheError) {
  std::string address;
  {
    FakeService service(NoSession);
    address = service.address();
  }
  RemoteTracker::Options options;
  options.addresses = {address};
  options.connect_timeout = absl::Milliseconds(50);
  const auto tracker = RemoteTracker::Connect(options);
  EXPECT_EQ(tracker.status().code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(tracker.status().message()),
              HasSubstr("holdfast: server at " + address + " cannot be reached: "));
  EXPECT_FALSE(ConnectTo("nowhere").ok());
}

TEST(ConnectingTest, ADistantServerIsReachedAtTheFirstAttempt) {
  FakeService service(NoSession);
  TcpProxy distant(service.port(), absl::Milliseconds(300));
  const auto tracker = ConnectTo(distant.address());
  EXPECT_TRUE(tracker.ok()) << tracker.status();
  EXPECT_EQ(distant.connections(), 1);
}

TEST(ConnectingTest, AnAttemptThatGetsNoAnswerLeavesTimeForAnotherOne) {
  FakeService service(NoSession);
  TcpProxy path(service.port());
  path.LoseNext();
  RemoteTracker::Options options;
  options.addresses = {path.address()};
  options.connect_timeout = absl::Seconds(4);
  const auto tracker = RemoteTracker::Connect(options);
  EXPECT_TRUE(tracker.ok()) << tracker.status();
  EXPECT_EQ(path.connections(), 2);

  path.LoseNext();
  options.connect_timeout = absl::Milliseconds(50);
  EXPECT_THAT(std::string(RemoteTracker::Connect(options).status().message()), HasSubstr("no connection within 50ms"));
}

TEST(ConnectingTest, AnAbsentServerHoldsNobodyUpWhereAnotherOneAnswers) {
  FakeService service(NoSession);
  TcpProxy absent(service.port());
  absent.RefuseNew(true);
  RemoteTracker::Options options;
  options.addresses = {absent.address(), service.address()};
  options.connect_timeout = absl::InfiniteDuration();
  EXPECT_TRUE(RemoteTracker::Connect(options).ok());
}

TEST(ConnectingTest, AServerOfThisMachineIsReachedWithoutAProxy) {
  FakeService service(NoSession);
  setenv("http_proxy", "http://127.0.0.1:1", /*overwrite=*/1);
  for (const std::string& address : {service.address(), absl::StrCat("localhost:", service.port()),
                                     absl::StrCat("ipv4:", service.address(), ",127.0.0.2:1")}) {
    EXPECT_TRUE(ConnectTo(address).ok()) << address;
  }
  unsetenv("http_proxy");
}

TEST(ConnectingTest, OfSeveralServersTheFirstThatIsThereAnswers) {
  auto gone = std::make_unique<FakeService>(NoSession);
  FakeService service(NoSession);
  service.info.set_model_name("interim");
  service.info.set_window_frames(24);
  RemoteTracker::Options options;
  options.addresses = {gone->address(), service.address()};
  options.connect_timeout = absl::Milliseconds(50);
  auto tracker = RemoteTracker::Connect(options);
  ASSERT_TRUE(tracker.ok()) << tracker.status();
  gone.reset();  // the one that had answered
  const auto info = (*tracker)->Info();
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_EQ(info->model_name, "interim");
  EXPECT_TRUE(RemoteTracker::Connect(options).ok());
  service.Kill();
  EXPECT_THAT(std::string(RemoteTracker::Connect(options).status().message()),
              testing::AllOf(HasSubstr(options.addresses[0]), HasSubstr(options.addresses[1])));
}

}  // namespace
}  // namespace holdfast
