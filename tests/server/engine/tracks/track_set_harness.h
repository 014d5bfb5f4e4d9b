// SPDX-License-Identifier: Apache-2.0
// Tracks of a session over a network whose answers are known by hand.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "server/engine/tracks/track_set.h"
#include "tests/support/fake_tracker_model.h"

namespace holdfast {

// What the sink was told.
struct Heard {
  PointId id = 0;
  int64_t frame = 0;
  Evidence evidence;
};

// A session without threads: frames arrive, whatever is due runs, runs are collected.
class TrackSetHarness {
 public:
  explicit TrackSetHarness(WindowOptions windows, bool provisional = true, const Calibration* calibration = nullptr)
      : sink_([this](PointId id, int64_t frame, const Evidence& evidence) {
          heard_.push_back({id, frame, evidence});
        }),
        tracks_(windows, provisional, {calibration, &sink_}) {
    tracks_.SetGeometry(FrameGeometry({640, 320}, {320, 160}, 8));  // a feature pixel is 16 pixels of the frame
  }
  TrackSet& tracks() { return tracks_; }
  FakeTrackerModel& model() { return model_; }

  void Frame() {
    const RgbImage image{{1, 1}, {static_cast<uint8_t>(frames_++), 0, 0}};
    const RgbImage* images[] = {&image};
    tracks_.AddFrame(model_.Encode(images).front());
  }
  void Seed(PointId id, float x = 160, float y = 80) {
    const Position at = tracks_.geometry().ToFeatures(x, y);
    const auto feature = model_.Sample(*tracks_.cache().At(frames_ - 1), {&at, 1}).front();
    tracks_.Seed({seeds_++, {id, x, y}, frames_ - 1, at, feature});
  }
  void RunDue(bool ended = false) {
    for (auto rows = tracks_.Due(ended); !rows.empty(); rows = tracks_.Due(ended)) {
      for (const DueRow& row : rows) {
        const WindowGroup group = tracks_.Group({&row, 1});
        for (const auto& frame : group.frames) used_.push_back(FakeTrackerModel::ValueOf(*frame));
        Collect(tracks_.Apply(row, model_.Refine({&group, 1}, {}).front()));
      }
    }
    Collect(tracks_.TakeEnded());
    tracks_.Evict();
  }
  void FramesAndRun(int64_t count) {
    for (int64_t i = 0; i < count; ++i) {
      Frame();
      RunDue();
    }
  }
  void Finish() {
    RunDue(/*ended=*/true);
    Collect(tracks_.FinishAll());
  }
  // Polishes whatever waits for it; the pictures say 'outcome' of each frame that is not hidden, and move it by 'move'
  // feature pixels to the right.
  void Polish(const std::function<Evidence::Polish(int64_t frame)>& outcome, float move = 0) {
    for (PointTrack* track : tracks_.Unpolished()) {
      const PointTrack::Unpolished given = track->unpolished();
      std::vector<PointTrack::Polished> polished;
      for (size_t i = 0; i < given.positions.size(); ++i) {
        const Position at = given.positions[i];
        if (given.visible[i] != 0) {
          polished.push_back({{at.x + move, at.y}, outcome(given.first + static_cast<int64_t>(i))});
        } else {
          polished.push_back({at, Evidence::Polish::kNotTried});
        }
      }
      Collect(tracks_.Polish(*track, polished, {}));
    }
  }
  // The frames the sink heard of.
  std::vector<int64_t> HeardFrames(PointId id) const {
    std::vector<int64_t> frames;
    for (const Heard& heard : heard_) {
      if (heard.id == id) frames.push_back(heard.frame);
    }
    return frames;
  }
  const std::vector<Heard>& heard() const { return heard_; }
  const std::vector<PointRun>& runs() const { return runs_; }
  const std::vector<int>& used() const { return used_; }

 private:
  void Collect(std::vector<PointRun> runs) {
    for (PointRun& run : runs) runs_.push_back(std::move(run));
  }
  void Collect(std::optional<PointRun> run) {
    if (run) runs_.push_back(*std::move(run));
  }
  FakeTrackerModel model_;
  std::vector<Heard> heard_;
  const EvidenceSink sink_;
  TrackSet tracks_;
  int64_t frames_ = 0;
  uint64_t seeds_ = 0;
  std::vector<PointRun> runs_;
  std::vector<int> used_;  // values of the frames refined on
};

// Checks that runs are well-formed and every frame becomes final once, in order; the final x by frame.
inline std::map<int64_t, float> FinalX(const std::vector<PointRun>& runs, PointId id) {
  std::map<int64_t, float> finals;
  for (const PointRun& run : runs) {
    if (run.id != id) continue;
    EXPECT_THAT(run.y, ::testing::SizeIs(run.x.size()));
    EXPECT_THAT(run.visible, ::testing::SizeIs(run.x.size()));
    EXPECT_THAT(run.confidence, ::testing::SizeIs(run.x.size()));
    EXPECT_LE(run.final_count, static_cast<int64_t>(run.x.size()));
    if (!finals.empty()) {
      EXPECT_EQ(run.first_frame, finals.rbegin()->first + 1);
    }
    for (int64_t i = 0; i < run.final_count; ++i) {
      EXPECT_TRUE(finals.emplace(run.first_frame + i, run.x[i]).second) << "final twice";
    }
  }
  return finals;
}

inline std::vector<int64_t> FramesFrom(int64_t first, int64_t last) {
  std::vector<int64_t> frames(static_cast<size_t>(last - first + 1));
  std::iota(frames.begin(), frames.end(), first);
  return frames;
}

}  // namespace holdfast
