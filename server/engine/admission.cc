// SPDX-License-Identifier: Apache-2.0
#include "server/engine/admission.h"

#include <algorithm>

#include "absl/strings/str_format.h"
#include "absl/time/time.h"
#include "api/errors.h"

namespace holdfast {
namespace {

// Point-frames a second that the session takes with this many points.
double WorkOf(const Admission::Demand& demand, int64_t points) {
  const auto most = static_cast<double>(std::max(points, demand.points));
  return demand.frames_per_second * (demand.work.frame + demand.work.point * most);
}

}  // namespace

absl::StatusOr<std::unique_ptr<Admission::Ticket>> Admission::Admit(absl::Span<const Demand> demands) {
  absl::MutexLock lock(&mutex_);
  if (absl::Status status = CheckPlacesLocked(); !status.ok()) return status;
  const double budget = meter_.Budget();
  size_t choice = 0;
  while (choice < demands.size() && !WorkFits(demands[choice], budget)) ++choice;
  if (choice == demands.size()) return RefuseWork(demands, budget);
  const Demand& chosen = demands[choice];
  if (chosen.bytes > limits_.max_bytes - bytes_) return RefuseMemory(demands);
  ++load_.sessions;
  bytes_ += chosen.bytes;
  load_.work += WorkOf(chosen, 0);
  metrics_.WorkPromised(load_.work);
  return std::make_unique<Ticket>(*this, chosen, choice);
}

absl::Status Admission::CheckPlaces() {
  absl::MutexLock lock(&mutex_);
  return CheckPlacesLocked();
}

absl::Status Admission::CheckPlacesLocked() {
  if (load_.sessions < limits_.max_sessions) return absl::OkStatus();
  metrics_.AdmissionRejected(RejectReason::kSessions);
  return OverloadError("sessions", absl::StrFormat("all %d are in use", limits_.max_sessions), kRetryAfter);
}

bool Admission::WorkFits(const Demand& demand, double budget) const {
  // Who would be served at any pace has nobody to slow down.
  if (load_.sessions == 0 && !demand.insists) return true;
  return load_.work + WorkOf(demand, 0) <= budget;
}

absl::Status Admission::RefuseWork(absl::Span<const Demand> demands, double budget) {
  metrics_.AdmissionRejected(RejectReason::kWork);
  const double least = WorkOf(demands.back(), 0);
  return OverloadError(
      "point-frames per second",
      absl::StrFormat("the session needs %.0f, and %.0f of %.0f are promised to others", least, load_.work, budget),
      least > std::max(budget, meter_.QuietBudget()) ? absl::ZeroDuration() : kRetryAfter);
}

absl::Status Admission::RefuseMemory(absl::Span<const Demand> demands) {
  metrics_.AdmissionRejected(RejectReason::kMemory);
  const bool never = demands.front().bytes > limits_.max_bytes;
  return OverloadError("feature memory", never ? "the session needs more than there is" : "in use by other sessions",
                       never ? absl::ZeroDuration() : kRetryAfter);
}

Admission::Load Admission::load() const {
  absl::MutexLock lock(&mutex_);
  return load_;
}

void Admission::SetPoints(Ticket& ticket, int64_t points) {
  absl::MutexLock lock(&mutex_);
  load_.work += WorkOf(ticket.demand_, points) - WorkOf(ticket.demand_, ticket.points_);
  load_.points += points - ticket.points_;
  ticket.points_ = points;
  metrics_.WorkPromised(load_.work);
}

void Admission::Release(const Ticket& ticket) {
  absl::MutexLock lock(&mutex_);
  --load_.sessions;
  bytes_ -= ticket.demand_.bytes;
  load_.points -= ticket.points_;
  load_.work -= WorkOf(ticket.demand_, ticket.points_);
  if (load_.sessions == 0) load_.work = 0;  // what rounding has left
  metrics_.WorkPromised(load_.work);
}

}  // namespace holdfast
