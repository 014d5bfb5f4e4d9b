// SPDX-License-Identifier: Apache-2.0
#include "server/web/http_connection.h"

#include <google/protobuf/util/json_util.h>

#include <boost/beast/http/read.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <chrono>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "server/web/page_files.h"
#include "server/web/subprotocols.h"

namespace holdfast {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
using beast::error_code;

constexpr std::chrono::seconds kRequestTime(10);  // to come
constexpr size_t kHeaderBytes = 16 << 10;
constexpr char kTrackPath[] = "/v1/track";
constexpr char kInfoPath[] = "/v1/info";

absl::string_view View(beast::string_view text) { return {text.data(), text.size()}; }

int HttpCodeOf(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kUnauthenticated:
      return 401;
    case absl::StatusCode::kPermissionDenied:
      return 403;
    default:
      return 503;
  }
}

HttpAnswer AnswerWith(const absl::Status& status) {
  return TextAnswer(HttpCodeOf(status), absl::StrCat(status.message(), "\n"));
}

}  // namespace

HttpConnection::HttpConnection(boost::asio::ip::tcp::socket socket, const WebSite& site, std::string peer)
    : stream_(std::move(socket)), site_(site), place_(site.place), peer_(std::move(peer)) {}

void HttpConnection::Read() {
  parser_.emplace();
  parser_->header_limit(kHeaderBytes);
  parser_->body_limit(0);
  stream_.expires_after(kRequestTime);
  http::async_read(stream_, buffer_, *parser_, [self = shared_from_this()](error_code error, size_t) {
    if (!error) self->Take();
  });
}

void HttpConnection::Take() {
  const auto& request = parser_->get();
  const absl::string_view target = View(request.target());
  const absl::string_view path = target.substr(0, target.find('?'));
  const absl::Status host =
      CheckHost(site_.rules, View(request[http::field::host]), View(request[http::field::origin]));
  if (!host.ok()) return Send(AnswerWith(host));
  if (path == kTrackPath) return OpenSocket();
  if (path == kInfoPath) return Send(Info());
  Send(AnswerWithFile({View(request.method_string()), path, View(request[http::field::range]),
                       View(request[http::field::if_none_match]), View(request[http::field::accept_encoding])},
                      PageFiles()));
}

void HttpConnection::OpenSocket() {
  const auto& request = parser_->get();
  bool offers_protocol = false;
  std::string authorization = AuthorizationOf(View(request[http::field::sec_websocket_protocol]), offers_protocol);
  if (!beast::websocket::is_upgrade(request) || !offers_protocol) {
    return Send(TextAnswer(426, "expected a WebSocket of the subprotocol holdfast.v1\n"));
  }
  if (authorization.empty()) authorization = std::string(request[http::field::authorization]);
  const auto socket = std::make_shared<WebSocket>(std::move(stream_), site_.socket_options, site_.streams, place_);
  socket->Accept(parser_->release(), std::move(authorization), peer_);
}

HttpAnswer HttpConnection::Info() {
  const absl::string_view authorization = View(parser_->get()[http::field::authorization]);
  const auto info = site_.streams.Info({authorization, peer_});
  if (!info.ok()) return AnswerWith(info.status());
  std::string json;
  (void)google::protobuf::util::MessageToJsonString(*info, &json);  // fails for unknown messages within Any only
  return TextAnswer(200, std::move(json), "application/json");
}

void HttpConnection::Send(HttpAnswer answer) {
  const auto& request = parser_->get();
  answer_ = std::move(answer);
  const absl::string_view body = request.method() == http::verb::head ? "" : answer_.body();
  response_.emplace(static_cast<http::status>(answer_.code), request.version());
  for (const auto& [name, value] : answer_.headers) response_->set(name, value);
  response_->body() = beast::span<const char>(body.data(), body.size());
  response_->content_length(answer_.body().size());
  response_->keep_alive(request.keep_alive());
  stream_.expires_after(TimeToTake(body.size()));
  http::async_write(stream_, *response_, [self = shared_from_this()](error_code error, size_t) {
    if (error) return;
    if (self->response_->keep_alive()) return self->Read();
    error_code ignored;
    self->stream_.socket().shutdown(boost::asio::ip::tcp::socket::shutdown_send, ignored);
  });
}

}  // namespace holdfast
