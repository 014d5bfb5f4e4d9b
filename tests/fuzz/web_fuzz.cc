// SPDX-License-Identifier: Apache-2.0
// What the web port makes of a request's headers. Pieces: path, range, ETag, host, origin, subprotocols, codings.
#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "server/web/host_check.h"
#include "server/web/http_answer.h"
#include "server/web/subprotocols.h"
#include "tests/fuzz/fuzz_input.h"

namespace holdfast {
namespace {

const std::vector<PageFile>& Files() {
  static const auto* const files = new std::vector<PageFile>{{"/index.html", "0123456789", "\"a\"", "0-9"}};
  return *files;
}

bool IsPieceOfAFile(const HttpAnswer& answer) {
  return answer.code != 206 || (!answer.body().empty() && Files()[0].bytes.find(answer.body()) != std::string::npos);
}

// A page of another site is let in only where it is listed. 'host' may have the port that its scheme has anyhow.
bool IsTurnedAway(absl::string_view host, absl::string_view origin) {
  absl::string_view name = host;
  if (!absl::ConsumeSuffix(&name, ":443")) absl::ConsumeSuffix(&name, ":80");
  const bool own = absl::EndsWithIgnoreCase(origin, host) || absl::EndsWithIgnoreCase(origin, name);
  return origin.empty() || own || !CheckHost({}, host, origin).ok();
}

}  // namespace
}  // namespace holdfast

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  holdfast::FuzzInput input(data, size);
  std::array<std::string, 7> pieces;
  for (std::string& piece : pieces) piece = input.TakePiece().value_or("");
  EXPECT_TRUE(holdfast::IsPieceOfAFile(
      holdfast::AnswerWithFile({"GET", pieces[0], pieces[1], pieces[2], pieces[6]}, holdfast::Files())));
  EXPECT_TRUE(holdfast::IsTurnedAway(pieces[3], pieces[4]));
  bool offers = false;
  const std::string authorization = holdfast::AuthorizationOf(pieces[5], offers);
  EXPECT_TRUE(authorization.empty() || pieces[5].find("bearer.") != std::string::npos);
  return 0;
}
