// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/logger.h>

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "api/clock.h"
#include "server/watched_file.h"

namespace holdfast {

// A secret of the servers that take each other's tokens, and the name that tokens know it by.
struct SealingKey {
  std::string id;      // not secret
  std::string secret;  // at least KeyRing::kMinSecretBytes
};

// The keys of a server: the first one seals, all unseal, so that keys can be exchanged one server after the other.
// Immutable, never without a key.
class KeyRing {
 public:
  static constexpr size_t kMaxKeys = 64;
  static constexpr size_t kMaxIdBytes = 32;
  static constexpr size_t kMinSecretBytes = 32;
  static constexpr size_t kMaxSecretBytes = 1024;

  // Of lines "id:secret", the secret in hex or Base64; lines that are empty or begin with # are passed over.
  // INVALID_ARGUMENT names the line and what was expected there. No error quotes the text.
  static absl::StatusOr<KeyRing> Parse(absl::string_view text);
  // One key that nobody else has. UNAVAILABLE: the system has no randomness.
  static absl::StatusOr<KeyRing> Random();

  const SealingKey& sealing() const { return keys_.front(); }
  // Null: no key of this name.
  const SealingKey* Find(absl::string_view id) const;

 private:
  explicit KeyRing(std::vector<SealingKey> keys) : keys_(std::move(keys)) {}

  std::vector<SealingKey> keys_;
};

// The keys of a file, which may be exchanged while the server runs.
using KeyFile = WatchedFile<KeyRing>;
absl::StatusOr<std::unique_ptr<KeyFile>> OpenKeyFile(std::string path, const Clock& clock,
                                                     std::shared_ptr<spdlog::logger> log);

}  // namespace holdfast
