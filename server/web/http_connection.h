// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/span_body.hpp>
#include <memory>
#include <optional>
#include <string>

#include "server/streams/served_streams.h"
#include "server/web/host_check.h"
#include "server/web/http_answer.h"
#include "server/web/web_socket.h"

namespace holdfast {

// What all connections of a web port share; outlives them.
struct WebSite {
  ServedStreams& streams;
  const HostRules rules;
  const WebSocket::Options socket_options;
  // Held by every connection, so that its count tells how many there are.
  const std::shared_ptr<void> place = std::make_shared<int>();
};

// A connection that asks for files, one after the other, until it asks for a socket. Lives as long as its handlers,
// which run on the thread of its executor.
class HttpConnection final : public std::enable_shared_from_this<HttpConnection> {
 public:
  // 'peer' is for the log.
  HttpConnection(boost::asio::ip::tcp::socket socket, const WebSite& site, std::string peer);
  // Takes requests from now on.
  void Begin() { Read(); }

 private:
  void Read();
  void Take();
  void OpenSocket();
  HttpAnswer Info();
  void Send(HttpAnswer answer);

  boost::beast::tcp_stream stream_;
  const WebSite& site_;
  const std::shared_ptr<void> place_;
  const std::string peer_;
  boost::beast::flat_buffer buffer_;
  std::optional<boost::beast::http::request_parser<boost::beast::http::empty_body>> parser_;
  HttpAnswer answer_;  // of the response that is being sent
  std::optional<boost::beast::http::response<boost::beast::http::span_body<const char>>> response_;
};

}  // namespace holdfast
