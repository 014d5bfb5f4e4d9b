// SPDX-License-Identifier: Apache-2.0
#include "server/checkpoint/state_convert.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/base/casts.h"
#include "absl/container/flat_hash_set.h"
#include "absl/strings/str_cat.h"
#include "server/checkpoint/object_convert.h"

namespace holdfast {
namespace {

namespace v1 = checkpoint::v1;

constexpr uint32_t kMaxNumber = 1 << 20;         // of sides, hops and iterations
constexpr int64_t kMaxFrame = int64_t{1} << 60;  // far from where sums of frames would overflow
constexpr int64_t kMaxCount = int64_t{1} << 60;  // of what a session counts on from, likewise
constexpr size_t kMaxChecksumBytes = 128;        // of the weights
constexpr absl::string_view kFine = "";          // what is wrong: nothing

using Polish = Evidence::Polish;

constexpr std::pair<FrameEncoding, v1::FrameEncoding> kEncodings[] = {
    {FrameEncoding::kJpeg, v1::FRAME_ENCODING_JPEG},   {FrameEncoding::kPng, v1::FRAME_ENCODING_PNG},
    {FrameEncoding::kRgb24, v1::FRAME_ENCODING_RGB24}, {FrameEncoding::kBgr24, v1::FRAME_ENCODING_BGR24},
    {FrameEncoding::kGray8, v1::FRAME_ENCODING_GRAY8},
};
constexpr std::pair<Polish, v1::Polish> kPolishes[] = {
    {Polish::kNotTried, v1::POLISH_NOT_TRIED},
    {Polish::kFromQuery, v1::POLISH_FROM_QUERY},
    {Polish::kFromBefore, v1::POLISH_FROM_BEFORE},
    {Polish::kNotFound, v1::POLISH_NOT_FOUND},
};

// REQUIRES: 'value' is in the table.
template <typename Plain, typename Message, size_t n>
Message EnumToProto(const std::pair<Plain, Message> (&table)[n], Plain value) {
  return std::find_if(table, table + n, [value](const auto& row) { return row.first == value; })->second;
}

// Null: there is no such value.
template <typename Plain, typename Message, size_t n>
const Plain* EnumFromProto(const std::pair<Plain, Message> (&table)[n], int value) {
  const auto* const found = std::find_if(table, table + n, [value](const auto& row) { return row.second == value; });
  return found == table + n ? nullptr : &found->first;
}

void ToProto(Position position, v1::Position* out) {
  out->set_x(position.x);
  out->set_y(position.y);
}

Position FromProto(const v1::Position& position) { return {position.x(), position.y()}; }

void ToProto(const Deformation& shape, v1::Deformation* out) {
  out->set_xx(shape.xx);
  out->set_xy(shape.xy);
  out->set_yx(shape.yx);
  out->set_yy(shape.yy);
}

Deformation FromProto(const v1::Deformation& shape) { return {shape.xx(), shape.xy(), shape.yx(), shape.yy()}; }

bool IsFinite(const v1::Position& position) { return std::isfinite(position.x()) && std::isfinite(position.y()); }

template <typename Repeated>
bool AllFinite(const Repeated& values) {
  return std::all_of(values.begin(), values.end(), [](float value) { return std::isfinite(value); });
}

// Unlike ==, tells -0 from 0.
bool SameBits(float a, float b) { return absl::bit_cast<uint32_t>(a) == absl::bit_cast<uint32_t>(b); }

// ToProto

// How many estimates, from the first one on, say themselves where they are shown: only polished ones, which are old,
// are shown elsewhere than at their position.
size_t CountShown(const std::vector<EstimateState>& estimates) {
  size_t count = estimates.size();
  const auto at_position = [](const EstimateState& estimate) {
    return SameBits(estimate.shown.x, estimate.position.x) && SameBits(estimate.shown.y, estimate.position.y);
  };
  while (count > 0 && at_position(estimates[count - 1])) --count;
  return count;
}

void EstimatesToProto(const std::vector<EstimateState>& estimates, v1::Track* out) {
  for (const EstimateState& estimate : estimates) {
    out->add_position_x(estimate.position.x);
    out->add_position_y(estimate.position.y);
    out->add_visibility_logit(estimate.visibility_logit);
    out->add_similarity(estimate.similarity);
    out->add_last_step(estimate.last_step);
    out->add_polish(EnumToProto(kPolishes, estimate.polish));
    out->add_seen(estimate.seen);
  }
  for (size_t i = 0; i < CountShown(estimates); ++i) {
    out->add_shown_x(estimates[i].shown.x);
    out->add_shown_y(estimates[i].shown.y);
  }
}

void ToProto(const PointSeed& seed, v1::Track* out) {
  out->set_serial(seed.serial);
  out->set_point_id(seed.query.id);
  ToProto({seed.query.x, seed.query.y}, out->mutable_query());
  out->set_query_frame(seed.frame);
  ToProto(seed.position, out->mutable_position());
  out->mutable_feature()->Add(seed.feature.begin(), seed.feature.end());
}

void ToProto(const SessionState::Track& track, v1::Track* out) {
  const TrackState& state = track.state;
  ToProto(state.seed, out);
  out->set_next_start(state.next_start);
  out->set_covered(state.covered);
  if (state.ending) {
    out->mutable_ending()->set_last_frame(state.ending->last_frame);
    out->mutable_ending()->set_stop(state.ending->stop);
  }
  out->set_final_before(state.final_before);
  out->set_reportable_before(state.reportable_before);
  if (state.previous) ToProto(*state.previous, out->mutable_previous());
  if (!(state.deformation == Deformation())) ToProto(state.deformation, out->mutable_deformation());
  out->set_sent_before(state.sent_before);
  out->set_lost_windows(state.lost_windows);
  out->set_first_kept(state.first_kept);
  EstimatesToProto(state.estimates, out);
  if (track.patch) {
    ToProto({track.patch->at.x, track.patch->at.y}, out->mutable_patch()->mutable_at());
    out->mutable_patch()->set_code(track.patch->code);
  }
}

// Checks. Each says what is wrong, or kFine.

absl::string_view FaultOfEstimates(const v1::Track& track) {
  const int count = track.position_x_size();
  if (count == 0) return "there are no estimates";
  for (const int size : {track.position_y_size(), track.visibility_logit_size(), track.similarity_size(),
                         track.last_step_size(), track.polish_size(), track.seen_size()}) {
    if (size != count) return "the estimates' values are not equally many";
  }
  if (track.shown_x_size() != track.shown_y_size() || track.shown_x_size() > count) {
    return "there are more shown positions than estimates";
  }
  if (!AllFinite(track.position_x()) || !AllFinite(track.position_y()) || !AllFinite(track.shown_x()) ||
      !AllFinite(track.shown_y())) {
    return "an estimate's position is not finite";
  }
  for (const int polish : track.polish()) {
    if (EnumFromProto(kPolishes, polish) == nullptr) return "an estimate's polish is unknown";
  }
  return kFine;
}

// What the arithmetic of windows and runs counts on.
absl::string_view FaultOfFrames(const v1::Track& track) {
  const int64_t query = track.query_frame();
  const int64_t kept = track.first_kept();
  if (query < 0 || kept < query || kept > kMaxFrame) return "its first estimate is before its query";
  const int64_t end = kept + track.position_x_size();
  if (track.next_start() < kept || track.covered() < query ||
      std::max(track.next_start(), track.covered()) > kMaxFrame) {
    return "its next window begins before its first estimate";
  }
  if (track.final_before() > end || track.reportable_before() > track.final_before() ||
      track.sent_before() > track.reportable_before() || track.sent_before() < kept) {
    return "its final, polished and sent frames are not in their order";
  }
  if (track.lost_windows() < 0 || track.lost_windows() > kMaxFrame) return "it was lost for no number of windows";
  if (!track.has_ending()) return kFine;
  const int64_t first = std::min(track.ending().last_frame(), track.ending().stop());
  const int64_t last = std::max(track.ending().last_frame(), track.ending().stop());
  return first < -1 || last > kMaxFrame ? "it ends at no frame" : kFine;
}

absl::string_view FaultOfPatch(const v1::Patch& patch) {
  if (patch.code().size() > FlowPatch::kMaxCodeBytes) return "its patch is too large";
  return IsFinite(patch.at()) ? kFine : "its patch's position is not finite";
}

absl::string_view FaultOf(const v1::Track& track) {
  if (!IsFinite(track.query()) || !IsFinite(track.position()) || !IsFinite(track.previous())) {
    return "its position is not finite";
  }
  if (track.has_deformation() && !Plausible(FromProto(track.deformation()))) {
    return "its surroundings cannot have deformed so";
  }
  if (const absl::string_view fault = FaultOfEstimates(track); fault != kFine) return fault;
  if (const absl::string_view fault = FaultOfFrames(track); fault != kFine) return fault;
  return track.has_patch() ? FaultOfPatch(track.patch()) : kFine;
}

absl::string_view FaultOfOptions(const v1::SessionState& message) {
  if (message.weights_sha256().size() > kMaxChecksumBytes) return "the weights' checksum is too long";
  if (EnumFromProto(kEncodings, message.encoding()) == nullptr) return "the encoding of frames is unknown";
  if (std::max(message.frame_width(), message.frame_height()) > kMaxNumber) return "the size of frames is too large";
  for (const uint32_t number :
       {message.processing_width(), message.processing_height(), message.hop_frames(), message.iterations()}) {
    if (number < 1 || number > kMaxNumber) return "processing size, hop or iterations are out of range";
  }
  return kFine;
}

absl::string_view FaultOfCounts(const v1::SessionState& message) {
  if (message.next_frame() < 0 || message.next_frame() > kMaxFrame) return "the next frame is out of range";
  if (message.taken_frame() < -1 || message.taken_frame() > kMaxFrame) return "the frame taken is out of range";
  for (const int64_t count : {message.summary_frames(), message.summary_points(), message.summary_final_samples()}) {
    if (count < 0 || count > kMaxCount) return "the summary is out of range";
  }
  if (message.next_serial() > uint64_t{kMaxCount}) return "the next serial is out of range";
  return kFine;
}

absl::Status Malformed(absl::string_view fault) {
  return absl::FailedPreconditionError(absl::StrCat("the checkpoint's state is malformed: ", fault));
}

absl::Status Check(const v1::SessionState& message) {
  for (const absl::string_view fault : {FaultOfOptions(message), FaultOfCounts(message)}) {
    if (fault != kFine) return Malformed(fault);
  }
  absl::flat_hash_set<uint64_t> serials;
  for (int i = 0; i < message.tracks_size(); ++i) {
    const v1::Track& track = message.tracks(i);
    absl::string_view fault = FaultOf(track);
    if (!serials.insert(track.serial()).second || track.serial() >= message.next_serial()) {
      fault = "its serial is another one's";
    } else if (track.feature_size() != message.tracks(0).feature_size()) {
      fault = "its template is of another length";
    }
    if (fault != kFine) return Malformed(absl::StrCat("track ", i, ": ", fault));
  }
  for (int i = 0; i < message.objects_size(); ++i) {
    const absl::string_view fault = FaultOfObject(message.objects(i));
    if (fault != kFine) return Malformed(absl::StrCat("object ", i, ": ", fault));
  }
  return absl::OkStatus();
}

// FromProto, of what was checked.

std::vector<EstimateState> EstimatesFromProto(const v1::Track& track) {
  std::vector<EstimateState> estimates(track.position_x_size());
  for (int i = 0; i < track.position_x_size(); ++i) {
    EstimateState& estimate = estimates[i];
    estimate.position = {track.position_x(i), track.position_y(i)};
    estimate.shown = i < track.shown_x_size() ? Position{track.shown_x(i), track.shown_y(i)} : estimate.position;
    estimate.visibility_logit = track.visibility_logit(i);
    estimate.similarity = track.similarity(i);
    estimate.last_step = track.last_step(i);
    estimate.polish = *EnumFromProto(kPolishes, track.polish(i));
    estimate.seen = track.seen(i);
  }
  return estimates;
}

PointSeed SeedFromProto(const v1::Track& track) {
  PointSeed seed;
  seed.serial = track.serial();
  seed.query = {track.point_id(), track.query().x(), track.query().y()};
  seed.frame = track.query_frame();
  seed.position = FromProto(track.position());
  seed.feature.assign(track.feature().begin(), track.feature().end());
  return seed;
}

SessionState::Track TrackFromProto(const v1::Track& track) {
  SessionState::Track out;
  TrackState& state = out.state;
  state.seed = SeedFromProto(track);
  state.next_start = track.next_start();
  state.covered = track.covered();
  if (track.has_ending()) state.ending = {track.ending().last_frame(), track.ending().stop()};
  state.final_before = track.final_before();
  state.reportable_before = track.reportable_before();
  if (track.has_previous()) state.previous = FromProto(track.previous());
  if (track.has_deformation()) state.deformation = FromProto(track.deformation());
  state.sent_before = track.sent_before();
  state.lost_windows = track.lost_windows();
  state.first_kept = track.first_kept();
  state.estimates = EstimatesFromProto(track);
  if (track.has_patch()) {
    const v1::Patch& patch = track.patch();
    out.patch = {{patch.at().x(), patch.at().y()}, patch.code()};
  }
  return out;
}

}  // namespace

v1::SessionState ToProto(const SessionState& state) {
  v1::SessionState out;
  out.set_weights_sha256(state.weights_sha256);
  out.set_encoding(EnumToProto(kEncodings, state.encoding));
  out.set_frame_width(state.frame_size.width);
  out.set_frame_height(state.frame_size.height);
  out.set_processing_width(state.processing_size.width);
  out.set_processing_height(state.processing_size.height);
  out.set_hop_frames(state.hop_frames);
  out.set_iterations(state.iterations);
  if (state.least_step) out.set_least_step(*state.least_step);
  out.set_motion_prior(state.motion_prior);
  out.set_polish(state.polish);
  out.set_next_frame(state.next_frame);
  out.set_taken_frame(state.taken_frame);
  out.set_next_serial(state.next_serial);
  out.set_summary_frames(state.summary.frames);
  out.set_summary_points(state.summary.points);
  out.set_summary_final_samples(state.summary.final_samples);
  for (const SessionState::Track& track : state.tracks) ToProto(track, out.add_tracks());
  for (const ObjectState& object : state.objects) ObjectToProto(object, out.add_objects());
  return out;
}

absl::StatusOr<SessionState> FromProto(const v1::SessionState& message) {
  if (absl::Status status = Check(message); !status.ok()) return status;
  SessionState state;
  state.weights_sha256 = message.weights_sha256();
  state.encoding = *EnumFromProto(kEncodings, message.encoding());
  state.frame_size = {static_cast<int>(message.frame_width()), static_cast<int>(message.frame_height())};
  state.processing_size = {static_cast<int>(message.processing_width()), static_cast<int>(message.processing_height())};
  state.hop_frames = static_cast<int>(message.hop_frames());
  state.iterations = static_cast<int>(message.iterations());
  if (message.has_least_step()) state.least_step = message.least_step();
  state.motion_prior = message.motion_prior();
  state.polish = message.polish();
  state.next_frame = message.next_frame();
  state.taken_frame = message.taken_frame();
  state.next_serial = message.next_serial();
  state.summary = {message.summary_frames(), message.summary_points(), message.summary_final_samples()};
  state.tracks.reserve(message.tracks_size());
  for (const v1::Track& track : message.tracks()) state.tracks.push_back(TrackFromProto(track));
  for (const v1::Object& object : message.objects()) state.objects.push_back(ObjectFromProto(object));
  return state;
}

}  // namespace holdfast
