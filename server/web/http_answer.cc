// SPDX-License-Identifier: Apache-2.0
#include "server/web/http_answer.h"

#include <algorithm>
#include <cstdint>
#include <optional>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

namespace holdfast {
namespace {

// What the page may do: nothing but talk to the server that it came from. 'self' has WebSockets to it, in browsers that
// have what else the page needs; a bare ws: would let it open one to any host.
constexpr char kPolicy[] =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; media-src 'self' blob:; "
    "worker-src 'self' blob:; connect-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'";

constexpr std::chrono::seconds kLeastTime(10);  // for any answer
constexpr size_t kLeastBytesPerSecond = size_t{8} << 10;

absl::string_view TypeOf(absl::string_view path) {
  constexpr std::pair<absl::string_view, absl::string_view> kTypes[] = {{".html", "text/html; charset=utf-8"},
                                                                        {".js", "text/javascript; charset=utf-8"},
                                                                        {".css", "text/css; charset=utf-8"},
                                                                        {".svg", "image/svg+xml"},
                                                                        {".png", "image/png"},
                                                                        {".ico", "image/x-icon"},
                                                                        {".mp4", "video/mp4"},
                                                                        {".webm", "video/webm"},
                                                                        {".json", "application/json"},
                                                                        {".txt", "text/plain; charset=utf-8"}};
  for (const auto& [ending, type] : kTypes) {
    if (absl::EndsWith(path, ending)) return type;
  }
  return "application/octet-stream";
}

// Of the header Accept-Encoding: gzip is among the codings, and is not given the weight 0.
bool TakesGzip(absl::string_view accept_encoding) {
  for (const absl::string_view coding : absl::StrSplit(accept_encoding, ',')) {
    const std::pair<absl::string_view, absl::string_view> parts = absl::StrSplit(coding, absl::MaxSplits(';', 1));
    if (!absl::EqualsIgnoreCase(absl::StripAsciiWhitespace(parts.first), "gzip")) continue;
    absl::string_view weight = absl::StripAsciiWhitespace(parts.second);
    double q = 1;
    return !absl::ConsumePrefix(&weight, "q=") || (absl::SimpleAtod(weight, &q) && q > 0);
  }
  return false;
}

// Caches have to tell what is compressed from what is not.
std::string EtagOf(const PageFile& file, bool compressed) {
  return compressed ? absl::StrCat(absl::StripSuffix(file.etag, "\""), "-gzip\"") : std::string(file.etag);
}

struct Range {
  uint64_t begin;
  uint64_t size;
};

// "bytes=FIRST-LAST", "bytes=FIRST-" or "bytes=-COUNT". Empty: none of a file of this size.
std::optional<Range> ParseRange(absl::string_view text, uint64_t size) {
  if (!absl::ConsumePrefix(&text, "bytes=")) return std::nullopt;
  const std::vector<absl::string_view> ends = absl::StrSplit(text, '-');
  uint64_t first = 0;
  uint64_t last = size - 1;
  if (ends.size() != 2 || size == 0) return std::nullopt;
  if (ends[0].empty()) {
    uint64_t count = 0;
    if (!absl::SimpleAtoi(ends[1], &count) || count == 0) return std::nullopt;
    first = size - std::min(count, size);
  } else if (!absl::SimpleAtoi(ends[0], &first) || (!ends[1].empty() && !absl::SimpleAtoi(ends[1], &last))) {
    return std::nullopt;
  }
  last = std::min(last, size - 1);
  if (first > last) return std::nullopt;
  return Range{first, last - first + 1};
}

HttpAnswer WithRange(HttpAnswer answer, absl::string_view text) {
  const uint64_t size = answer.file.size();
  const std::optional<Range> range = ParseRange(text, size);
  if (!range) {
    HttpAnswer none = TextAnswer(416, "no such range\n");
    none.headers.emplace_back("Content-Range", absl::StrCat("bytes */", size));
    return none;
  }
  answer.code = 206;
  answer.headers.emplace_back("Content-Range",
                              absl::StrCat("bytes ", range->begin, "-", range->begin + range->size - 1, "/", size));
  answer.file = answer.file.substr(range->begin, range->size);
  return answer;
}

}  // namespace

HttpAnswer TextAnswer(int code, std::string text, absl::string_view type) {
  HttpAnswer answer;
  answer.code = code;
  answer.headers = {
      {"Content-Type", std::string(type)}, {"Cache-Control", "no-store"}, {"X-Content-Type-Options", "nosniff"}};
  answer.text = std::move(text);
  return answer;
}

HttpAnswer AnswerWithFile(const HttpRequest& request, const std::vector<PageFile>& files) {
  if (request.method != "GET" && request.method != "HEAD") {
    HttpAnswer refused = TextAnswer(405, "expected GET or HEAD\n");
    refused.headers.emplace_back("Allow", "GET, HEAD");
    return refused;
  }
  const absl::string_view path = request.path == "/" ? "/index.html" : request.path;
  const auto file = std::find_if(files.begin(), files.end(), [path](const PageFile& it) { return it.path == path; });
  if (file == files.end()) return TextAnswer(404, "not found\n");
  const bool compressed = request.range.empty() && !file->gzip.empty() && TakesGzip(request.accept_encoding);
  const std::string etag = EtagOf(*file, compressed);
  HttpAnswer answer;
  answer.headers = {{"Content-Type", std::string(TypeOf(path))},
                    {"ETag", etag},
                    {"Vary", "Accept-Encoding"},
                    {"Cache-Control", "no-cache"},
                    {"Content-Security-Policy", kPolicy},
                    {"Cross-Origin-Opener-Policy", "same-origin"},
                    {"Referrer-Policy", "no-referrer"},
                    {"X-Content-Type-Options", "nosniff"},
                    {"Accept-Ranges", "bytes"}};
  if (request.if_none_match == etag) {
    answer.code = 304;
    return answer;
  }
  if (compressed) answer.headers.emplace_back("Content-Encoding", "gzip");
  answer.file = compressed ? file->gzip : file->bytes;
  return request.range.empty() ? answer : WithRange(std::move(answer), request.range);
}

std::chrono::seconds TimeToTake(size_t bytes) {
  return kLeastTime + std::chrono::seconds(bytes / kLeastBytesPerSecond);
}

}  // namespace holdfast
