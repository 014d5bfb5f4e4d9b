// SPDX-License-Identifier: Apache-2.0
#include "server/access/gatekeeper.h"

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "api/errors.h"

namespace holdfast {
namespace {

constexpr absl::string_view kScheme = "bearer ";          // its case plays no part
constexpr absl::Duration kLogPeriod = absl::Seconds(10);  // a stranger shall not fill the log

// Empty where there is none.
absl::string_view TokenOf(absl::string_view authorization) {
  if (!absl::StartsWithIgnoreCase(authorization, kScheme)) return "";
  return authorization.substr(kScheme.size());
}

}  // namespace

void Gatekeeper::Pass::Leave() {
  if (owner_ != nullptr && !std::exchange(leaving_, true)) owner_->MoveToLeaving(grant_.name);
}

void Gatekeeper::Pass::GiveBack() {
  if (Gatekeeper* const owner = std::exchange(owner_, nullptr)) owner->Release(grant_.name, leaving_);
}

absl::StatusOr<std::unique_ptr<Gatekeeper>> Gatekeeper::Create(const std::string& token_file, const Clock& clock,
                                                               std::shared_ptr<spdlog::logger> log) {
  std::unique_ptr<AccessFile> file;
  if (!token_file.empty()) {
    auto opened = OpenAccessFile(token_file, clock, log);
    if (!opened.ok()) return opened.status();
    file = *std::move(opened);
  }
  return std::unique_ptr<Gatekeeper>(new Gatekeeper(std::move(file), clock, std::move(log)));
}

absl::StatusOr<Grant> Gatekeeper::Check(absl::string_view authorization, absl::string_view peer) {
  if (file_ == nullptr) return Grant();
  const absl::string_view token = TokenOf(authorization);
  const std::shared_ptr<const AccessList> list = file_->Current();
  if (token.size() <= AccessList::kMaxTokenBytes) {
    if (const Grant* grant = list->Find(token); grant != nullptr) return *grant;
  }
  LogRefusal(peer);
  return absl::UnauthenticatedError(token.empty() ? "expected a token in the metadata: authorization: Bearer TOKEN"
                                                  : "the token is not one that this server knows");
}

absl::StatusOr<Gatekeeper::Pass> Gatekeeper::Admit(absl::string_view authorization, absl::string_view peer) {
  absl::StatusOr<Grant> grant = Check(authorization, peer);
  if (!grant.ok()) return grant.status();
  if (grant->name.empty()) return Pass();
  absl::MutexLock lock(&mutex_);
  Streams& streams = streams_[grant->name];
  const int most = grant->max_sessions;
  if (most > 0 && (streams.open >= most || streams.open + streams.leaving >= 2 * int64_t{most})) {
    return OverloadError("sessions", absl::StrCat("all ", most, " of ", grant->name, " are open"), kRetryAfter);
  }
  ++streams.open;
  return Pass(this, *std::move(grant));
}

void Gatekeeper::MoveToLeaving(const std::string& name) {
  absl::MutexLock lock(&mutex_);
  Streams& streams = streams_[name];
  --streams.open;
  ++streams.leaving;
}

void Gatekeeper::Release(const std::string& name, bool leaving) {
  absl::MutexLock lock(&mutex_);
  const auto found = streams_.find(name);
  --(leaving ? found->second.leaving : found->second.open);
  if (found->second.open + found->second.leaving == 0) streams_.erase(found);
}

void Gatekeeper::LogRefusal(absl::string_view peer) {
  int64_t others;
  {
    absl::MutexLock lock(&mutex_);
    ++unlogged_;
    const SteadyTime now = clock_.SteadyNow();
    if (logged_ && Between(*logged_, now) < kLogPeriod) return;
    logged_ = now;
    others = std::exchange(unlogged_, 0) - 1;
  }
  log_->warn(absl::StrCat("refused ", peer, ": no token, or an unknown one", others > 0 ? "; and " : "",
                          others > 0 ? absl::StrCat(others, " more calls since the last such line") : ""));
}

}  // namespace holdfast
