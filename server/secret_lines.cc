// SPDX-License-Identifier: Apache-2.0
#include "server/secret_lines.h"

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace holdfast {

absl::Status ForEachEntry(absl::string_view text,
                          absl::FunctionRef<absl::Status(absl::string_view entry, int line)> take) {
  int line = 0;
  for (absl::string_view entry : absl::StrSplit(text, '\n')) {
    ++line;
    entry = absl::StripAsciiWhitespace(entry);
    if (entry.empty() || entry.front() == '#') continue;
    if (absl::Status status = take(entry, line); !status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::Status BadLine(int line, absl::string_view expected) {
  return absl::InvalidArgumentError(absl::StrCat("line ", line, ": expected ", expected));
}

}  // namespace holdfast
