// SPDX-License-Identifier: Apache-2.0
// What the server answers.
#include <cstdint>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/convert.h"
#include "proto/convert_values.h"

namespace holdfast {
namespace {

using internal::SizeFromProto;
using internal::SizeToProto;

constexpr uint32_t kMaxFrames = 1 << 20;         // of a window, or to be kept
constexpr int64_t kMaxFrame = int64_t{1} << 60;  // far from where the end of a run would overflow

void LimitsToProto(const SessionLimits& limits, v1::SessionLimits* out) {
  out->set_max_points(limits.max_points);
  out->set_max_frame_bytes(limits.max_frame_bytes);
  out->set_max_frame_pixels(limits.max_frame_pixels);
  out->set_max_frames(limits.max_frames);
  out->set_max_objects(static_cast<uint32_t>(limits.max_objects));
}

SessionLimits LimitsFromProto(const v1::SessionLimits& limits) {
  return {static_cast<int>(limits.max_points()), static_cast<int64_t>(limits.max_frame_bytes()),
          static_cast<int64_t>(limits.max_frame_pixels()), static_cast<int64_t>(limits.max_frames()),
          static_cast<int>(limits.max_objects())};
}

void RunToProto(const PointRun& run, v1::PointRun* out) {
  out->set_id(run.id);
  out->set_first_frame(run.first_frame);
  out->mutable_x()->Add(run.x.begin(), run.x.end());
  out->mutable_y()->Add(run.y.begin(), run.y.end());
  out->mutable_visible()->Add(run.visible.begin(), run.visible.end());
  out->mutable_confidence()->Add(run.confidence.begin(), run.confidence.end());
  out->set_final_count(static_cast<uint32_t>(run.final_count));
}

absl::StatusOr<PointRun> RunFromProto(const v1::PointRun& run) {
  const int length = run.x_size();
  if (length == 0 || run.y_size() != length || run.visible_size() != length || run.confidence_size() != length ||
      run.final_count() > static_cast<uint32_t>(length) || run.first_frame() < 0 || run.first_frame() > kMaxFrame) {
    return absl::InternalError(absl::StrCat("the server sent a malformed run of point ", run.id()));
  }
  return PointRun{run.id(),
                  run.first_frame(),
                  {run.x().begin(), run.x().end()},
                  {run.y().begin(), run.y().end()},
                  {run.visible().begin(), run.visible().end()},
                  {run.confidence().begin(), run.confidence().end()},
                  run.final_count()};
}

}  // namespace

v1::SessionAccepted ToProto(const SessionAccepted& accepted) {
  v1::SessionAccepted out;
  out.set_session_id(accepted.session_id);
  SizeToProto(accepted.processing_size, out.mutable_processing_size());
  out.set_hop_frames(accepted.hop_frames);
  out.set_iterations(accepted.iterations);
  out.set_window_frames(accepted.window_frames);
  LimitsToProto(accepted.limits, out.mutable_limits());
  out.set_emit(internal::EmitToProto(accepted.emit));
  out.set_motion_prior(accepted.motion_prior);
  out.set_polish(accepted.polish);
  out.set_first_frame(accepted.first_frame);
  out.set_checkpoint_interval_frames(accepted.checkpoint_interval_frames);
  out.set_replay_frames(accepted.replay_frames);
  out.set_trace_id(accepted.trace_id);
  return out;
}

absl::StatusOr<SessionAccepted> FromProto(const v1::SessionAccepted& accepted) {
  if (accepted.window_frames() < 2 || accepted.window_frames() > kMaxFrames || accepted.hop_frames() < 1 ||
      accepted.hop_frames() >= accepted.window_frames() || accepted.first_frame() < 0 ||
      accepted.checkpoint_interval_frames() > kMaxFrames || accepted.replay_frames() > kMaxFrames) {
    return absl::InternalError("the server sent a malformed SessionAccepted");
  }
  SessionAccepted out;
  out.session_id = accepted.session_id();
  out.processing_size = SizeFromProto(accepted.processing_size());
  out.hop_frames = static_cast<int>(accepted.hop_frames());
  out.iterations = static_cast<int>(accepted.iterations());
  out.window_frames = static_cast<int>(accepted.window_frames());
  out.limits = LimitsFromProto(accepted.limits());
  out.emit = accepted.emit() == v1::EMIT_EVERY_FRAME ? Emit::kEveryFrame : Emit::kWindows;
  out.motion_prior = accepted.motion_prior();
  out.polish = accepted.polish();
  out.first_frame = accepted.first_frame();
  out.checkpoint_interval_frames = static_cast<int>(accepted.checkpoint_interval_frames());
  out.replay_frames = static_cast<int>(accepted.replay_frames());
  out.trace_id = accepted.trace_id();
  return out;
}

v1::Checkpoint ToProto(Checkpoint checkpoint) {
  v1::Checkpoint out;
  out.set_token(std::move(checkpoint.token));
  out.set_next_frame(checkpoint.next_frame);
  out.set_resumable(checkpoint.resumable);
  return out;
}

absl::StatusOr<Checkpoint> FromProto(v1::Checkpoint&& checkpoint) {
  if (checkpoint.next_frame() < 0) return absl::InternalError("the server sent a malformed Checkpoint");
  return Checkpoint{std::move(*checkpoint.mutable_token()), checkpoint.next_frame(), checkpoint.resumable()};
}

v1::GoingAway GoingAwayToProto(absl::Duration time_left) {
  v1::GoingAway out;
  internal::DurationToProto(time_left, out.mutable_time_left());
  return out;
}

absl::Duration FromProto(const v1::GoingAway& going_away) {
  return internal::DurationFromProto(going_away.time_left());
}

v1::Tracks ToProto(const TrackUpdate& update) {
  v1::Tracks out;
  out.mutable_runs()->Reserve(static_cast<int>(update.runs.size()));
  for (const PointRun& run : update.runs) RunToProto(run, out.add_runs());
  out.set_frames_received(update.frames_received);
  out.set_frames_processed(update.frames_processed);
  for (const FrameTime& time : update.capture_times) {
    v1::FrameTime* added = out.add_capture_times();
    added->set_frame(time.frame);
    internal::TimeToProto(time.capture_time, added->mutable_capture_time());
  }
  for (const ObjectRun& run : update.objects) internal::ObjectRunToProto(run, out.add_objects());
  return out;
}

absl::StatusOr<TrackUpdate> FromProto(const v1::Tracks& tracks) {
  TrackUpdate out;
  out.runs.reserve(tracks.runs_size());
  for (const v1::PointRun& run : tracks.runs()) {
    absl::StatusOr<PointRun> converted = RunFromProto(run);
    if (!converted.ok()) return converted.status();
    out.runs.push_back(*std::move(converted));
  }
  out.frames_received = tracks.frames_received();
  out.frames_processed = tracks.frames_processed();
  for (const v1::FrameTime& time : tracks.capture_times()) {
    const std::optional<absl::Time> captured = internal::TimeFromProto(time.capture_time());
    if (!captured)
      return absl::InternalError(absl::StrCat("the server sent a wrong capture time of frame ", time.frame()));
    out.capture_times.push_back({time.frame(), *captured});
  }
  for (const v1::ObjectRun& run : tracks.objects()) {
    absl::StatusOr<ObjectRun> converted = internal::ObjectRunFromProto(run);
    if (!converted.ok()) return converted.status();
    out.objects.push_back(*std::move(converted));
  }
  return out;
}

v1::SessionSummary ToProto(const SessionSummary& summary) {
  v1::SessionSummary out;
  out.set_frames(summary.frames);
  out.set_points(summary.points);
  out.set_final_samples(summary.final_samples);
  return out;
}

SessionSummary FromProto(const v1::SessionSummary& summary) {
  return {summary.frames(), summary.points(), summary.final_samples()};
}

v1::GetServerInfoResponse ToProto(const TrackerInfo& info) {
  v1::GetServerInfoResponse out;
  out.set_model_name(info.model_name);
  out.set_preset(info.preset);
  out.set_weights_sha256(info.weights_sha256);
  out.set_precision(info.precision);
  out.set_device(info.device);
  out.set_build(info.build);
  SizeToProto(info.default_processing_size, out.mutable_default_processing_size());
  out.set_window_frames(info.window_frames);
  out.set_default_hop_frames(info.default_hop_frames);
  out.set_default_iterations(info.default_iterations);
  out.set_max_sessions(info.max_sessions);
  LimitsToProto(info.limits, out.mutable_limits());
  out.set_default_motion_prior(info.default_motion_prior);
  out.set_default_polish(info.default_polish);
  out.set_calibrated_confidence(info.calibrated_confidence);
  v1::ServerLoad& load = *out.mutable_load();
  load.set_sessions(info.load.sessions);
  load.set_points(info.load.points);
  load.set_work_promised(info.load.work_promised);
  load.set_work_budget(info.load.work_budget);
  load.set_frame_work(info.load.frame_work);
  return out;
}

absl::StatusOr<TrackerInfo> FromProto(const v1::GetServerInfoResponse& info) {
  TrackerInfo out;
  out.model_name = info.model_name();
  out.preset = info.preset();
  out.weights_sha256 = info.weights_sha256();
  out.precision = info.precision();
  out.device = info.device();
  out.build = info.build();
  out.default_processing_size = SizeFromProto(info.default_processing_size());
  out.window_frames = static_cast<int>(info.window_frames());
  out.default_hop_frames = static_cast<int>(info.default_hop_frames());
  out.default_iterations = static_cast<int>(info.default_iterations());
  out.max_sessions = static_cast<int>(info.max_sessions());
  out.limits = LimitsFromProto(info.limits());
  out.default_motion_prior = info.default_motion_prior();
  out.default_polish = info.default_polish();
  out.calibrated_confidence = info.calibrated_confidence();
  const v1::ServerLoad& load = info.load();
  out.load = {static_cast<int>(load.sessions()), static_cast<int64_t>(load.points()), load.work_promised(),
              load.work_budget(), load.frame_work()};
  if (out.window_frames < 2) return absl::InternalError("the server sent a malformed GetServerInfoResponse");
  return out;
}

}  // namespace holdfast
