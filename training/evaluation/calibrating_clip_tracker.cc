// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/calibrating_clip_tracker.h"

#include "absl/strings/str_cat.h"
#include "training/evaluation/evaluator.h"
#include "training/evaluation/reliability.h"

namespace holdfast {

EvidenceSink EvidenceLog::Sink() {
  return [this](PointId id, int64_t frame, const Evidence& evidence) {
    absl::MutexLock lock(&mutex_);
    evidence_[{id, frame}] = evidence;
  };
}

std::map<std::pair<PointId, int64_t>, Evidence> EvidenceLog::Take() {
  absl::MutexLock lock(&mutex_);
  return std::exchange(evidence_, {});
}

absl::StatusOr<ClipEstimate> CalibratingClipTracker::Track(const Sample& clip,
                                                           const std::vector<int64_t>& query_frames) {
  log_.Take();  // of a clip that failed
  absl::StatusOr<ClipEstimate> estimate = method_->Track(clip, query_frames);
  if (!estimate.ok()) return estimate;
  const auto evidence = log_.Take();
  for (const Claim& claim : ClaimsOf(ToScoredVideo(clip, query_frames, *estimate))) {
    const int64_t frame = claim.index / clip.num_points(), point = claim.index % clip.num_points();
    const auto found = evidence.find({static_cast<PointId>(point), frame});
    if (found == evidence.end()) {
      return absl::InternalError(absl::StrCat("no evidence for point ", point, " in frame ", frame));
    }
    judged_.push_back({found->second, claim.right});
  }
  return estimate;
}

}  // namespace holdfast
