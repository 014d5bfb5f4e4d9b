// SPDX-License-Identifier: Apache-2.0
#include "server/engine/resume.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "absl/container/flat_hash_set.h"
#include "absl/strings/str_cat.h"
#include "api/limits.h"

namespace holdfast {
namespace {

// More than any session holds, and few enough for products with the bytes of a frame to fit into 64 bits.
constexpr int64_t kMaxFramesToReplay = int64_t{1} << 17;

absl::Status Mismatch(absl::string_view what, absl::string_view token, absl::string_view here) {
  return absl::FailedPreconditionError(
      absl::StrCat("config.resume_token: made with ", what, " ", token, ", this session has ", here));
}

absl::Status Impossible(absl::string_view what) {
  return absl::FailedPreconditionError(absl::StrCat("config.resume_token: ", what));
}

absl::Status CheckSwitch(absl::string_view name, const std::optional<bool>& wanted, bool token) {
  const auto text = [](bool on) { return on ? "on" : "off"; };
  return !wanted || *wanted == token ? absl::OkStatus() : Mismatch(name, text(token), text(*wanted));
}

absl::Status CheckCount(absl::string_view name, int wanted, int token) {
  return wanted == 0 || wanted == token ? absl::OkStatus() : Mismatch(name, absl::StrCat(token), absl::StrCat(wanted));
}

// A session keeps the hop that it began with, where its bounds allow that.
absl::Status CheckHop(const SessionConfig& config, int token) {
  if (config.max_hop_frames == 0) return CheckCount("hop_frames", config.hop_frames, token);
  if (token >= config.hop_frames && token <= config.max_hop_frames) return absl::OkStatus();
  return Mismatch("hop_frames", absl::StrCat(token), absl::StrCat(config.hop_frames, " .. ", config.max_hop_frames));
}

absl::Status CheckSizes(const SessionConfig& config, const SessionState& state) {
  if (!config.processing_size.empty() && config.processing_size != state.processing_size) {
    return Mismatch("processing_size", ToString(state.processing_size), ToString(config.processing_size));
  }
  if (IsRaw(config.encoding) && config.raw_size != state.frame_size) {
    return Mismatch("frames of", ToString(state.frame_size), ToString(config.raw_size));
  }
  return absl::OkStatus();
}

// The frames that a track still speaks of lie where its windows look for them.
bool FramesArePossible(const TrackState& track, const WindowOptions& windows) {
  const int64_t query = track.seed.frame;
  constexpr int64_t kMost = std::numeric_limits<int64_t>::max() / 4;
  if (query < 0 || track.covered < query || track.covered > kMost) return false;
  if (track.next_start < query || track.next_start > track.covered || (track.next_start - query) % windows.hop != 0) {
    return false;
  }
  const WindowSchedule schedule(windows, query, track.next_start, track.covered);
  const int64_t estimated_before = track.first_kept + static_cast<int64_t>(track.estimates.size());
  return track.first_kept >= query && track.first_kept <= schedule.oldest_start() &&
         track.first_kept <= track.sent_before && track.first_kept <= track.reportable_before &&
         estimated_before == track.covered + 1 && track.final_before > query &&
         track.final_before <= estimated_before && track.reportable_before > query &&
         track.reportable_before <= track.final_before && track.sent_before >= query &&
         track.sent_before <= track.reportable_before;
}

bool IsPossible(const TrackState& track, const WindowOptions& windows, const SessionState& state) {
  if (!FramesArePossible(track, windows)) return false;
  if (track.covered > state.taken_frame || track.next_start < state.next_frame) return false;
  if (track.seed.serial >= state.next_serial) return false;
  if (state.polish && track.reportable_before - 1 < state.next_frame) return false;
  return !track.ending ||
         (track.ending->last_frame <= state.taken_frame && track.ending->last_frame >= track.seed.frame);
}

// The frames that an object still waits for are those that its points will be reported on.
bool IsPossible(const ObjectState& object, const SessionState& state) {
  const int64_t members = static_cast<int64_t>(object.members.size());
  return object.id <= kMaxObjectId && members <= kMaxObjectMembers &&
         object.judgement.standings.size() == object.members.size() && object.query_frame < state.taken_frame &&
         object.next >= object.query_frame && object.next <= state.taken_frame + 1;
}

}  // namespace

absl::StatusOr<SessionConfig> ResumedConfig(const SessionConfig& config, const SessionState& state,
                                            const ModelInfo& model, double least_step) {
  if (state.weights_sha256 != model.weights_sha256) {
    return Mismatch("weights", state.weights_sha256.substr(0, 12), model.weights_sha256.substr(0, 12));
  }
  absl::Status status = CheckSizes(config, state);
  status.Update(CheckHop(config, state.hop_frames));
  status.Update(CheckCount("iterations", config.iterations, state.iterations));
  if (state.least_step.value_or(least_step) != least_step) {
    status.Update(Mismatch("least_step", absl::StrCat(*state.least_step), absl::StrCat(least_step)));
  }
  status.Update(CheckSwitch("motion_prior", config.motion_prior, state.motion_prior));
  status.Update(CheckSwitch("polish", config.polish, state.polish));
  if (config.encoding != state.encoding) status.Update(Impossible("made with frames of another encoding"));
  if (!status.ok()) return status;
  SessionConfig resumed = config;
  resumed.processing_size = state.processing_size;
  resumed.hop_frames = state.hop_frames;
  resumed.max_hop_frames = 0;
  resumed.iterations = state.iterations;
  resumed.motion_prior = state.motion_prior;
  resumed.polish = state.polish;
  resumed.points.clear();
  resumed.objects.clear();
  return resumed;
}

absl::Status CheckState(const SessionState& state, const WindowOptions& windows, int channels) {
  if (state.frame_size.width < 1 || state.frame_size.height < 1) return Impossible("it has no size of frames");
  if (state.next_frame < 0 || state.taken_frame < state.next_frame) return Impossible("its frames are in disorder");
  if (FramesToReplay(state) > kMaxFramesToReplay) return Impossible("it wants too many frames again");
  if (windows.revise_last) return Impossible("this server's chaining of windows has no checkpoints");
  absl::flat_hash_set<uint64_t> serials;
  absl::flat_hash_set<PointId> live;
  for (const SessionState::Track& track : state.tracks) {
    const PointSeed& seed = track.state.seed;
    const bool unique = serials.insert(seed.serial).second && (track.state.ending || live.insert(seed.query.id).second);
    const bool fits = seed.feature.size() == static_cast<size_t>(channels);
    if (!unique || !fits || !IsPossible(track.state, windows, state)) {
      return Impossible(absl::StrCat("its track of point ", seed.query.id, " is impossible"));
    }
  }
  for (const ObjectState& object : state.objects) {
    if (!IsPossible(object, state)) return Impossible(absl::StrCat("its object ", object.id, " is impossible"));
  }
  return absl::OkStatus();
}

int64_t FramesToReplay(const SessionState& state) { return state.taken_frame - state.next_frame + 1; }

SessionInbox::Options::Resumed ResumedInbox(const SessionState& state) {
  SessionInbox::Options::Resumed resumed;
  resumed.next = state.next_frame;
  resumed.taken = state.taken_frame;
  resumed.frame_size = state.frame_size;
  resumed.next_serial = state.next_serial;
  resumed.objects = !state.objects.empty();
  for (const SessionState::Track& track : state.tracks) {
    if (track.state.ending) continue;
    const PointId id = track.state.seed.query.id;
    resumed.ids.insert(resumed.objects && IsObjectPoint(id) ? ObjectPlace(id) : id);
  }
  return resumed;
}

}  // namespace holdfast
