// SPDX-License-Identifier: Apache-2.0
#include "server/engine/tracks/point_track.h"

#include <algorithm>
#include <utility>

namespace holdfast {
namespace {

// Windows in a row after which a point that was not found is looked for once in so many only.
constexpr int64_t kEagerWindows = 8;
constexpr int64_t kPatientWindows = 4;

}  // namespace

PointTrack::PointTrack(PointSeed seed, const WindowOptions& windows, const ConfidenceRule& rule)
    : seed_(std::move(seed)),
      rule_(rule),
      window_frames_(windows.frames),
      polish_(windows.polish),
      schedule_(windows, seed_.frame),
      estimates_{Estimate{seed_.position, seed_.position}},
      first_kept_(seed_.frame),
      final_before_(seed_.frame + 1),
      reportable_before_(seed_.frame + 1),
      previous_(seed_.position),
      sent_before_(seed_.frame) {}

PointTrack::PointTrack(TrackState state, const WindowOptions& windows, const ConfidenceRule& rule,
                       const FrameGeometry& geometry)
    : seed_(std::move(state.seed)),
      rule_(rule),
      window_frames_(windows.frames),
      polish_(windows.polish),
      schedule_(windows, seed_.frame, state.next_start, state.covered),
      first_kept_(state.first_kept),
      final_before_(state.final_before),
      reportable_before_(state.reportable_before),
      previous_(state.previous),
      deformation_(state.deformation),
      sent_before_(state.sent_before),
      lost_windows_(state.lost_windows) {
  if (state.ending) End(state.ending->last_frame, state.ending->stop);
  for (const EstimateState& estimate : state.estimates) {
    estimates_.push_back(Restored(estimate, estimated_before(), geometry));
  }
}

PointTrack::Estimate PointTrack::Restored(const EstimateState& state, int64_t frame,
                                          const FrameGeometry& geometry) const {
  Estimate estimate{state.position, state.shown};
  if (frame == seed_.frame) return estimate;  // the query itself is nobody's estimate
  estimate.evidence = {state.visibility_logit, state.similarity, state.last_step, frame - seed_.frame, state.polish};
  estimate.seen = state.seen;
  Weigh(estimate, geometry);
  return estimate;
}

TrackState PointTrack::state() const {
  TrackState state;
  state.seed = seed_;
  state.next_start = schedule_.next_start();
  state.covered = schedule_.covered();
  if (ending_) state.ending = TrackState::Ending{last_frame_, stop_};
  state.first_kept = first_kept_;
  for (const Estimate& estimate : estimates_) {
    const Evidence& evidence = estimate.evidence;
    state.estimates.push_back({estimate.position, estimate.shown, evidence.visibility_logit, evidence.similarity,
                               evidence.last_step, evidence.polish, estimate.seen});
  }
  state.final_before = final_before_;
  state.reportable_before = reportable_before_;
  state.previous = previous_;
  state.deformation = deformation_;
  state.sent_before = sent_before_;
  state.lost_windows = lost_windows_;
  return state;
}

void PointTrack::End(int64_t last_frame, int64_t stop) {
  ending_ = true;
  last_frame_ = last_frame;
  stop_ = stop;
}

std::optional<WindowPlan> PointTrack::Due(int64_t newest, bool stream_ended) const {
  if (!ending_) return schedule_.Next(newest, stream_ended);
  if (final_before_ >= stop_) return std::nullopt;  // nothing of it would be reported
  if (auto plan = schedule_.Next(std::min(newest, last_frame_), /*ended=*/false)) return plan;
  return over(newest) || stream_ended ? schedule_.Next(last_frame_, /*ended=*/true) : std::nullopt;
}

int64_t PointTrack::oldest_frame_needed() const {
  const int64_t next = schedule_.next_start();
  return ending_ ? std::clamp(last_frame_ - window_frames_ + 1, seed_.frame, next) : next;
}

WindowRow PointTrack::Row(const WindowPlan& plan, absl::Span<const Position> carried) const {
  WindowRow row;
  row.feature = seed_.feature;
  row.start.reserve(window_frames_);
  const int64_t known_before = plan.from_query ? seed_.frame + 1 : estimated_before();
  const auto carried_frames = static_cast<int64_t>(carried.size());
  for (int64_t frame = plan.first; frame < plan.first + window_frames_; ++frame) {
    if (frame < known_before || carried.empty()) {
      row.start.push_back(plan.from_query ? seed_.position : At(std::min(frame, known_before - 1)).position);
    } else {
      row.start.push_back(carried[std::min(frame - known_before, carried_frames - 1)]);
    }
  }
  if (!plan.from_query && !carried_.f2.empty()) row.carried = &carried_;
  return row;
}

void PointTrack::Apply(const WindowPlan& plan, RowEstimate row, const FrameGeometry& geometry) {
  for (int64_t frame = std::max(plan.first, final_before_); frame <= plan.last; ++frame) {
    const Estimate estimate = Judge(row, plan, frame, geometry);
    if (frame < estimated_before()) {
      estimates_[frame - first_kept_] = estimate;
    } else {
      estimates_.push_back(estimate);
    }
  }
  final_before_ = std::max(final_before_, plan.final_before);
  if (!polish_) reportable_before_ = final_before_;
  if (plan.kind == WindowKind::kFull) {
    carried_ = std::move(row.templates);
    lost_windows_ = newest_assurance() < kDoubtBelow ? lost_windows_ + 1 : 0;
  }
  schedule_.Ran(plan);
}

float PointTrack::newest_assurance() const {
  return estimated_before() == seed_.frame + 1 ? 1 : rule_.Assurance(estimates_.back().evidence);
}

bool PointTrack::worth_a_search() const {
  return lost_windows_ < kEagerWindows || lost_windows_ % kPatientWindows == 0;
}

void PointTrack::Finalize() {
  final_before_ = estimated_before();
  if (!polish_) reportable_before_ = final_before_;
}

PointTrack::Unpolished PointTrack::unpolished() const {
  Unpolished unpolished;
  unpolished.first = reportable_before_;
  unpolished.previous = previous_;
  unpolished.deformation = deformation_;
  for (int64_t frame = reportable_before_; frame < std::min(final_before_, stop_); ++frame) {
    unpolished.positions.push_back(At(frame).position);
    unpolished.visible.push_back(At(frame).seen ? 1 : 0);
  }
  return unpolished;
}

void PointTrack::Polish(absl::Span<const Polished> polished, const Deformation& deformation,
                        const FrameGeometry& geometry) {
  deformation_ = deformation;
  for (const Polished& result : polished) {
    Estimate& estimate = estimates_[reportable_before_ - first_kept_];
    estimate.shown = result.position;
    previous_ = estimate.seen ? std::optional<Position>(result.position) : std::nullopt;
    estimate.evidence.polish = result.outcome;
    Weigh(estimate, geometry);
    ++reportable_before_;
  }
}

std::optional<PointRun> PointTrack::TakeRun(bool provisional, const FrameGeometry& geometry) {
  const int64_t final_end = std::min(reportable_before_, stop_);
  const int64_t end = provisional ? std::min(estimated_before(), stop_) : final_end;
  if (end <= sent_before_) return std::nullopt;
  PointRun run;
  run.id = id();
  run.first_frame = sent_before_;
  run.final_count = std::max<int64_t>(final_end - sent_before_, 0);
  for (int64_t frame = sent_before_; frame < end; ++frame) Append(frame, run, geometry);
  if (rule_.sink != nullptr) {
    for (int64_t frame = std::max(sent_before_, seed_.frame + 1); frame < final_end; ++frame) {
      (*rule_.sink)(id(), frame, At(frame).evidence);
    }
  }
  sent_before_ = std::max(sent_before_, final_end);
  Trim();
  return run;
}

PointTrack::Estimate PointTrack::Judge(const RowEstimate& row, const WindowPlan& plan, int64_t frame,
                                       const FrameGeometry& geometry) const {
  const int64_t at = frame - plan.first;
  Estimate estimate;
  estimate.position = estimate.shown = row.positions[at];
  if (!row.visibility_logit.empty()) estimate.evidence.visibility_logit = Coarse(row.visibility_logit[at]);
  estimate.evidence.similarity = Coarse(row.similarity[at]);
  estimate.evidence.last_step = Coarse(row.last_step[at]);
  estimate.evidence.age = frame - seed_.frame;
  estimate.seen = NetworkConfidence(estimate.evidence) > kVisibleAbove && geometry.Inside(estimate.position);
  Weigh(estimate, geometry);
  return estimate;
}

void PointTrack::Weigh(Estimate& estimate, const FrameGeometry& geometry) const {
  estimate.confidence = rule_.Confidence(estimate.evidence);
  estimate.visible = estimate.confidence > rule_.visible_above() && geometry.Inside(estimate.shown);
}

void PointTrack::Append(int64_t frame, PointRun& run, const FrameGeometry& geometry) const {
  const Estimate& estimate = At(frame);
  const bool queried = frame == seed_.frame;  // reported exactly as it was given
  run.x.push_back(queried ? seed_.query.x : geometry.ToFrameX(estimate.shown));
  run.y.push_back(queried ? seed_.query.y : geometry.ToFrameY(estimate.shown));
  run.visible.push_back(estimate.visible ? 1 : 0);
  run.confidence.push_back(estimate.confidence);
}

void PointTrack::Trim() {
  const int64_t keep = std::min({schedule_.oldest_start(), sent_before_, reportable_before_});
  while (first_kept_ < keep && estimates_.size() > 1) {
    estimates_.pop_front();
    ++first_kept_;
  }
}

}  // namespace holdfast
