// SPDX-License-Identifier: Apache-2.0
#include "server/engine/session_polish.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace holdfast {

bool SessionPolish::Start(TrackSet& tracks) {
  if (job_ != nullptr) return false;
  auto job = std::make_unique<Job>();
  job->tracks = tracks.Unpolished();
  if (job->tracks.empty()) return false;
  job->first = tracks.cache().newest();
  int64_t last = 0;
  for (const PointTrack* track : job->tracks) {
    const PointTrack::Unpolished unpolished = track->unpolished();
    PolishTrack work;
    work.patch = flow_.PatchOf(track->serial());
    work.deformation = unpolished.deformation;
    work.first = unpolished.first;
    work.visible = unpolished.visible;
    if (unpolished.previous) work.previous = flow_.ToFlow(*unpolished.previous);
    for (const Position& position : unpolished.positions) work.positions.push_back(flow_.ToFlow(position));
    job->first = std::min(job->first, unpolished.first - 1);
    last = std::max(last, unpolished.first + static_cast<int64_t>(work.positions.size()) - 1);
    job->work.push_back(std::move(work));
  }
  if (last > flow_.newest()) return false;  // a resumed session whose frames have not all come again
  const std::vector<FlowPyramidPtr> pyramids = flow_.Pyramids(job->first, last);
  job->pyramids = {pyramids.begin(), pyramids.end()};
  job_ = std::move(job);
  return true;
}

bool SessionPolish::Step() {
  Job& job = *job_;
  PolishFrame(absl::MakeSpan(job.work), job.first + 1, *job.pyramids[0], *job.pyramids[1]);
  job.pyramids.pop_front();
  ++job.first;
  for (PolishTrack& track : job.work) RoundPrevious(track, job.first);
  if (job.pyramids.size() > 1) return true;
  absl::MutexLock lock(&mutex_);
  done_ = true;
  return false;
}

void SessionPolish::RoundPrevious(PolishTrack& track, int64_t frame) const {
  const int64_t at = frame - track.first;
  const bool polished = at >= 0 && at < static_cast<int64_t>(track.positions.size());
  if (polished && track.previous) track.previous = flow_.ToFlow(flow_.ToFeatures(*track.previous));
}

bool SessionPolish::Finish(TrackSet& tracks, std::vector<PointRun>& runs) {
  {
    absl::MutexLock lock(&mutex_);
    if (!done_) return false;
    done_ = false;
  }
  const std::unique_ptr<Job> job = std::move(job_);
  for (size_t i = 0; i < job->tracks.size(); ++i) {
    const PolishTrack& work = job->work[i];
    std::vector<PointTrack::Polished> polished;
    for (size_t at = 0; at < work.positions.size(); ++at) {
      polished.push_back({flow_.ToFeatures(work.positions[at]), work.outcomes[at]});
    }
    if (auto run = tracks.Polish(*job->tracks[i], polished, work.deformation)) runs.push_back(*std::move(run));
  }
  return true;
}

}  // namespace holdfast
