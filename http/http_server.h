// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace holdfast {

struct HttpPage {
  int code = 200;
  std::string content_type;
  std::string text;
};

HttpPage TextPage(int code, std::string text);
// 'text' is in Prometheus' format.
HttpPage MetricsPage(std::string text);

// Makes the page of a path, each time it is asked for; on the server's thread, so that it must be quick.
using HttpPages = std::map<std::string, std::function<HttpPage()>, std::less<>>;

// Serves pages over plain HTTP, to GET and HEAD; 404 for other paths. Who connects has a second to ask for one, and the
// connection ends with the answer. One thread serves all connections, of which silent and slow ones hold up no others.
class HttpServer {
 public:
  // 'address' and errors as of a Listener.
  static absl::StatusOr<std::unique_ptr<HttpServer>> Start(const std::string& address, HttpPages pages);
  ~HttpServer();

  int port() const;

 private:
  class Impl;
  explicit HttpServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace holdfast
