// SPDX-License-Identifier: Apache-2.0
#include "client/backoff.h"

#include <algorithm>
#include <utility>

namespace holdfast {

Backoff::Backoff(const Options& options, std::function<double()> random)
    : options_(options), random_(std::move(random)), wait_(options.first) {}

absl::Duration Backoff::Next() {
  const absl::Duration wait = std::min(wait_, options_.longest);
  wait_ = std::min(wait * options_.factor, options_.longest);
  return wait * (1 + options_.jitter * (2 * random_() - 1));
}

}  // namespace holdfast
