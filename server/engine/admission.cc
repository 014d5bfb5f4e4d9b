// SPDX-License-Identifier: Apache-2.0
#include "server/engine/admission.h"

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "api/errors.h"

namespace holdfast {
namespace {

// Sessions last seconds to hours; a client that asks this often does no harm.
constexpr absl::Duration kRetryAfter = absl::Seconds(2);

}  // namespace

absl::StatusOr<std::unique_ptr<Admission::Ticket>> Admission::Admit(int64_t bytes) {
  absl::MutexLock lock(&mutex_);
  if (sessions_ >= limits_.max_sessions) {
    metrics_.AdmissionRejected(RejectReason::kSessions);
    return OverloadError("sessions", absl::StrCat("all ", limits_.max_sessions, " are in use"), kRetryAfter);
  }
  if (bytes > limits_.max_bytes - bytes_) {
    metrics_.AdmissionRejected(RejectReason::kMemory);
    const bool never = bytes > limits_.max_bytes;
    return OverloadError("feature memory", never ? "the session needs more than there is" : "in use by other sessions",
                         never ? absl::ZeroDuration() : kRetryAfter);
  }
  ++sessions_;
  bytes_ += bytes;
  return std::make_unique<Ticket>(*this, bytes);
}

void Admission::Release(int64_t bytes) {
  absl::MutexLock lock(&mutex_);
  --sessions_;
  bytes_ -= bytes;
}

}  // namespace holdfast
