// SPDX-License-Identifier: Apache-2.0
#include "server/unread_service.h"

#include <grpcpp/impl/codegen/server_callback_handlers.h>

namespace holdfast {

void UnreadService::AddCall(const char* path, std::function<Reactor*(grpc::CallbackServerContext*)> start) {
  AddMethod(new grpc::internal::RpcServiceMethod(path, grpc::internal::RpcMethod::BIDI_STREAMING, nullptr));
  MarkMethodRawCallback(methods_++,
                        new grpc::internal::CallbackBidiHandler<grpc::ByteBuffer, grpc::ByteBuffer>(std::move(start)));
}

}  // namespace holdfast
