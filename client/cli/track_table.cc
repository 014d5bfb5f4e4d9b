// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_table.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/limits.h"

namespace holdfast {
namespace {

void DropVoid(TableTrack& track) {
  while (!track.samples.empty() && !track.samples.back().is_final()) track.samples.pop_back();
  track.answered_frames = std::min(track.answered_frames, static_cast<int64_t>(track.samples.size()));
}

}  // namespace

// Until the frame of a point or an object comes its query_frame lies behind all that came, as no frame of the input has
// a larger number in the session than in the input.
TrackTable::TrackTable(std::vector<StartPoint> points, std::optional<StartObject> object, Direction direction)
    : direction_(direction) {
  if (object) {
    const int64_t query_frame = object->frame;
    object_ = TableObject{*std::move(object), query_frame, {}, 0};
  }
  for (StartPoint& point : points) {
    index_[point.query.id] = tracks_.size();
    const int64_t query_frame = point.frame;
    tracks_.push_back({std::move(point), query_frame, query_frame, {}, 0, 0});
  }
}

void TrackTable::AddFrame(int64_t number, std::optional<absl::Time> capture_time) {
  const auto frame = static_cast<int64_t>(input_frames_.size());
  input_frames_.push_back({number, capture_time});
  if (object_ && object_->start.frame == number) object_->query_frame = frame;
  for (TableTrack& track : tracks_) {
    if (track.start.frame != number) continue;
    track.query_frame = frame;
    track.first_frame = direction_ == Direction::kBoth ? 0 : frame;
  }
}

int64_t TrackTable::Number(int64_t frame) const {
  return frame < static_cast<int64_t>(input_frames_.size()) ? input_frames_[frame].number : frame;
}

std::optional<absl::Time> TrackTable::CaptureTime(int64_t frame) const {
  if (frame >= static_cast<int64_t>(input_frames_.size())) return std::nullopt;
  return input_frames_[frame].capture_time;
}

void TrackTable::RestoreQueries(std::vector<PointRun>& runs) const {
  for (PointRun& run : runs) {
    const auto found = index_.find(run.id);
    if (found == index_.end() || IsOfObject(tracks_[found->second])) continue;
    const TableTrack& track = tracks_[found->second];
    const int64_t at = track.query_frame - run.first_frame;
    if (at < 0 || at >= static_cast<int64_t>(run.x.size())) continue;
    run.x[at] = track.start.query.x;
    run.y[at] = track.start.query.y;
  }
}

absl::Status TrackTable::Apply(const TrackUpdate& update) {
  frames_ = std::max(frames_, update.frames_received);
  for (const PointRun& run : update.runs) {
    if (absl::Status applied = ApplyRun(run, /*backward=*/false); !applied.ok()) return applied;
  }
  for (const ObjectRun& run : update.objects) {
    if (absl::Status applied = ApplyRun(run); !applied.ok()) return applied;
  }
  return absl::OkStatus();
}

absl::Status TrackTable::ApplyBackward(const TrackUpdate& update) {
  for (const PointRun& run : update.runs) {
    if (absl::Status applied = ApplyRun(run, /*backward=*/true); !applied.ok()) return applied;
  }
  return absl::OkStatus();
}

bool TrackTable::IsOfObject(const TableTrack& track) const {
  return object_ && track.start.query.id >= object_->start.first_point;
}

bool TrackTable::WasPlacedAnew(const TableTrack& track) const {
  return IsOfObject(track) && track.start.query.id - object_->start.first_point >= kMaxObjectPoints;
}

const ObjectSample* TrackTable::ObjectEstimate(int64_t frame) const {
  if (!object_) return nullptr;
  const int64_t at = frame - object_->query_frame;
  if (at < 0 || at >= static_cast<int64_t>(object_->samples.size()) || !object_->samples[at]) return nullptr;
  return &*object_->samples[at];
}

std::optional<size_t> TrackTable::Find(const PointRun& run) {
  if (const auto found = index_.find(run.id); found != index_.end()) return found->second;
  if (!BeginsObjectPoint(run)) return std::nullopt;
  const size_t at = tracks_.size();
  index_[run.id] = at;
  TableTrack& track = tracks_.emplace_back();
  track.start = {{run.id, 0, 0}, Number(run.first_frame), absl::StrCat(run.id)};
  track.query_frame = run.first_frame;
  // What lay before a point that was placed anew is its predecessor's.
  track.first_frame = direction_ == Direction::kBoth && !WasPlacedAnew(track) ? 0 : track.query_frame;
  return at;
}

bool TrackTable::BeginsObjectPoint(const PointRun& run) const {
  if (!object_ || run.id < object_->start.first_point) return false;
  if (run.id - object_->start.first_point < kMaxObjectPoints) return run.first_frame == object_->query_frame;
  return run.first_frame > object_->query_frame && index_.contains(run.id - kMaxObjectPoints);
}

void TrackTable::Replace(PointId id) {
  const auto found = index_.find(id);
  if (found == index_.end()) return;
  TableTrack& track = tracks_[found->second];
  track.replaced = true;
  DropVoid(track);
}

absl::Status TrackTable::ApplyRun(const ObjectRun& run) {
  const auto length = static_cast<int64_t>(run.samples.size());
  const int64_t first = object_ ? run.first_frame - object_->query_frame : -1;
  if (first < 0 || run.id != object_->start.query.id || run.first_frame > frames_ - length) {
    return absl::InternalError(absl::StrCat("the tracker answered for object ", run.id, " on frames ", run.first_frame,
                                            "..", run.first_frame + length - 1, ", where it is not"));
  }
  auto& samples = object_->samples;
  samples.resize(std::max(samples.size(), static_cast<size_t>(first + length)));
  for (int64_t i = 0; i < length; ++i) {
    if (first + i >= object_->final_frames) samples[first + i] = run.samples[i];
  }
  if (run.final_count > 0) object_->final_frames = std::max(object_->final_frames, first + run.final_count);
  for (const ObjectSample& sample : run.samples) {
    for (const PointId id : sample.joined) Replace(id - kMaxObjectPoints);
  }
  return absl::OkStatus();
}

absl::Status TrackTable::ApplyRun(const PointRun& run, bool backward) {
  const std::optional<size_t> found = Find(run);
  if (!found)
    return absl::InternalError(absl::StrCat("the tracker answered for point ", run.id, ", which was never sent"));
  TableTrack& track = tracks_[*found];
  const int64_t begin = backward ? track.first_frame : track.query_frame;
  const int64_t end_of_life = backward ? std::min(frames_, track.query_frame) : frames_;
  const auto length = static_cast<int64_t>(run.x.size());
  const int64_t first = run.first_frame - track.first_frame;
  if (run.first_frame < begin || run.first_frame > end_of_life - length) {
    return absl::InternalError(absl::StrCat("the tracker answered for point ", run.id, " on frames ", run.first_frame,
                                            "..", run.first_frame + length - 1, "; it lives on frames ", begin, "..",
                                            end_of_life - 1));
  }
  if (static_cast<int64_t>(track.samples.size()) < first + length) track.samples.resize(first + length);
  for (int64_t i = 0; i < length; ++i) {
    TrackSample& sample = track.samples[first + i];
    const bool is_final = i < run.final_count;
    if (sample.is_final() && !is_final) continue;
    sample = {run.x[i], run.y[i], run.confidence[i], run.visible[i] != 0,
              is_final ? TrackSample::State::kFinal : TrackSample::State::kProvisional};
  }
  if (const TrackSample* placed = Estimate(track, track.query_frame); placed != nullptr && IsOfObject(track)) {
    track.start.query = {run.id, placed->x, placed->y};
  }
  const auto end = static_cast<int64_t>(track.samples.size());
  while (track.final_frames < end && track.samples[track.final_frames].is_final()) ++track.final_frames;
  while (track.answered_frames < end && !track.samples[track.answered_frames].is_absent()) ++track.answered_frames;
  if (track.replaced) DropVoid(track);
  return absl::OkStatus();
}

int64_t TrackTable::final_frames() const {
  int64_t frames = frames_;
  for (const TableTrack& track : tracks_) {
    if (!track.replaced) frames = std::min(frames, track.first_frame + track.final_frames);
  }
  if (object_) frames = std::min(frames, object_->query_frame + object_->final_frames);
  return frames;
}

int64_t TrackTable::estimated_frames() const {
  int64_t frames = 0;
  for (const TableTrack& track : tracks_) {
    if (!track.samples.empty()) {
      frames = std::max(frames, track.first_frame + static_cast<int64_t>(track.samples.size()));
    }
  }
  return frames;
}

int64_t TrackTable::answered_frames() const {
  int64_t frames = frames_;
  for (const TableTrack& track : tracks_) {
    if (!track.replaced) frames = std::min(frames, track.first_frame + track.answered_frames);
  }
  if (object_ && object_->samples.empty()) frames = std::min(frames, object_->query_frame);
  return frames;
}

const TrackSample* TrackTable::Estimate(const TableTrack& track, int64_t frame) {
  const int64_t i = frame - track.first_frame;
  if (i < 0 || i >= static_cast<int64_t>(track.samples.size()) || track.samples[i].is_absent()) return nullptr;
  return &track.samples[i];
}

}  // namespace holdfast
