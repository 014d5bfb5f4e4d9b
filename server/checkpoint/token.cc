// SPDX-License-Identifier: Apache-2.0
#include "server/checkpoint/token.h"

#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <zlib.h>

#include <array>
#include <cstdint>
#include <optional>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

constexpr absl::string_view kMagic = "HFCP";
constexpr uint8_t kVersion = 1;
constexpr int kTimeBytes = 8;
constexpr int kSizeBytes = 4;

using Hmac = std::array<unsigned char, 32>;

absl::Status Bad(absl::string_view what) {
  return absl::FailedPreconditionError(absl::StrCat("the resume token ", what));
}

// Numbers stand from their highest byte on.
void AppendNumber(uint64_t number, int bytes, std::string& to) {
  for (int shift = 8 * (bytes - 1); shift >= 0; shift -= 8) to.push_back(static_cast<char>(number >> shift));
}

// Takes a text apart from its beginning; what is asked for beyond its end is empty or 0, and is told by cut_off().
class Reader {
 public:
  explicit Reader(absl::string_view text) : text_(text) {}

  bool cut_off() const { return cut_off_; }
  absl::string_view Take(uint64_t bytes) {
    cut_off_ = cut_off_ || bytes > text_.size();
    if (cut_off_) return {};
    const absl::string_view taken = text_.substr(0, bytes);
    text_.remove_prefix(bytes);
    return taken;
  }
  uint64_t Number(int bytes) {
    uint64_t number = 0;
    for (const char c : Take(bytes)) number = number << 8 | static_cast<uint8_t>(c);
    return number;
  }

 private:
  absl::string_view text_;
  bool cut_off_ = false;
};

// Empty where the library has no SHA-256 at all: nothing is sealed or opened there.
std::optional<Hmac> HmacOf(absl::string_view bytes, const SealingKey& key) {
  Hmac hmac{};
  const unsigned char* const made =
      HMAC(EVP_sha256(), key.secret.data(), static_cast<int>(key.secret.size()),
           reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size(), hmac.data(), nullptr);
  return made == nullptr ? std::nullopt : std::optional(hmac);
}

// What a token says, once it is whole and made by a server with one of the keys.
struct Parts {
  absl::Time made;
  uint64_t content_bytes = 0;
  absl::string_view compressed;
};

absl::StatusOr<Parts> Verify(absl::string_view token, const KeyRing& keys) {
  if (static_cast<int64_t>(token.size()) > kMaxTokenBytes) return Bad("is longer than any token");
  Reader reader(token);
  const absl::string_view magic = reader.Take(kMagic.size());
  if (magic.empty() || magic != kMagic) return Bad("is no token of a checkpoint");
  const uint64_t version = reader.Number(1);
  if (!reader.cut_off() && version != kVersion) {
    return Bad(absl::StrCat("has version ", version, ", which this server does not know"));
  }
  const absl::string_view id = reader.Take(reader.Number(1));
  Parts parts;
  parts.made = absl::FromUnixSeconds(static_cast<int64_t>(reader.Number(kTimeBytes)));
  parts.content_bytes = reader.Number(kSizeBytes);
  parts.compressed = reader.Take(reader.Number(kSizeBytes));
  const absl::string_view hmac = reader.Take(sizeof(Hmac));
  if (reader.cut_off()) return Bad("is cut off");
  const SealingKey* const key = keys.Find(id);
  if (key == nullptr) {
    return Bad(absl::StrCat("was made by a server with other keys: this one has no key '",
                            absl::CHexEscape(id.substr(0, KeyRing::kMaxIdBytes)), "'"));
  }
  const size_t signed_bytes = static_cast<size_t>(hmac.data() - token.data());
  const std::optional<Hmac> right = HmacOf(token.substr(0, signed_bytes), *key);
  if (!right || CRYPTO_memcmp(hmac.data(), right->data(), right->size()) != 0 ||
      signed_bytes + hmac.size() != token.size()) {
    return Bad("was tampered with, or made with another secret of the same name");
  }
  return parts;
}

std::string FormatUtc(absl::Time time) { return absl::FormatTime(absl::RFC3339_sec, time, absl::UTCTimeZone()); }

}  // namespace

absl::StatusOr<std::string> SealToken(absl::string_view content, const SealingKey& key, absl::Time now) {
  if (static_cast<int64_t>(content.size()) > kMaxSealedBytes) {
    return absl::ResourceExhaustedError(
        absl::StrCat("the session's state has ", content.size(), " bytes; a checkpoint holds ", kMaxSealedBytes));
  }
  uLongf compressed_bytes = compressBound(content.size());
  std::string compressed(compressed_bytes, '\0');
  if (compress2(reinterpret_cast<Bytef*>(compressed.data()), &compressed_bytes,
                reinterpret_cast<const Bytef*>(content.data()), content.size(), Z_BEST_SPEED) != Z_OK) {
    return absl::InternalError("there is no memory to compress the session's state");
  }
  compressed.resize(compressed_bytes);
  std::string token(kMagic);
  AppendNumber(kVersion, 1, token);
  AppendNumber(key.id.size(), 1, token);
  token += key.id;
  AppendNumber(static_cast<uint64_t>(absl::ToUnixSeconds(now)), kTimeBytes, token);
  AppendNumber(content.size(), kSizeBytes, token);
  AppendNumber(compressed.size(), kSizeBytes, token);
  token += compressed;
  const std::optional<Hmac> hmac = HmacOf(token, key);
  if (!hmac) return absl::UnimplementedError("the system's OpenSSL has no HMAC-SHA256 to sign a checkpoint with");
  token.append(hmac->begin(), hmac->end());
  if (static_cast<int64_t>(token.size()) <= kMaxTokenBytes) return token;
  return absl::ResourceExhaustedError(
      absl::StrCat("the checkpoint's token would have ", token.size(), " bytes; at most ", kMaxTokenBytes));
}

absl::StatusOr<std::string> OpenToken(absl::string_view token, const KeyRing& keys, absl::Time oldest) {
  const absl::StatusOr<Parts> parts = Verify(token, keys);
  if (!parts.ok()) return parts.status();
  if (parts->made < oldest) {
    return Bad(absl::StrCat("is too old: it was made at ", FormatUtc(parts->made), ", before ", FormatUtc(oldest)));
  }
  if (static_cast<int64_t>(parts->content_bytes) > kMaxSealedBytes) return Bad("holds more than any session says");
  std::string content(parts->content_bytes, '\0');
  uLongf bytes = content.size();
  if (uncompress(reinterpret_cast<Bytef*>(content.data()), &bytes,
                 reinterpret_cast<const Bytef*>(parts->compressed.data()), parts->compressed.size()) != Z_OK ||
      bytes != content.size()) {
    return Bad("does not hold what it says");
  }
  return content;
}

}  // namespace holdfast
