// SPDX-License-Identifier: Apache-2.0
#include "server/checkpoint/key_ring.h"

#include <openssl/rand.h>

#include <algorithm>
#include <array>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "server/secret_lines.h"

namespace holdfast {
namespace {

constexpr size_t kRandomIdBytes = 8;

bool IsIdCharacter(char c) { return absl::ascii_isalnum(c) || c == '.' || c == '_' || c == '-'; }

bool IsId(absl::string_view id) {
  return !id.empty() && id.size() <= KeyRing::kMaxIdBytes && std::all_of(id.begin(), id.end(), IsIdCharacter);
}

// Digits of hex alone are hex, even where they could be Base64. Empty: it is neither.
std::string DecodeSecret(absl::string_view text) {
  if (text.size() % 2 == 0 && std::all_of(text.begin(), text.end(), absl::ascii_isxdigit)) {
    return absl::HexStringToBytes(text);
  }
  std::string secret;
  if (absl::Base64Unescape(text, &secret) || absl::WebSafeBase64Unescape(text, &secret)) return secret;
  return "";
}

absl::StatusOr<SealingKey> ParseLine(absl::string_view text, int line) {
  const std::pair<absl::string_view, absl::string_view> parts = absl::StrSplit(text, absl::MaxSplits(':', 1));
  const absl::string_view id = absl::StripAsciiWhitespace(parts.first);
  if (text.find(':') == absl::string_view::npos || !IsId(id)) {
    return BadLine(line, absl::StrCat("id:secret, the id of 1 to ", KeyRing::kMaxIdBytes,
                                      " letters, digits, dots, dashes and underscores"));
  }
  std::string secret = DecodeSecret(absl::StripAsciiWhitespace(parts.second));
  if (secret.empty()) return BadLine(line, "a secret in hex or Base64 behind the colon");
  if (secret.size() < KeyRing::kMinSecretBytes || secret.size() > KeyRing::kMaxSecretBytes) {
    return BadLine(line, absl::StrCat("a secret of ", KeyRing::kMinSecretBytes, " to ", KeyRing::kMaxSecretBytes,
                                      " bytes, not of ", secret.size()));
  }
  return SealingKey{std::string(id), std::move(secret)};
}

}  // namespace

absl::StatusOr<KeyRing> KeyRing::Parse(absl::string_view text) {
  std::vector<SealingKey> keys;
  const auto take = [&keys](absl::string_view content, int line) -> absl::Status {
    absl::StatusOr<SealingKey> key = ParseLine(content, line);
    if (!key.ok()) return key.status();
    const auto same = [&key](const SealingKey& other) { return other.id == key->id; };
    if (std::any_of(keys.begin(), keys.end(), same)) return BadLine(line, "an id that no line before has");
    if (keys.size() == kMaxKeys) return BadLine(line, absl::StrCat("at most ", kMaxKeys, " keys"));
    keys.push_back(*std::move(key));
    return absl::OkStatus();
  };
  if (absl::Status status = ForEachEntry(text, take); !status.ok()) return status;
  if (keys.empty()) return absl::InvalidArgumentError("there is no key: expected lines id:secret");
  return KeyRing(std::move(keys));
}

absl::StatusOr<KeyRing> KeyRing::Random() {
  std::array<unsigned char, kRandomIdBytes + kMinSecretBytes> bytes;
  if (RAND_bytes(bytes.data(), static_cast<int>(bytes.size())) != 1) {
    return absl::UnavailableError("the system has no random bytes for a key");
  }
  const std::string text(bytes.begin(), bytes.end());
  const std::string id = absl::StrCat("random-", absl::BytesToHexString(text.substr(0, kRandomIdBytes)));
  return KeyRing({{id, text.substr(kRandomIdBytes)}});
}

const SealingKey* KeyRing::Find(absl::string_view id) const {
  const auto found = std::find_if(keys_.begin(), keys_.end(), [id](const SealingKey& key) { return key.id == id; });
  return found == keys_.end() ? nullptr : &*found;
}

absl::StatusOr<std::unique_ptr<KeyFile>> OpenKeyFile(std::string path, const Clock& clock,
                                                     std::shared_ptr<spdlog::logger> log) {
  const auto describe = [](const KeyRing& keys) { return absl::StrCat("sealing with ", keys.sealing().id); };
  return KeyFile::Open({std::move(path), "checkpoint keys", KeyRing::Parse, describe}, clock, std::move(log));
}

}  // namespace holdfast
