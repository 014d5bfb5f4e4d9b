// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/streams/served_streams.h"

namespace holdfast {

// A WebSocket that carries one Track stream: a binary message is a TrackRequest or a TrackResponse. A stream that ends
// with an error, or that is not admitted, has TrackResponse.error as its last message; then the socket is closed. All
// that happens to it happens on the thread of its executor; only the calls of StreamCarrier come from elsewhere. It
// lives as long as one of its handlers or its stream. Whether the client is still there is asked while a message is
// awaited; once it has said all, that goes on to the end, and what comes is left aside.
class WebSocket final : public StreamCarrier, public std::enable_shared_from_this<WebSocket> {
 public:
  using UpgradeRequest = boost::beast::http::request<boost::beast::http::empty_body>;
  struct Options {
    int64_t max_message_bytes = 0;  // of a client; a larger one is a mistake that ends the stream
    absl::Duration keepalive_time;  // see WebOptions
  };
  // 'place' is held as long as the connection is.
  WebSocket(boost::beast::tcp_stream connection, const Options& options, ServedStreams& streams,
            std::shared_ptr<void> place);

  // Answers the request that asks for the socket, and opens the stream, of the trace that its traceparent names.
  void Accept(const UpgradeRequest& request, std::string authorization, std::string peer);

  void StartRead() override;
  void StartWrite(const v1::TrackResponse& response) override;
  void Finish(const absl::Status& status) override;
  void Cancel() override;

 private:
  class Live;

  void Open(const std::string& authorization, const std::string& peer, const std::string& traceparent);
  void Read();
  void ReadMore();
  void TakeMessage();
  void TakeRequest(absl::StatusOr<v1::TrackRequest> request);
  void ClearIncoming();
  void Write(std::string bytes);
  void End(const absl::Status& status);
  void Close(const absl::Status& status);
  void Gone();
  void Retire();
  template <typename Do>
  void OnItsThread(Do what);  // later, never from within this call

  boost::beast::websocket::stream<boost::beast::tcp_stream, /*deflateSupported=*/false> socket_;
  boost::asio::steady_timer end_timer_;
  ServedStreams& streams_;
  const std::shared_ptr<void> place_;
  const absl::Duration keepalive_time_;
  const size_t max_message_bytes_;
  boost::beast::flat_buffer incoming_;
  std::string outgoing_;  // while a write is in flight
  int max_points_ = 0;
  Live* live_ = nullptr;   // null: there is no stream yet, or it is retired
  bool said_all_ = false;  // the client has
  bool gone_ = false;      // nothing can be sent any more
  bool finished_ = false;  // the stream has ended
};

}  // namespace holdfast
