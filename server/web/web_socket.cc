// SPDX-License-Identifier: Apache-2.0
#include "server/web/web_socket.h"

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <chrono>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/errors.h"
#include "proto/grpc_status.h"
#include "server/streams/message_codec.h"
#include "server/tracing/trace_context.h"
#include "server/web/subprotocols.h"

namespace holdfast {
namespace {

namespace beast = boost::beast;
namespace websocket = beast::websocket;
using beast::error_code;

constexpr std::chrono::seconds kHandshakeTime(10);    // to open and to close
constexpr std::chrono::seconds kEndTime(20);          // ...and to take what is said last
constexpr size_t kKeptBufferBytes = size_t{1} << 20;  // beyond it a message's memory is given back

// 'keepalive_time' of a day or more: silence is no sign.
websocket::stream_base::timeout Timeouts(absl::Duration keepalive_time) {
  websocket::stream_base::timeout timeouts{kHandshakeTime, websocket::stream_base::none(), false};
  if (keepalive_time < absl::Hours(24)) {
    timeouts.idle_timeout = std::chrono::milliseconds(absl::ToInt64Milliseconds(keepalive_time));
    timeouts.keep_alive_pings = true;
  }
  return timeouts;
}

// 1013 is said only to whom it helps to come again, 1011 only where the server is to blame.
websocket::close_code CloseCodeOf(const absl::Status& status) {
  if (status.ok()) return websocket::close_code::normal;
  const std::optional<Overload> overload = OverloadDetails(status);
  if (absl::IsUnavailable(status) || (overload && overload->retry_after > absl::ZeroDuration())) {
    return websocket::close_code::try_again_later;
  }
  return IsServersFault(status) ? websocket::close_code::internal_error : websocket::close_code::policy_error;
}

}  // namespace

// The stream together with the socket that carries it; owned by ServedStreams.
class WebSocket::Live final : public LiveStream {
 public:
  Live(ServedStream::Deps deps, Gatekeeper::Pass pass, TraceContext trace, std::shared_ptr<WebSocket> socket)
      : socket_(std::move(socket)), stream_(std::move(deps), std::move(pass), std::move(trace), *socket_) {}
  ServedStream& stream() override { return stream_; }

 private:
  const std::shared_ptr<WebSocket> socket_;
  ServedStream stream_;
};

WebSocket::WebSocket(beast::tcp_stream connection, const Options& options, ServedStreams& streams,
                     std::shared_ptr<void> place)
    : socket_(std::move(connection)),
      end_timer_(socket_.get_executor()),
      streams_(streams),
      place_(std::move(place)),
      keepalive_time_(options.keepalive_time),
      max_message_bytes_(static_cast<size_t>(options.max_message_bytes)) {
  beast::get_lowest_layer(socket_).expires_never();  // the socket has timeouts of its own
  socket_.set_option(Timeouts(absl::InfiniteDuration()));
  socket_.read_message_max(0);  // ReadMore measures, and can still answer
  socket_.binary(true);
}

template <typename Do>
void WebSocket::OnItsThread(Do what) {
  boost::asio::post(socket_.get_executor(),
                    [self = shared_from_this(), what = std::move(what)]() mutable { what(*self); });
}

void WebSocket::Accept(const UpgradeRequest& request, std::string authorization, std::string peer) {
  socket_.set_option(websocket::stream_base::decorator([](websocket::response_type& response) {
    response.set(beast::http::field::sec_websocket_protocol, kTrackSubprotocol);
  }));
  socket_.async_accept(request,
                       [self = shared_from_this(), authorization = std::move(authorization), peer = std::move(peer),
                        traceparent = std::string(request["traceparent"])](error_code error) {
                         if (!error) self->Open(authorization, peer, traceparent);
                       });
}

void WebSocket::Open(const std::string& authorization, const std::string& peer, const std::string& traceparent) {
  const auto make = [&](ServedStream::Deps deps, Gatekeeper::Pass pass, int max_points) {
    auto live = std::make_unique<Live>(std::move(deps), std::move(pass), TraceOf(traceparent), shared_from_this());
    live_ = live.get();
    max_points_ = max_points;
    live_->stream().Begin();
    return std::unique_ptr<LiveStream>(std::move(live));
  };
  const auto opened = streams_.Open({authorization, peer}, "websocket", make);
  if (!opened.ok()) End(opened.status());
}

void WebSocket::StartRead() {
  OnItsThread([](WebSocket& it) { it.Read(); });
}

void WebSocket::StartWrite(const v1::TrackResponse& response) {
  OnItsThread([bytes = response.SerializeAsString()](WebSocket& it) mutable { it.Write(std::move(bytes)); });
}

void WebSocket::Finish(const absl::Status& status) {
  OnItsThread([status](WebSocket& it) { it.End(status); });
}

void WebSocket::Cancel() {
  OnItsThread([](WebSocket& it) { it.Gone(); });
}

void WebSocket::Read() {
  if (gone_ || finished_) return;
  // Only who is read from can show that it is there: a client that is held back is not asked.
  socket_.set_option(Timeouts(keepalive_time_));
  ReadMore();
}

// A message comes in pieces, and no more of it is kept than may be sent.
void WebSocket::ReadMore() {
  const size_t room = max_message_bytes_ + 1 - incoming_.size();
  socket_.async_read_some(incoming_, room, [self = shared_from_this()](error_code error, size_t) {
    if (self->live_ == nullptr) return;
    if (error) return self->Gone();
    const bool fits = self->incoming_.size() <= self->max_message_bytes_;
    if (fits && !self->socket_.is_message_done()) return self->ReadMore();
    self->socket_.set_option(Timeouts(absl::InfiniteDuration()));
    self->TakeMessage();
    if (fits && self->said_all_) self->Read();
  });
}

void WebSocket::TakeMessage() {
  const auto bytes = incoming_.cdata();
  if (said_all_) return ClearIncoming();
  if (bytes.size() > max_message_bytes_) {
    TakeRequest(InvalidFieldError("request", absl::StrCat("has more than ", max_message_bytes_, " bytes")));
  } else if (!socket_.got_binary()) {
    TakeRequest(InvalidFieldError("request", "is a text message, expected a binary one"));
  } else {
    TakeRequest(ParseRequest({static_cast<const char*>(bytes.data()), bytes.size()}, max_points_));
  }
}

void WebSocket::TakeRequest(absl::StatusOr<v1::TrackRequest> request) {
  ClearIncoming();
  said_all_ = request.ok() && request->has_finish();
  live_->stream().OnRequest(std::move(request));
}

void WebSocket::ClearIncoming() {
  incoming_.clear();
  if (incoming_.capacity() > kKeptBufferBytes) incoming_.shrink_to_fit();
}

void WebSocket::Write(std::string bytes) {
  if (live_ == nullptr) return;
  if (gone_) return live_->stream().OnWritten(false);
  outgoing_ = std::move(bytes);
  socket_.async_write(boost::asio::buffer(outgoing_), [self = shared_from_this()](error_code error, size_t) {
    if (self->live_ == nullptr) return;
    self->live_->stream().OnWritten(!error);
    if (error) self->Gone();
  });
}

// No more comes from the stream, or there never was one.
void WebSocket::End(const absl::Status& status) {
  finished_ = true;
  if (gone_) return Retire();
  end_timer_.expires_after(kEndTime);
  end_timer_.async_wait([socket = weak_from_this()](error_code error) {
    if (const auto self = socket.lock(); self != nullptr && !error) self->Gone();
  });
  if (status.ok()) return Close(status);
  v1::TrackResponse response;
  *response.mutable_error() = ToRpcStatus(status);
  outgoing_ = response.SerializeAsString();
  socket_.async_write(boost::asio::buffer(outgoing_), [self = shared_from_this(), status](error_code error, size_t) {
    if (error) return self->Retire();
    self->Close(status);
  });
}

void WebSocket::Close(const absl::Status& status) {
  const websocket::close_reason reason(CloseCodeOf(status));
  socket_.async_close(reason, [self = shared_from_this()](error_code) { self->Retire(); });
}

// The connection is lost, or the stream wants it no more.
void WebSocket::Gone() {
  if (gone_) return;
  gone_ = true;
  error_code ignored;
  beast::get_lowest_layer(socket_).socket().close(ignored);
  if (live_ != nullptr && !finished_) live_->stream().OnCancel();
}

void WebSocket::Retire() {
  if (live_ != nullptr) streams_.Retire(std::exchange(live_, nullptr));
}

}  // namespace holdfast
