// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <grpcpp/grpcpp.h>
#include <grpcpp/impl/service_type.h>

#include <functional>
#include <utility>

namespace holdfast {

// A gRPC service that is asked before a message of the call is taken in, be the call unary. gRPC would read a unary
// call's message first, from anybody and of any size: it compares that with its limit once all has come.
class UnreadService : public grpc::Service {
 public:
  using Reactor = grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>;

 protected:
  // What 'start' makes is the server's side of a call to 'path', "/package.Service/Method", which must outlive the
  // service.
  void AddCall(const char* path, std::function<Reactor*(grpc::CallbackServerContext*)> start);

 private:
  int methods_ = 0;
};

// Answers a unary call, whatever it asks.
class AnsweredCall final : public UnreadService::Reactor {
 public:
  explicit AnsweredCall(grpc::ByteBuffer answer) : answer_(std::move(answer)) {
    StartWriteAndFinish(&answer_, grpc::WriteOptions(), grpc::Status::OK);
  }
  void OnDone() override { delete this; }  // owned by the call

 private:
  const grpc::ByteBuffer answer_;
};

// Ends a call that was not admitted.
class RefusedCall final : public UnreadService::Reactor {
 public:
  explicit RefusedCall(const grpc::Status& status) { Finish(status); }
  void OnDone() override { delete this; }  // owned by the call
};

}  // namespace holdfast
