// SPDX-License-Identifier: Apache-2.0
#include "server/access/access_list.h"

#include <openssl/crypto.h>
#include <openssl/sha.h>

#include <algorithm>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "server/secret_lines.h"

namespace holdfast {
namespace {

bool IsNameCharacter(char c) { return absl::ascii_isalnum(c) || absl::StrContains("._-@", c); }

bool IsTokenCharacter(char c) { return absl::ascii_isalnum(c) || absl::StrContains("-._~+/=", c); }

bool IsName(absl::string_view name) {
  return !name.empty() && name.size() <= AccessList::kMaxNameBytes &&
         std::all_of(name.begin(), name.end(), IsNameCharacter);
}

absl::Status ParseLimit(absl::string_view column, int line, Grant& grant) {
  const std::pair<absl::string_view, absl::string_view> parts = absl::StrSplit(column, absl::MaxSplits('=', 1));
  int* const limit = parts.first == "max_sessions" ? &grant.max_sessions
                     : parts.first == "max_points" ? &grant.max_points
                                                   : nullptr;
  if (limit == nullptr || !absl::SimpleAtoi(parts.second, limit) || *limit < 1) {
    return BadLine(line, "max_sessions=N or max_points=N, 1 or more, behind the token");
  }
  return absl::OkStatus();
}

}  // namespace

AccessList::Digest AccessList::DigestOf(absl::string_view token) {
  Digest digest;
  SHA256(reinterpret_cast<const unsigned char*>(token.data()), token.size(), digest.data());
  return digest;
}

absl::StatusOr<AccessList::Entry> AccessList::ParseLine(absl::string_view text, int line) {
  const std::vector<absl::string_view> columns = absl::StrSplit(text, absl::ByAnyChar(" \t"), absl::SkipEmpty());
  const std::pair<absl::string_view, absl::string_view> parts = absl::StrSplit(columns[0], absl::MaxSplits(':', 1));
  if (!absl::StrContains(columns[0], ':') || !IsName(parts.first)) {
    return BadLine(
        line, absl::StrCat("name:token, the name of 1 to ", kMaxNameBytes, " letters, digits and characters of ._-@"));
  }
  const absl::string_view token = parts.second;
  if (token.size() < kMinTokenBytes || token.size() > kMaxTokenBytes) {
    return BadLine(line, absl::StrCat("a token of ", kMinTokenBytes, " to ", kMaxTokenBytes, " characters, not of ",
                                      token.size()));
  }
  if (!std::all_of(token.begin(), token.end(), IsTokenCharacter)) {
    return BadLine(line, "a token of letters, digits and characters of -._~+/=");
  }
  Entry entry{DigestOf(token), {std::string(parts.first)}};
  for (size_t i = 1; i < columns.size(); ++i) {
    if (absl::Status status = ParseLimit(columns[i], line, entry.grant); !status.ok()) return status;
  }
  return entry;
}

absl::StatusOr<AccessList> AccessList::Parse(absl::string_view text) {
  AccessList list;
  const auto take = [&list](absl::string_view content, int line) -> absl::Status {
    absl::StatusOr<Entry> entry = ParseLine(content, line);
    if (!entry.ok()) return entry.status();
    const auto clashes = [&entry](const Entry& other) {
      return other.digest == entry->digest || other.grant.name == entry->grant.name;
    };
    if (std::any_of(list.entries_.begin(), list.entries_.end(), clashes)) {
      return BadLine(line, "a name and a token that no line before has");
    }
    if (list.entries_.size() == kMaxNames) return BadLine(line, absl::StrCat("at most ", kMaxNames, " names"));
    list.entries_.push_back(*std::move(entry));
    return absl::OkStatus();
  };
  if (absl::Status status = ForEachEntry(text, take); !status.ok()) return status;
  if (list.entries_.empty()) return absl::InvalidArgumentError("there is no name: expected lines name:token");
  return list;
}

const Grant* AccessList::Find(absl::string_view token) const {
  const Digest digest = DigestOf(token);
  const Grant* found = nullptr;
  for (const Entry& entry : entries_) {  // all of them, whichever it is
    if (CRYPTO_memcmp(entry.digest.data(), digest.data(), digest.size()) == 0) found = &entry.grant;
  }
  return found;
}

absl::StatusOr<std::unique_ptr<AccessFile>> OpenAccessFile(std::string path, const Clock& clock,
                                                           std::shared_ptr<spdlog::logger> log) {
  const auto describe = [](const AccessList& list) { return absl::StrCat(list.size(), " names"); };
  return AccessFile::Open({std::move(path), "access tokens", AccessList::Parse, describe}, clock, std::move(log));
}

}  // namespace holdfast
