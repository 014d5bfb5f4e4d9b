// SPDX-License-Identifier: Apache-2.0
// What the web port makes of a request's headers. Pieces: path, range, ETag, host, origin, subprotocols.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <string>
#include <vector>

#include "server/web/host_check.h"
#include "server/web/http_answer.h"
#include "server/web/subprotocols.h"
#include "tests/fuzz/fuzz_input.h"

namespace holdfast {
namespace {

const std::vector<PageFile>& Files() {
  static const auto* const files = new std::vector<PageFile>{{"/index.html", "0123456789", "\"a\""}};
  return *files;
}

bool IsPieceOfAFile(const HttpAnswer& answer) {
  return answer.code != 206 || (!answer.body().empty() && Files()[0].bytes.find(answer.body()) != std::string::npos);
}

// A page of another site is let in only where it is listed.
bool IsTurnedAway(const std::string& host, const std::string& origin) {
  const bool own = std::equal(origin.rbegin(), origin.rbegin() + std::min(origin.size(), host.size()), host.rbegin(),
                              host.rend(), [](char a, char b) { return std::tolower(a) == std::tolower(b); });
  return origin.empty() || own || !CheckHost({}, host, origin).ok();
}

}  // namespace
}  // namespace holdfast

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  holdfast::FuzzInput input(data, size);
  std::array<std::string, 6> pieces;
  for (std::string& piece : pieces) piece = input.TakePiece().value_or("");
  EXPECT_TRUE(
      holdfast::IsPieceOfAFile(holdfast::AnswerWithFile({"GET", pieces[0], pieces[1], pieces[2]}, holdfast::Files())));
  EXPECT_TRUE(holdfast::IsTurnedAway(pieces[3], pieces[4]));
  bool offers = false;
  const std::string authorization = holdfast::AuthorizationOf(pieces[5], offers);
  EXPECT_TRUE(authorization.empty() || pieces[5].find("bearer.") != std::string::npos);
  return 0;
}
