// SPDX-License-Identifier: Apache-2.0
#include "client/reconnect_plan.h"

#include <algorithm>
#include <utility>

#include "api/errors.h"

namespace holdfast {
namespace {

constexpr absl::Duration kLongest = absl::Hours(24 * 365);  // an infinite one would overflow the clock's type

SteadyTime Later(SteadyTime time, absl::Duration by) {
  return time + absl::ToChronoNanoseconds(std::min(by, kLongest));
}

}  // namespace

ReconnectPlan::ReconnectPlan(const Options& options, std::function<double()> random)
    : options_(options), backoff_(options.backoff, std::move(random)), servers_(options.servers) {}

void ReconnectPlan::Lost(size_t server, SteadyTime now, bool recovered) {
  lost_ = server;
  next_ = (server + 1) % servers_.size();
  if (!recovered) return;
  backoff_.Reset();
  servers_.assign(servers_.size(), Candidate());
  deadline_ = Later(now, options_.timeout);
}

std::optional<ReconnectPlan::Attempt> ReconnectPlan::Next(SteadyTime now) {
  const SteadyTime earliest = Later(now, backoff_.Next());
  std::optional<Attempt> best;
  for (size_t i = 0; i < servers_.size(); ++i) {
    const size_t server = (next_ + i) % servers_.size();
    if (servers_[server].refused) continue;
    const SteadyTime at = std::max(earliest, servers_[server].not_before);
    if (!best || at < best->at) best = Attempt{server, at};
  }
  if (!best || best->at > deadline_) return std::nullopt;
  asked_ = best->server;
  next_ = (best->server + 1) % servers_.size();
  return best;
}

bool ReconnectPlan::Failed(const absl::Status& status, SteadyTime now) {
  Candidate& server = servers_[asked_];
  switch (status.code()) {
    case absl::StatusCode::kUnavailable:
    case absl::StatusCode::kDeadlineExceeded:
      return true;
    case absl::StatusCode::kResourceExhausted: {
      const auto overload = OverloadDetails(status);
      if (!overload || overload->retry_after <= absl::ZeroDuration()) return false;
      server.not_before = Later(now, overload->retry_after);
      return true;
    }
    case absl::StatusCode::kFailedPrecondition:  // of a token: other keys or weights, or another process
      server.refused = true;
      return std::any_of(servers_.begin(), servers_.end(), [](const Candidate& other) { return !other.refused; });
    default:
      return false;
  }
}

}  // namespace holdfast
