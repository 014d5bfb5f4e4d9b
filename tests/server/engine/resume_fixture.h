// SPDX-License-Identifier: Apache-2.0
// For tests of sessions that go on where others were.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/server/engine/engine_fixture.h"
#include "tests/support/memory_sealer.h"
#include "tests/support/moving_picture.h"

namespace holdfast {

inline constexpr int64_t kFrames = 64;
inline constexpr PointId kIds[] = {1, 2, 3, 4, 5};

using Tracks = std::map<PointId, FinalTrack>;

// The first difference, if there is one.
inline std::string Difference(const Tracks& tracks, const Tracks& expected) {
  for (const PointId id : kIds) {
    const FinalTrack &a = tracks.at(id), &b = expected.at(id);
    for (int64_t frame = 0; frame < kFrames; ++frame) {
      const auto in_a = a.find(frame), in_b = b.find(frame);
      const bool same = (in_a == a.end()) == (in_b == b.end()) && (in_a == a.end() || in_a->second == in_b->second);
      if (same) continue;
      std::string text = absl::StrCat("point ", id, ", frame ", frame, ":");
      for (const auto& [found, track] : {std::make_pair(in_a, &a), std::make_pair(in_b, &b)}) {
        const bool there = found != track->end();
        absl::StrAppend(&text, " ", there ? absl::StrCat(found->second.x, ",", found->second.y) : "nothing");
      }
      return text;
    }
  }
  return "";
}

// What a client says: points that come and go before the first window is full, in the middle, and near the end. The
// world is hidden for a while, and has jumped when it comes back.
struct Script {
  static std::vector<PointQuery> AtFirst() { return {{1, 40.5f, 50.25f}, {2, 80, 30}}; }
  static constexpr int64_t kHidden = 26, kShown = 29;
  static FlowPoint ShiftAt(int64_t index) {
    const auto t = static_cast<float>(index);
    return index < kHidden ? FlowPoint{0.75f * t, 0.25f * t} : FlowPoint{0.75f * t + 12, 0.25f * t - 6};
  }
  static const std::string& PictureAt(int64_t index) {
    static auto& made = *new std::map<int64_t, std::string>();
    std::string& picture = made[index];
    if (!picture.empty()) return picture;
    const FlowPoint shift = ShiftAt(index);
    GrayImage shown = ShiftedTexture(kPicture, shift.x, shift.y);
    if (index >= kHidden && index < kShown) Cover(shown, 0, kPicture.width, /*seed=*/9);
    return picture = BytesOf(shown);
  }
  static Frame At(int64_t index) {
    Frame frame{index, PictureAt(index), {}, {}};
    if (index == 5) frame.points = {{3, 60, 40}};
    if (index == 33) frame.points = {{1, 70, 45}};  // again
    if (index == 58) frame.points = {{5, 64, 48}};
    return frame;
  }
  static void After(int64_t index, EngineSession& session) {
    if (index == 10) {
      EXPECT_THAT(session.AddPoints({{4, 50, 60}}), IsOk());
    }
    if (index == 20) {
      EXPECT_THAT(session.RemovePoints({2}), IsOk());
    }
    if (index == 40) {
      EXPECT_THAT(session.RemovePoints({3, 99}), IsOk());
    }
    if (index == 40) {
      EXPECT_THAT(session.AddPoints({{3, 30, 30}, {2, 90, 60}}), IsOk());
    }
  }
};

class ResumeTest : public EngineTest {
 protected:
  ResumeTest() {
    options_.sealer = &sealer_;
    model_->keep_starts = true;
    model_->step = 0.03f;
  }
  // A session that is over may still be sealing a checkpoint.
  ~ResumeTest() override { engine_.reset(); }

  static SessionConfig MakeConfig(int hop = 8) {
    SessionConfig config = Config(Script::AtFirst(), hop);
    config.raw_size = config.processing_size = kPicture;
    config.checkpoint_interval_frames = 4;
    return config;
  }

  static void Say(EngineSession& session, RecordingListener& listener, int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      ASSERT_THAT(listener.Push(session, Script::At(i)), IsOk());
      Script::After(i, session);
    }
  }

  static Tracks FinalsOf(const RecordingListener& listener) {
    Tracks tracks;
    for (const PointId id : kIds) tracks[id] = listener.Final(id);
    return tracks;
  }

  Tracks Uninterrupted(const SessionConfig& config, int64_t frames = kFrames) {
    RecordingListener listener;
    auto session = Open(config, listener);
    Say(*session, listener, 0, frames);
    session->Finish();
    EXPECT_THAT(listener.AwaitDone(), IsOk());
    points_ = listener.summary().points;
    return FinalsOf(listener);
  }

  // A session that has come well into the stream, suspended.
  std::vector<Checkpoint> SuspendAt50(RecordingListener& listener) {
    auto session = Open(MakeConfig(), listener);
    Say(*session, listener, 0, 50);
    listener.AwaitFinal(4, 17);
    session->Suspend(absl::UnavailableError("going away"));
    EXPECT_THAT(listener.AwaitDone(), StatusIs(absl::StatusCode::kUnavailable));
    return listener.checkpoints();
  }

  // Adds what comes again and what is new; what comes again is the same.
  static void Merge(const Tracks& more, Tracks& tracks) {
    for (const auto& [id, track] : more) {
      for (const auto& [frame, sample] : track) {
        const auto [place, inserted] = tracks[id].emplace(frame, sample);
        EXPECT_TRUE(place->second == sample) << "point " << id << ", frame " << frame;
      }
    }
  }

  // Says everything again from the newest checkpoint on, up to 'end'; without a checkpoint, from the beginning.
  std::unique_ptr<EngineSession> Resume(SessionConfig config, const std::vector<Checkpoint>& checkpoints,
                                        RecordingListener& listener, int64_t end) {
    int64_t begin = 0;
    if (!checkpoints.empty()) {
      config.resume_token = checkpoints.back().token;
      begin = checkpoints.back().next_frame;
    }
    auto session = Open(config, listener);
    EXPECT_EQ(session->accepted().first_frame, begin);
    Say(*session, listener, begin, end);
    return session;
  }

  // The newest, for whoever looks for a difference.
  std::string Describe(const std::vector<Checkpoint>& checkpoints) const {
    if (checkpoints.empty()) return "no checkpoint";
    const SessionState state = *sealer_.Unseal(checkpoints.back().token);
    std::string text = absl::StrCat("checkpoint of frame ", state.taken_frame, ", on with ", state.next_frame, ":");
    for (const SessionState::Track& track : state.tracks) {
      absl::StrAppend(&text, " ", track.state.seed.query.id, "@", track.state.seed.frame, " covered ",
                      track.state.covered, track.state.ending ? " ending" : "");
    }
    return text;
  }

  MemorySealer sealer_;
  int64_t points_ = 0;
};

}  // namespace holdfast
