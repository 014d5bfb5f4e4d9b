// SPDX-License-Identifier: Apache-2.0
// Bytes <-> tokens that tell whether anybody has changed them. A token is, numbers from their highest byte on:
//
//   4  "HFCP"
//   1  version, 1
//   1  k, the length of the key's id
//   k  the key's id
//   8  when it was made, in seconds since 1970
//   4  p, how many bytes it holds
//   4  z, the length of what follows
//   z  what it holds, compressed by zlib
//  32  HMAC-SHA256 of everything before, with the key's secret
//
// It is signed, not encrypted: it holds what its client has sent and what follows from it.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "api/limits.h"
#include "server/checkpoint/key_ring.h"

namespace holdfast {

// Most bytes that a token holds: nothing larger is sealed, and no memory is taken for more.
constexpr int64_t kMaxSealedBytes = 4 * kMaxTokenBytes;

// RESOURCE_EXHAUSTED: 'content' is longer than kMaxSealedBytes, or the token than kMaxTokenBytes.
absl::StatusOr<std::string> SealToken(absl::string_view content, const SealingKey& key, absl::Time now);

// The content of a token that was made no earlier than 'oldest' with one of 'keys'. Nothing of it is decompressed
// before its HMAC is found right. FAILED_PRECONDITION says what is wrong.
absl::StatusOr<std::string> OpenToken(absl::string_view token, const KeyRing& keys, absl::Time oldest);

}  // namespace holdfast
