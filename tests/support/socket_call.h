// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/types.h"
#include "holdfast/v1/point_tracking.pb.h"
#include "proto/convert.h"

namespace holdfast {

using HttpFields = std::map<std::string, std::string>;

inline boost::asio::ip::tcp::endpoint LoopbackAt(int port) {
  return {boost::asio::ip::address_v4::loopback(), static_cast<uint16_t>(port)};
}

// One request on a connection of its own, and the answer to it.
inline boost::beast::http::response<boost::beast::http::string_body> Fetch(
    int port, const std::string& target, const HttpFields& fields = {},
    boost::beast::http::verb method = boost::beast::http::verb::get) {
  namespace http = boost::beast::http;
  boost::asio::io_context context;
  boost::asio::ip::tcp::socket socket(context);
  socket.connect(LoopbackAt(port));
  http::request<http::empty_body> request(method, target, 11);
  request.set(http::field::host, absl::StrCat("localhost:", port));
  for (const auto& [name, value] : fields) request.set(name, value);
  http::write(socket, request);
  boost::beast::flat_buffer buffer;
  http::response_parser<http::string_body> parser;
  parser.skip(method == http::verb::head);
  parser.body_limit(uint64_t{16} << 20);
  http::read(socket, buffer, parser);
  return parser.release();
}

// One Track stream over a WebSocket, by blocking calls, message by message. An error of the socket is kept: then there
// is nothing more to send or to read.
class SocketCall {
 public:
  explicit SocketCall(int port, const std::string& subprotocols = "holdfast.v1", const HttpFields& fields = {})
      : socket_(context_) {
    namespace websocket = boost::beast::websocket;
    socket_.next_layer().connect(LoopbackAt(port));
    socket_.set_option(websocket::stream_base::decorator([&](websocket::request_type& request) {
      if (!subprotocols.empty()) request.set(boost::beast::http::field::sec_websocket_protocol, subprotocols);
      for (const auto& [name, value] : fields) request.set(name, value);
    }));
    socket_.binary(true);
    socket_.handshake(answer_, absl::StrCat("localhost:", port), "/v1/track", error_);
  }
  // Sends the config and takes the answer to it.
  SocketCall(int port, const SessionConfig& config) : SocketCall(port) {
    v1::TrackRequest request;
    *request.mutable_config() = ToProto(config);
    Send(request);
    Read();
  }

  // What the server said to the request for the socket: 101 where there is one.
  int http_code() const { return answer_.result_int(); }
  std::string subprotocol() const { return std::string(answer_[boost::beast::http::field::sec_websocket_protocol]); }

  bool Send(const v1::TrackRequest& request) { return SendBytes(request.SerializeAsString()); }
  bool SendBytes(const std::string& bytes) {
    if (!error_) socket_.write(boost::asio::buffer(bytes), error_);
    return !error_;
  }
  bool SendText(const std::string& text) {
    socket_.text(true);
    return SendBytes(text);
  }
  // Bytes that are perhaps no WebSocket's.
  void SendRaw(const std::string& bytes) {
    boost::asio::write(socket_.next_layer(), boost::asio::buffer(bytes), error_);
    boost::beast::error_code ignored;
    socket_.next_layer().shutdown(boost::asio::ip::tcp::socket::shutdown_send, ignored);
  }
  bool SendFrame(int64_t index, std::string bytes = "good") {
    v1::TrackRequest request;
    *request.mutable_frame() = ToProto(Frame{index, std::move(bytes), {}, {}});
    return Send(request);
  }
  void SendFrames(int64_t count) {
    for (int64_t index = 0; index < count; ++index) SendFrame(index);
  }
  void Finish() {
    v1::TrackRequest request;
    request.mutable_finish();
    Send(request);
  }
  // As a page that is closed does; the connection just ends where 'cleanly' is false.
  void Leave(bool cleanly) {
    boost::beast::error_code ignored;
    if (cleanly) socket_.close(boost::beast::websocket::close_code::going_away, ignored);
    socket_.next_layer().close(ignored);
  }

  // The next message; none: the socket is closed.
  std::optional<v1::TrackResponse> Read() {
    if (error_) return std::nullopt;
    boost::beast::flat_buffer buffer;
    socket_.read(buffer, error_);
    v1::TrackResponse response;
    if (error_ || !response.ParseFromString(boost::beast::buffers_to_string(buffer.data()))) return std::nullopt;
    if (response.has_accepted()) accepted = response.accepted();
    for (const v1::PointRun& run : response.tracks().runs()) {
      for (int i = 0; i < static_cast<int>(run.final_count()); ++i) finals[run.id()][run.first_frame() + i] = run.x(i);
    }
    return response;
  }
  // The last message.
  v1::TrackResponse ReadToEnd() {
    v1::TrackResponse last;
    while (const std::optional<v1::TrackResponse> response = Read()) last = *response;
    return last;
  }
  // How the server closed it.
  int close_code() const { return socket_.reason().code; }

  v1::SessionAccepted accepted;
  std::map<PointId, std::map<int64_t, float>> finals;  // x of each point and frame

 private:
  boost::asio::io_context context_;
  boost::beast::websocket::stream<boost::asio::ip::tcp::socket, /*deflateSupported=*/false> socket_;
  boost::beast::websocket::response_type answer_;
  boost::beast::error_code error_;
};

}  // namespace holdfast
