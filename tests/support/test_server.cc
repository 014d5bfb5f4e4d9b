// SPDX-License-Identifier: Apache-2.0
#include "tests/support/test_server.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/logging.h"

namespace holdfast {

TestServer::TestServer(Engine* engine) : TestServer(engine, ServerOptions()) {}

TestServer::TestServer(Engine* engine, ServerOptions options) : metrics_(MakeLogger(LogFormat::kText, "error")) {
  options.listen = "127.0.0.1:0";
  auto started = Server::Start(options, clock_, metrics_, MakeLogger(LogFormat::kText, "error"));
  if (!started.ok()) {
    ADD_FAILURE() << started.status();
    std::abort();
  }
  server_ = *std::move(started);
  if (engine != nullptr) server_->Serve(*engine);
}

std::string TestServer::address() const { return absl::StrCat("127.0.0.1:", server_->port()); }

std::shared_ptr<grpc::Channel> TestServer::NewChannel() const {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return grpc::CreateCustomChannel(address(), grpc::InsecureChannelCredentials(), arguments);
}

}  // namespace holdfast
