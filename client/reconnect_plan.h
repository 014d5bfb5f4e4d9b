// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "api/clock.h"
#include "client/backoff.h"

namespace holdfast {

// Which of several servers is asked next to take a session over, and when. In rotation, with a backoff; a server that
// said when to come back is not asked before, and one that cannot take this session is not asked again. Arithmetic
// only: no threads, no clock of its own. Not thread-safe.
class ReconnectPlan {
 public:
  struct Options {
    size_t servers = 1;
    absl::Duration timeout = absl::Minutes(2);  // for one loss, from the moment it was noticed
    Backoff::Options backoff;
  };
  struct Attempt {
    size_t server = 0;
    SteadyTime at;
  };

  // 'random' gives numbers of [0, 1).
  ReconnectPlan(const Options& options, std::function<double()> random);

  // The session that ran on 'server' was lost. 'recovered': the one before this loss was over, so that this one has all
  // the time again; otherwise it counts as the same, and a session that kills every server comes to an end.
  void Lost(size_t server, SteadyTime now, bool recovered);
  // Nobody but the server that had it can go on: it is asked first.
  void StayFirst() { next_ = lost_; }
  // Empty: the time is over, or would be by then.
  std::optional<Attempt> Next(SteadyTime now);
  // What the last attempt came to. False: it is of no use to try again, here or elsewhere.
  bool Failed(const absl::Status& status, SteadyTime now);
  absl::Duration TimeLeft(SteadyTime now) const { return Between(now, deadline_); }

 private:
  struct Candidate {
    bool refused = false;   // cannot take this session
    SteadyTime not_before;  // as it asked for
  };

  const Options options_;
  Backoff backoff_;
  std::vector<Candidate> servers_;
  size_t lost_ = 0;
  size_t next_ = 0;   // first in rotation
  size_t asked_ = 0;  // by the last attempt
  SteadyTime deadline_;
};

}  // namespace holdfast
