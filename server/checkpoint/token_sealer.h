// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/logger.h>

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "api/clock.h"
#include "server/checkpoint/key_ring.h"
#include "server/engine/checkpoint_sealer.h"

namespace holdfast {

// Seals sessions' states with the keys of a file, which servers share and which outlive them, or without one with a
// random key, which no other process knows.
class TokenSealer final : public CheckpointSealer {
 public:
  struct Options {
    std::string key_file;                      // see KeyRing::Parse; empty: a random key
    absl::Duration max_age = absl::Hours(24);  // of tokens that are taken; by the wall clock, which servers share
  };
  // 'clock' must outlive the sealer.
  static absl::StatusOr<std::unique_ptr<TokenSealer>> Create(const Options& options, const Clock& clock,
                                                             std::shared_ptr<spdlog::logger> log);

  absl::StatusOr<std::string> Seal(const SessionState& state) const override;
  absl::StatusOr<SessionState> Unseal(absl::string_view token) const override;
  bool outlives_process() const override { return file_ != nullptr; }

 private:
  TokenSealer(absl::Duration max_age, const Clock& clock, std::unique_ptr<KeyFile> file,
              std::shared_ptr<const KeyRing> random)
      : max_age_(max_age), clock_(clock), file_(std::move(file)), random_(std::move(random)) {}
  std::shared_ptr<const KeyRing> Keys() const { return file_ == nullptr ? random_ : file_->Current(); }

  const absl::Duration max_age_;
  const Clock& clock_;
  const std::unique_ptr<KeyFile> file_;          // null: there is 'random_'
  const std::shared_ptr<const KeyRing> random_;  // null: there is 'file_'
};

}  // namespace holdfast
