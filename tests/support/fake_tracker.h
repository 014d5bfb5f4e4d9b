// SPDX-License-Identifier: Apache-2.0
// A PointTracker that returns tracks a test has made up, on the caller's thread.
#pragma once

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "api/point_tracker.h"

namespace holdfast {

struct FakeEstimate {
  float x = 0;
  float y = 0;
  bool visible = true;
  float confidence = 1;
};

// Where a point that was given as 'query' in 'query_frame' is said to be in 'frame'.
using FakePath = std::function<FakeEstimate(const PointQuery& query, int64_t query_frame, int64_t frame)>;

// Sends a provisional estimate far from the path for every frame pushed, and the path itself, final, at the end. Places
// three points on an object, at (1, 1), (2, 1) and (3, 1), says that it goes one pixel to the right each frame, from
// (2, 1), and that the second of them has left it.
class FakeTracker final : public PointTracker {
 public:
  struct Behaviour {
    FakePath path;
    ImageSize default_processing_size = {512, 384};
    int64_t fail_at_frame = -1;        // PushFrame of this index ends the session with UNAVAILABLE; -1: never
    int64_t final_frames_missing = 0;  // so many frames at the end of every track never become final
    int max_objects = kMaxObjects;     // 0: it knows none
  };

  explicit FakeTracker(Behaviour behaviour) : behaviour_(std::move(behaviour)) {}

  absl::StatusOr<std::unique_ptr<TrackStream>> Open(const SessionConfig& config, TrackObserver& observer) override {
    configs_.push_back(config);
    frames_.clear();
    return std::make_unique<Stream>(*this, config, observer);
  }
  absl::StatusOr<TrackerInfo> Info() override { return TrackerInfo{}; }

  const std::vector<SessionConfig>& configs() const { return configs_; }  // of every session opened
  const std::vector<Frame>& frames() const { return frames_; }            // of the last session

 private:
  class Stream final : public TrackStream {
   public:
    Stream(FakeTracker& tracker, const SessionConfig& config, TrackObserver& observer)
        : tracker_(tracker), observer_(observer) {
      SessionAccepted accepted;
      accepted.processing_size =
          config.processing_size.empty() ? tracker.behaviour_.default_processing_size : config.processing_size;
      accepted.hop_frames = std::max(config.hop_frames, config.max_hop_frames);
      accepted.limits.max_objects = tracker.behaviour_.max_objects;
      observer_.OnAccepted(accepted);
      Query(config.points, 0);
      QueryObjects(config.objects, 0);
    }
    ~Stream() override { Cancel(); }

    absl::Status PushFrame(Frame frame) override {
      if (frame.index == tracker_.behaviour_.fail_at_frame)
        return Done(absl::UnavailableError("the tracker went away"));
      Query(frame.points, frame.index);
      QueryObjects(frame.objects, frame.index);
      tracker_.frames_.push_back(std::move(frame));
      TrackUpdate update;
      update.frames_received = update.frames_processed = Frames();
      for (const auto& [id, query] : queries_) update.runs.push_back(Run(query, 1, /*final=*/false));
      observer_.OnTracks(std::move(update));
      return absl::OkStatus();
    }
    absl::Status AddPoints(std::vector<PointQuery> points) override {
      Query(points, std::max<int64_t>(0, Frames() - 1));
      return absl::OkStatus();
    }
    absl::Status RemovePoints(std::vector<PointId> ids) override {
      for (PointId id : ids) queries_.erase(id);
      return absl::OkStatus();
    }
    absl::Status Finish() override {
      TrackUpdate update;
      update.frames_received = update.frames_processed = Frames();
      for (const auto& [id, query] : queries_) {
        const int64_t frames = Frames() - query.frame;
        update.runs.push_back(Run(query, frames, /*final=*/true));
        update.runs.back().final_count = std::max<int64_t>(0, frames - tracker_.behaviour_.final_frames_missing);
      }
      for (const auto& [id, frame] : objects_) update.objects.push_back(RunOfObject(id, frame));
      observer_.OnTracks(std::move(update));
      return Done(absl::OkStatus());
    }
    void Cancel() override {
      if (!done_) Done(absl::CancelledError("cancelled")).IgnoreError();
    }

   private:
    struct PlacedQuery {
      PointQuery point;
      int64_t frame = 0;
    };

    int64_t Frames() const { return static_cast<int64_t>(tracker_.frames_.size()); }

    void Query(const std::vector<PointQuery>& points, int64_t frame) {
      for (const PointQuery& point : points) queries_[point.id] = {point, frame};
    }

    void QueryObjects(const std::vector<ObjectQuery>& objects, int64_t frame) {
      for (const ObjectQuery& object : objects) {
        objects_[object.id] = frame;
        for (uint32_t i = 0; i < 3; ++i) Query({{ObjectPointId(object.id, i), 1.0f + static_cast<float>(i), 1}}, frame);
      }
    }

    ObjectRun RunOfObject(ObjectId id, int64_t frame) const {
      ObjectRun run{id, frame, {}, std::max<int64_t>(0, Frames() - frame - tracker_.behaviour_.final_frames_missing)};
      for (int64_t t = 0; t < Frames() - frame; ++t) {
        const float x = 2 + static_cast<float>(t);
        run.samples.push_back({{x, 1}, 1, 0, 1, {{x, 0}, {x + 2, 2}, {x, 2}}, {ObjectPointId(id, 1)}});
      }
      return run;
    }

    // The newest 'frames' frames of a track.
    PointRun Run(const PlacedQuery& query, int64_t frames, bool final) const {
      PointRun run;
      run.id = query.point.id;
      run.first_frame = Frames() - frames;
      for (int64_t frame = run.first_frame; frame < Frames(); ++frame) {
        const FakeEstimate estimate = tracker_.behaviour_.path(query.point, query.frame, frame);
        run.x.push_back(final ? estimate.x : estimate.x + 1000);
        run.y.push_back(estimate.y);
        run.visible.push_back(estimate.visible);
        run.confidence.push_back(final ? estimate.confidence : 1);
      }
      return run;
    }

    absl::Status Done(absl::Status status) {
      done_ = true;
      observer_.OnDone(status, SessionSummary{});
      return status;
    }

    FakeTracker& tracker_;
    TrackObserver& observer_;
    std::map<PointId, PlacedQuery> queries_;
    std::map<ObjectId, int64_t> objects_;  // the frames they were queried at
    bool done_ = false;
  };

  const Behaviour behaviour_;
  std::vector<SessionConfig> configs_;
  std::vector<Frame> frames_;
};

}  // namespace holdfast
