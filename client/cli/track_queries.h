// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "api/types.h"
#include "client/cli/point_file.h"
#include "client/cli/point_source.h"
#include "client/cli/track_command.h"
#include "client/cli/video.h"

namespace holdfast {

// What a run asks a tracker for: its session, and what starts on each frame, in pixels of the sent pictures. Frames
// have the numbers of the input.
class TrackQueries {
 public:
  // The options must outlive it. REQUIRES: there is a point or an object.
  static absl::StatusOr<TrackQueries> Create(const TrackOptions& options, const FrameEncoder& encoder,
                                             const std::vector<StartPoint>& points, std::optional<StartObject> object);

  SessionConfig Config() const;
  // Of a session that follows so many points, but no object, to the frames before their queries.
  SessionConfig BackwardConfig(size_t points) const;

  const std::set<int64_t>& frames() const { return frames_; }  // that something starts on; not empty
  std::vector<PointQuery> PointsOf(int64_t frame) const;
  std::vector<ObjectQuery> ObjectsOf(int64_t frame) const;
  bool has_object() const { return object_.has_value(); }
  // What starts on this frame or later.
  size_t CountPointsFrom(int64_t frame) const;
  bool ObjectIsFrom(int64_t frame) const { return object_ && object_->frame >= frame; }

  // The object's points get the small ids that they have in outputs.
  void NameObjectPoints(TrackUpdate& update) const;

 private:
  TrackQueries(const TrackOptions& options, ImageSize sent_size, std::optional<StartObject> object)
      : options_(&options), sent_size_(sent_size), object_(std::move(object)) {}
  int ObjectPoints() const;

  const TrackOptions* options_;
  ImageSize sent_size_;  // of every frame
  std::optional<StartObject> object_;
  ObjectQuery sent_object_;
  std::map<int64_t, std::vector<PointQuery>> starts_;
  std::set<int64_t> frames_;
};

}  // namespace holdfast
