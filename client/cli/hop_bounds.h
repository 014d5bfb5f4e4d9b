// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "absl/strings/string_view.h"

namespace holdfast {

// Between windows of a session: how many new frames it asks for, as SessionConfig has them. Texts are "8", "4..16" (as
// few as the server has time for) and "auto".
struct HopBounds {
  // The largest hop of "auto": beyond it accuracy was not measured.
  static constexpr int kAutoMost = 16;

  int least = 0;  // 0: the server's default
  int most = 0;   // 0: 'least' alone
  friend bool operator==(HopBounds a, HopBounds b) { return a.least == b.least && a.most == b.most; }
};

// Makes it a type of absl flags.
bool AbslParseFlag(absl::string_view text, HopBounds* bounds, std::string* error);
std::string AbslUnparseFlag(HopBounds bounds);

}  // namespace holdfast
