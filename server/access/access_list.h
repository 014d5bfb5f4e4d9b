// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/logger.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "api/clock.h"
#include "server/watched_file.h"

namespace holdfast {

// Who a caller is and what is theirs. A limit of 0 leaves the server's own.
struct Grant {
  std::string name;      // for logs; not secret
  int max_sessions = 0;  // open at once
  int max_points = 0;    // of one session
};

// The callers that a server knows by their tokens. Holds digests of tokens, not the tokens. Immutable, never empty.
class AccessList {
 public:
  static constexpr size_t kMaxNames = 1000;
  static constexpr size_t kMaxNameBytes = 64;
  static constexpr size_t kMinTokenBytes = 16;
  static constexpr size_t kMaxTokenBytes = 1024;

  // Of lines "name:token" with the optional columns "max_sessions=N" and "max_points=N" behind; lines that are empty or
  // begin with # are passed over. A token has the characters of RFC 6750. INVALID_ARGUMENT names the line and what was
  // expected there. No error quotes the text.
  static absl::StatusOr<AccessList> Parse(absl::string_view text);

  // Null: the token is nobody's. Takes as long whatever the token is, apart from its length.
  const Grant* Find(absl::string_view token) const;
  size_t size() const { return entries_.size(); }

 private:
  using Digest = std::array<unsigned char, 32>;  // SHA-256
  struct Entry {
    Digest digest;
    Grant grant;
  };
  static Digest DigestOf(absl::string_view token);
  static absl::StatusOr<Entry> ParseLine(absl::string_view text, int line);

  std::vector<Entry> entries_;
};

// The list of a file, which may be changed while the server runs.
using AccessFile = WatchedFile<AccessList>;
absl::StatusOr<std::unique_ptr<AccessFile>> OpenAccessFile(std::string path, const Clock& clock,
                                                           std::shared_ptr<spdlog::logger> log);

}  // namespace holdfast
