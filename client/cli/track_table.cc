// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_table.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"

namespace holdfast {

TrackTable::TrackTable(std::vector<StartPoint> points) {
  for (StartPoint& point : points) {
    index_[point.query.id] = tracks_.size();
    tracks_.push_back({std::move(point), {}, 0});
  }
}

absl::Status TrackTable::Apply(const TrackUpdate& update) {
  frames_ = std::max(frames_, update.frames_received);
  for (const PointRun& run : update.runs) {
    const absl::Status applied = ApplyRun(run);
    if (!applied.ok()) return applied;
  }
  return absl::OkStatus();
}

absl::Status TrackTable::ApplyRun(const PointRun& run) {
  const auto found = index_.find(run.id);
  if (found == index_.end())
    return absl::InternalError(absl::StrCat("the tracker answered for point ", run.id, ", which was never sent"));
  TableTrack& track = tracks_[found->second];
  const int64_t length = static_cast<int64_t>(run.x.size());
  const int64_t first = run.first_frame - track.start.frame;
  if (first < 0 || run.first_frame > frames_ - length) {
    return absl::InternalError(absl::StrCat("the tracker answered for point ", run.id, " on frames ", run.first_frame,
                                            "..", run.first_frame + length - 1, "; it lives on frames ",
                                            track.start.frame, "..", frames_ - 1));
  }
  if (static_cast<int64_t>(track.samples.size()) < first + length) track.samples.resize(first + length);
  for (int64_t i = 0; i < length; ++i) {
    TrackSample& sample = track.samples[first + i];
    const bool is_final = i < run.final_count;
    if (sample.is_final() && !is_final) continue;
    sample = {run.x[i], run.y[i], run.confidence[i], run.visible[i] != 0,
              is_final ? TrackSample::State::kFinal : TrackSample::State::kProvisional};
  }
  const auto end = static_cast<int64_t>(track.samples.size());
  while (track.final_frames < end && track.samples[track.final_frames].is_final()) ++track.final_frames;
  while (track.answered_frames < end && !track.samples[track.answered_frames].is_absent()) ++track.answered_frames;
  return absl::OkStatus();
}

int64_t TrackTable::final_frames() const {
  int64_t frames = frames_;
  for (const TableTrack& track : tracks_) frames = std::min(frames, track.start.frame + track.final_frames);
  return frames;
}

int64_t TrackTable::estimated_frames() const {
  int64_t frames = 0;
  for (const TableTrack& track : tracks_) {
    if (!track.samples.empty()) {
      frames = std::max(frames, track.start.frame + static_cast<int64_t>(track.samples.size()));
    }
  }
  return frames;
}

int64_t TrackTable::answered_frames() const {
  int64_t frames = frames_;
  for (const TableTrack& track : tracks_) frames = std::min(frames, track.start.frame + track.answered_frames);
  return frames;
}

const TrackSample* TrackTable::Estimate(const TableTrack& track, int64_t frame) {
  const int64_t i = frame - track.start.frame;
  if (i < 0 || i >= static_cast<int64_t>(track.samples.size()) || track.samples[i].is_absent()) return nullptr;
  return &track.samples[i];
}

}  // namespace holdfast
