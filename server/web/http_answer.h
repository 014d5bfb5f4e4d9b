// SPDX-License-Identifier: Apache-2.0
// What the web port answers to requests that open no socket.
#pragma once

#include <chrono>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/string_view.h"
#include "server/web/page_files.h"

namespace holdfast {

struct HttpRequest {
  absl::string_view method;
  absl::string_view path;   // without a query
  absl::string_view range;  // header of that name; empty: none, here and below
  absl::string_view if_none_match;
  absl::string_view accept_encoding = {};
};

struct HttpAnswer {
  int code = 200;
  std::vector<std::pair<std::string, std::string>> headers;
  std::string text;        // the body of an answer that is no file
  absl::string_view file;  // ...and of one that is; lives as long as the program

  absl::string_view body() const { return file.data() == nullptr ? absl::string_view(text) : file; }
};

// A file of 'files', compressed for who takes that, or the piece that a range of bytes names; "/" is /index.html. 404,
// 405 and 416 as HTTP has them.
HttpAnswer AnswerWithFile(const HttpRequest& request, const std::vector<PageFile>& files);

// How long a client may take over an answer of so many bytes: a large one comes over a thin line, too.
std::chrono::seconds TimeToTake(size_t bytes);

HttpAnswer TextAnswer(int code, std::string text, absl::string_view type = "text/plain; charset=utf-8");

}  // namespace holdfast
