// SPDX-License-Identifier: Apache-2.0
#include "server/engine/tracks/track_set.h"

#include <algorithm>
#include <utility>

#include "absl/container/flat_hash_set.h"

namespace holdfast {

void TrackSet::Seed(PointSeed seed) {
  const PointId id = seed.query.id;
  EndTrack(id, /*last_frame=*/seed.frame, /*stop=*/seed.frame);
  tracks_.push_back(std::make_unique<PointTrack>(std::move(seed), windows_, rule_));
  newest_[id] = tracks_.back().get();
}

const PointTrack& TrackSet::Restore(TrackState state) {
  tracks_.push_back(std::make_unique<PointTrack>(std::move(state), windows_, rule_, geometry_));
  PointTrack& track = *tracks_.back();
  newest_[track.id()] = &track;
  return track;
}

void TrackSet::Remove(PointId id, int64_t frame) { EndTrack(id, frame, frame + 1); }

bool TrackSet::Stop(PointId id, int64_t query_frame, int64_t stop) {
  const auto found = std::find_if(tracks_.begin(), tracks_.end(), [&](const auto& track) {
    return track->id() == id && track->seed().frame == query_frame;
  });
  if (found == tracks_.end()) return false;
  const bool lived = !(*found)->ending();
  // Before the last frame of any window to come, and before any that the caller may yet speak of.
  (*found)->End(/*last_frame=*/query_frame, stop);
  return lived;
}

void TrackSet::EndTrack(PointId id, int64_t last_frame, int64_t stop) {
  const auto it = newest_.find(id);
  if (it == newest_.end()) return;
  const TrackState::Ending before = it->second->ending_at();
  it->second->End(std::min(last_frame, before.last_frame), std::min(stop, before.stop));
}

template <typename Visit>
void TrackSet::VisitDue(bool ended, Visit visit) const {
  // A track waits for the one before it of the same id, so that their runs leave in order.
  absl::flat_hash_set<PointId> waiting;
  for (const auto& track : tracks_) {
    if (!waiting.empty() && waiting.contains(track->id())) continue;
    if (track->ending()) waiting.insert(track->id());
    const std::optional<WindowPlan> plan = track->Due(cache_.newest(), ended);
    if (plan && !visit(DueRow{track.get(), *plan})) return;
  }
}

std::vector<DueRow> TrackSet::Due(bool ended) const {
  std::vector<DueRow> rows;
  VisitDue(ended, [&rows](const DueRow& row) {
    rows.push_back(row);
    return true;
  });
  std::stable_sort(rows.begin(), rows.end(), [](const DueRow& a, const DueRow& b) {
    return a.plan.first != b.plan.first ? a.plan.first < b.plan.first : a.plan.last < b.plan.last;
  });
  return rows;
}

bool TrackSet::AnyDue(bool ended) const {
  bool any = false;
  VisitDue(ended, [&any](const DueRow&) { return !(any = true); });
  return any;
}

WindowGroup TrackSet::Group(absl::Span<const DueRow> rows) const {
  WindowGroup group;
  const WindowPlan& plan = rows.front().plan;
  for (int64_t frame = plan.first; frame < plan.first + windows_.frames; ++frame) {
    group.frames.push_back(cache_.At(std::min(frame, plan.last)));
  }
  for (const DueRow& row : rows) group.rows.push_back(row.track->Row(row.plan, row.carried));
  return group;
}

std::optional<PointRun> TrackSet::Apply(const DueRow& row, RowEstimate estimate) {
  row.track->Apply(row.plan, std::move(estimate), geometry_);
  if (row.track->waits_for_polish()) return std::nullopt;
  return row.track->TakeRun(provisional_, geometry_);
}

std::vector<PointTrack*> TrackSet::Unpolished() {
  std::vector<PointTrack*> taken;
  for (const auto& track : tracks_) {
    if (track->waits_for_polish()) taken.push_back(track.get());
  }
  return taken;
}

std::optional<PointRun> TrackSet::Polish(PointTrack& track, absl::Span<const PointTrack::Polished> polished,
                                         const Deformation& deformation) {
  track.Polish(polished, deformation, geometry_);
  return track.TakeRun(provisional_, geometry_);
}

bool TrackSet::AnyUnpolished() const {
  return std::any_of(tracks_.begin(), tracks_.end(), [](const auto& track) { return track->waits_for_polish(); });
}

int64_t TrackSet::oldest_for_polish() const {
  int64_t oldest = cache_.newest() + 1;
  for (const auto& track : tracks_) oldest = std::min(oldest, track->reportable_before() - 1);
  return oldest;
}

std::vector<PointRun> TrackSet::TakeEnded() {
  if (std::none_of(tracks_.begin(), tracks_.end(), [](const auto& track) { return track->ending(); })) return {};
  std::vector<PointRun> runs;
  absl::flat_hash_set<PointId> waiting;
  const auto ended = [&](const std::unique_ptr<PointTrack>& track) {
    if (!track->ending() || waiting.contains(track->id())) return false;
    if (!track->over(cache_.newest()) || track->Due(cache_.newest(), /*stream_ended=*/false)) {
      waiting.insert(track->id());
      return false;
    }
    track->Finalize();
    if (track->waits_for_polish()) {
      waiting.insert(track->id());
      return false;
    }
    if (auto run = track->TakeRun(provisional_, geometry_)) runs.push_back(*std::move(run));
    return true;
  };
  // remove_if may not call its predicate in order by the letter of the standard; this loop does.
  std::vector<std::unique_ptr<PointTrack>> kept;
  for (auto& track : tracks_) {
    if (ended(track)) {
      dropped_.push_back({track->serial(), track->id(), track->seed().frame});
      const auto newest = newest_.find(track->id());
      if (newest != newest_.end() && newest->second == track.get()) newest_.erase(newest);
    } else {
      kept.push_back(std::move(track));
    }
  }
  tracks_ = std::move(kept);
  return runs;
}

void TrackSet::FinalizeAll() {
  for (const auto& track : tracks_) track->Finalize();
}

std::vector<PointRun> TrackSet::FinishAll() {
  std::vector<PointRun> runs;
  FinalizeAll();
  for (const auto& track : tracks_) {
    if (auto run = track->TakeRun(provisional_, geometry_)) runs.push_back(*std::move(run));
  }
  Clear();
  return runs;
}

int64_t TrackSet::Clear() {
  const int64_t dropped = tracks();
  newest_.clear();
  tracks_.clear();
  cache_.Clear();
  return dropped;
}

void TrackSet::Evict(int64_t keep) {
  int64_t needed = std::min(keep, cache_.newest() - windows_.frames + 1);
  for (const auto& track : tracks_) needed = std::min(needed, track->oldest_frame_needed());
  cache_.EvictBefore(needed);
}

int64_t TrackSet::reported_before() const {
  int64_t before = cache_.newest() + 1;
  for (const auto& track : tracks_) before = std::min(before, track->reported_before());
  return before;
}

}  // namespace holdfast
