// SPDX-License-Identifier: Apache-2.0
#include "server/checkpoint/token_sealer.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "server/checkpoint/state_convert.h"
#include "server/checkpoint/token.h"

namespace holdfast {

absl::StatusOr<std::unique_ptr<TokenSealer>> TokenSealer::Create(const Options& options, const Clock& clock,
                                                                 std::shared_ptr<spdlog::logger> log) {
  std::unique_ptr<KeyFile> file;
  std::shared_ptr<const KeyRing> random;
  if (options.key_file.empty()) {
    auto ring = KeyRing::Random();
    if (!ring.ok()) return ring.status();
    random = std::make_shared<const KeyRing>(*std::move(ring));
  } else {
    auto opened = OpenKeyFile(options.key_file, clock, std::move(log));
    if (!opened.ok()) return opened.status();
    file = *std::move(opened);
  }
  return std::unique_ptr<TokenSealer>(new TokenSealer(options.max_age, clock, std::move(file), std::move(random)));
}

absl::StatusOr<std::string> TokenSealer::Seal(const SessionState& state) const {
  const checkpoint::v1::SessionState message = ToProto(state);
  if (static_cast<int64_t>(message.ByteSizeLong()) > kMaxSealedBytes) {
    return absl::ResourceExhaustedError(absl::StrCat("the session's state has ", message.ByteSizeLong(),
                                                     " bytes; a checkpoint holds ", kMaxSealedBytes));
  }
  return SealToken(message.SerializeAsString(), Keys()->sealing(), clock_.WallNow());
}

absl::StatusOr<SessionState> TokenSealer::Unseal(absl::string_view token) const {
  const absl::StatusOr<std::string> content = OpenToken(token, *Keys(), clock_.WallNow() - max_age_);
  if (!content.ok()) return content.status();
  checkpoint::v1::SessionState message;
  if (!message.ParseFromString(*content)) {
    return absl::FailedPreconditionError("the resume token holds no session's state");
  }
  return FromProto(message);
}

}  // namespace holdfast
