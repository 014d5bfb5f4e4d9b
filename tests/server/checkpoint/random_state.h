// SPDX-License-Identifier: Apache-2.0
// States that a session could have, made up.
#pragma once

#include <cstdint>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "server/engine/motion/patch_coding.h"
#include "server/engine/session_state.h"

namespace holdfast {

struct RandomStateOptions {
  int tracks = 3;
  int channels = 128;
  bool patches = false;
  int objects = 0;
};

// Numbers as videos and networks have them: templates are spread normally, points move a little from frame to frame,
// grey levels of a patch vary smoothly with some noise. The older of 24 to 31 estimates are final and polished.
class RandomState {
 public:
  explicit RandomState(uint32_t seed) : random_(seed) {}

  SessionState Session(const RandomStateOptions& options) {
    SessionState state;
    state.weights_sha256 = std::string(64, 'b');
    state.encoding = static_cast<FrameEncoding>(Below(5));
    state.frame_size = {1920, 1080};
    state.processing_size = {512, 384};
    state.hop_frames = 8;
    state.iterations = 4;
    state.least_step = 0.5;
    state.motion_prior = Below(2) == 0;
    state.polish = Below(2) == 0;
    state.next_frame = 1000 + Below(1000);
    state.taken_frame = state.next_frame + 30;
    state.next_serial = options.tracks + Below(100);
    state.summary = {state.next_frame, options.tracks + 7, 123456789012};
    for (int i = 0; i < options.tracks; ++i) state.tracks.push_back(Track(i, options));
    for (int i = 0; i < options.objects; ++i) state.objects.push_back(Object(static_cast<ObjectId>(i)));
    return state;
  }

 private:
  int Below(int n) { return static_cast<int>(random_() % n); }
  float Uniform(float low, float high) { return std::uniform_real_distribution<float>(low, high)(random_); }
  float Normal(float mean, float deviation) { return std::normal_distribution<float>(mean, deviation)(random_); }

  SessionState::Track Track(int serial, const RandomStateOptions& options) {
    SessionState::Track track;
    TrackState& state = track.state;
    state.seed.serial = serial;
    state.seed.query = {random_() * uint64_t{random_()}, Uniform(0, 1919), Uniform(0, 1079)};
    state.seed.frame = 900 + Below(50);
    state.seed.position = {Uniform(0, 64), Uniform(0, 48)};
    for (int c = 0; c < options.channels; ++c) state.seed.feature.push_back(Normal(0, 1));
    AddEstimates(state);
    if (Below(4) == 0) state.ending = TrackState::Ending{state.first_kept + 30, state.first_kept + 31};
    if (Below(4) != 0) state.previous = Position{Uniform(0, 64), Uniform(0, 48)};
    if (Below(4) != 0) state.deformation = {Uniform(0.8F, 1.2F), Uniform(-0.2F, 0.2F), Uniform(-0.2F, 0.2F), 1};
    if (options.patches) track.patch = Patch();
    return track;
  }

  Pixel Place() { return {Uniform(0, 1919), Uniform(0, 1079)}; }

  ObjectState Object(ObjectId id) {
    ObjectState state;
    state.id = id;
    state.query_frame = 900 + Below(50);
    state.next = state.query_frame + 1 + Below(50);
    state.reseeds = Below(2) == 0;
    state.shape.centre = Place();
    state.shape.size = Uniform(5, 500);
    for (int i = Below(32); i > 0; --i) state.shape.outline.push_back(Place());
    state.judgement.motion = {Uniform(0.5F, 2), Uniform(-1, 1), Uniform(-9, 9), 1.0 / 3};
    for (uint32_t i = 0; i < 6; ++i) {
      ObjectMember& member = state.members.emplace_back(Member(ObjectPointId(id, i), state.next));
      member.queried = state.query_frame;
      if (Below(3) == 0) member.queried += Below(static_cast<int>(state.next - state.query_frame));
    }
    for (int i = 0; i < 6; ++i) state.judgement.standings.push_back({Below(2) == 0, Below(4)});
    return state;
  }

  ObjectMember Member(PointId id, int64_t next) {
    ObjectMember member;
    member.id = id;
    member.home = Place();
    if (Below(3) == 0) member.end = next + Below(9);
    for (int i = Below(5); i > 0; --i) member.samples.push_back({Place(), Below(2) == 0});
    member.final_before = next + static_cast<int64_t>(member.samples.size());
    return member;
  }

  void AddEstimates(TrackState& state) {
    state.first_kept = state.seed.frame + int64_t{8} * Below(5);
    const int count = 24 + Below(8);
    const int polished = count - 23;
    Position at = state.seed.position;
    for (int i = 0; i < count; ++i) {
      at = {at.x + Normal(0, .2F), at.y + Normal(0, .2F)};
      EstimateState estimate;
      estimate.position = estimate.shown = at;
      estimate.visibility_logit = Below(8) == 0 ? std::numeric_limits<float>::quiet_NaN() : Coarse(Normal(2, 2));
      estimate.similarity = Coarse(Uniform(.5F, 1));
      estimate.last_step = Coarse(Uniform(0, .5F));
      estimate.seen = Below(8) != 0;
      if (i < polished && estimate.seen) {
        estimate.shown = {at.x + Normal(0, .05F), at.y + Normal(0, .05F)};
        estimate.polish = static_cast<Evidence::Polish>(Below(4));
      }
      state.estimates.push_back(estimate);
    }
    state.sent_before = state.first_kept + polished - Below(2);
    state.reportable_before = state.final_before = state.first_kept + polished;
    state.lost_windows = Below(2) == 0 ? 0 : Below(1000);
    state.next_start = state.first_kept + 8;
    state.covered = state.first_kept + count - 1;
  }

  SessionState::Patch Patch() {
    std::vector<uint8_t> pixels;
    float level = Uniform(50, 200);
    for (int i = 0; i < FlowPatch::kSide * FlowPatch::kSide; ++i) {
      level = std::min(255.F, std::max(0.F, level + Normal(0, 4)));
      pixels.push_back(static_cast<uint8_t>(level));
    }
    return {{Uniform(0, 63), Uniform(0, 63)}, EncodePatch(pixels)};
  }

  std::mt19937 random_;
};

// Every bit that a state consists of, one after the other: states are the same when these are.
class StateBits {
 public:
  static std::string Of(const SessionState& state) {
    StateBits bits;
    bits.Add(state.weights_sha256.size(), state.encoding, state.frame_size.width, state.frame_size.height,
             state.processing_size.width, state.processing_size.height, state.hop_frames, state.iterations,
             state.least_step.value_or(-1), state.motion_prior, state.polish, state.next_frame, state.taken_frame,
             state.next_serial, state.summary.frames, state.summary.points, state.summary.final_samples,
             state.tracks.size());
    bits.bits_ += state.weights_sha256;
    for (const SessionState::Track& track : state.tracks) bits.AddTrack(track);
    for (const ObjectState& object : state.objects) bits.AddObject(object);
    return bits.bits_;
  }

 private:
  template <typename... Values>
  void Add(const Values&... values) {
    (bits_.append(reinterpret_cast<const char*>(&values), sizeof(values)), ...);
  }
  void AddTrack(const SessionState::Track& track) {
    const TrackState& s = track.state;
    Add(s.seed.serial, s.seed.query.id, s.seed.query.x, s.seed.query.y, s.seed.frame, s.seed.position,
        s.seed.feature.size(), s.next_start, s.covered, s.first_kept, s.estimates.size(), s.final_before,
        s.reportable_before, s.sent_before, s.lost_windows, s.ending.has_value(), s.previous.has_value(),
        track.patch.has_value());
    for (const float value : s.seed.feature) Add(value);
    for (const EstimateState& e : s.estimates) {
      Add(e.position, e.shown, e.visibility_logit, e.similarity, e.last_step, e.polish, e.seen);
    }
    if (s.ending) Add(s.ending->last_frame, s.ending->stop);
    if (s.previous) Add(*s.previous);
    Add(s.deformation.xx, s.deformation.xy, s.deformation.yx, s.deformation.yy);
    if (track.patch) Add(track.patch->at, track.patch->code.size());
    if (track.patch) bits_.append(track.patch->code);
  }

  void AddObject(const ObjectState& o) {
    const Similarity& motion = o.judgement.motion;
    Add(o.id, o.query_frame, o.next, o.shape.centre, o.shape.size, o.shape.outline.size(), motion.a, motion.b,
        motion.tx, motion.ty, o.members.size(), o.judgement.standings.size(), o.reseeds);
    for (const Pixel& corner : o.shape.outline) Add(corner);
    for (const ObjectJudgement::Standing& standing : o.judgement.standings) Add(standing.left, standing.contrary);
    for (const ObjectMember& member : o.members) {
      Add(member.id, member.home, member.queried, member.end, member.final_before, member.samples.size());
      for (const ObjectMember::Sample& sample : member.samples) Add(sample.at, sample.visible);
    }
  }

  std::string bits_;
};

}  // namespace holdfast
