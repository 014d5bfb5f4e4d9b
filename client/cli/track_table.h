// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/status/status.h"
#include "absl/time/time.h"
#include "api/types.h"
#include "client/cli/point_file.h"
#include "client/cli/point_source.h"

namespace holdfast {

struct TrackSample {
  enum class State : uint8_t { kAbsent, kProvisional, kFinal };
  float x = 0;  // pixels
  float y = 0;  // pixels
  float confidence = 0;
  bool visible = false;
  State state = State::kAbsent;

  bool is_absent() const { return state == State::kAbsent; }
  bool is_final() const { return state == State::kFinal; }
};

// One point's life: samples[i] belongs to frame first_frame + i.
struct TableTrack {
  StartPoint start;         // its frame is the input's
  int64_t query_frame = 0;  // the session's frame that the point starts on
  int64_t first_frame = 0;  // the same, or 0 where the point has started and is tracked backwards too
  std::vector<TrackSample> samples;
  int64_t final_frames = 0;     // the first so many samples are final
  int64_t answered_frames = 0;  // the first so many samples are there
  bool replaced = false;        // another point has taken its place on the object: what is not final is void
};

// An object's life: samples[i] belongs to frame query_frame + i.
struct TableObject {
  StartObject start;        // its frame is the input's
  int64_t query_frame = 0;  // the session's frame that it starts on
  std::vector<std::optional<ObjectSample>> samples;
  int64_t final_frames = 0;  // the first so many samples are final
};

// Joins the runs of a session into one track per point. A provisional estimate never replaces a final one. Not
// thread-safe.
//
// A session counts its frames from 0 without gaps, and so does the table. Which frames of the input these are, AddFrame
// says; without it they are the input's first ones.
class TrackTable {
 public:
  enum class Direction { kForward, kBoth };
  // The points of 'object' join the others when they are first heard of. The object itself is tracked forwards alone.
  explicit TrackTable(std::vector<StartPoint> points, std::optional<StartObject> object = std::nullopt,
                      Direction direction = Direction::kForward);

  // The session's next frame is this one of the input; what starts there starts now.
  // REQUIRES: numbers ascend.
  void AddFrame(int64_t number, std::optional<absl::Time> capture_time = {});
  int64_t input_frames() const { return static_cast<int64_t>(input_frames_.size()); }  // added
  // The input's number of a frame of the session.
  int64_t Number(int64_t frame) const;
  std::optional<absl::Time> CaptureTime(int64_t frame) const;

  // Puts points back where they were given on the frames that they start on: what was sent of them may have been cut
  // off at the border of a smaller picture.
  void RestoreQueries(std::vector<PointRun>& runs) const;

  // INTERNAL when the update speaks of points or frames that the session does not have.
  absl::Status Apply(const TrackUpdate& update);
  // The same for estimates of frames before those that points start on.
  absl::Status ApplyBackward(const TrackUpdate& update);

  const std::vector<TableTrack>& tracks() const { return tracks_; }
  const std::optional<TableObject>& object() const { return object_; }
  // Whether the track is of a point of the object. Such a point starts where the tracker has placed it.
  bool IsOfObject(const TableTrack& track) const;
  // Whether the tracker has placed this point of the object anew, in the place of that of id - kMaxObjectPoints.
  bool WasPlacedAnew(const TableTrack& track) const;
  // Null where nothing was said of it.
  const ObjectSample* ObjectEstimate(int64_t frame) const;
  int64_t frames() const { return frames_; }  // frames the tracker has accepted so far
  // No estimate of frames 0 .. final_frames() - 1 will change or be added any more.
  int64_t final_frames() const;
  // Frames up to the last one of which there is an estimate, final or provisional; 0: there is none.
  int64_t estimated_frames() const;
  // Every point that lives has an estimate on frames 0 .. answered_frames() - 1.
  int64_t answered_frames() const;
  // Null where the point has no estimate.
  static const TrackSample* Estimate(const TableTrack& track, int64_t frame);

 private:
  struct InputFrame {
    int64_t number;
    std::optional<absl::Time> capture_time;
  };
  absl::Status ApplyRun(const PointRun& run, bool backward);
  absl::Status ApplyRun(const ObjectRun& run);
  // The place of its track in tracks_; none: it was never asked for.
  std::optional<size_t> Find(const PointRun& run);
  // Whether it may begin the track of a point of the object.
  bool BeginsObjectPoint(const PointRun& run) const;
  // Another point has taken the place of this one.
  void Replace(PointId id);

  const Direction direction_;
  std::vector<TableTrack> tracks_;
  std::optional<TableObject> object_;
  absl::flat_hash_map<PointId, size_t> index_;
  std::vector<InputFrame> input_frames_;
  int64_t frames_ = 0;
};

}  // namespace holdfast
