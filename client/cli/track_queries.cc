// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_queries.h"

#include <algorithm>

#include "api/limits.h"

namespace holdfast {

absl::StatusOr<TrackQueries> TrackQueries::Create(const TrackOptions& options, const FrameEncoder& encoder,
                                                  const std::vector<StartPoint>& points,
                                                  std::optional<StartObject> object) {
  TrackQueries queries(options, encoder.sent_size(), std::move(object));
  for (const StartPoint& point : points) {
    queries.starts_[point.frame].push_back(encoder.ToSent(point.query));
    queries.frames_.insert(point.frame);
  }
  if (queries.object_) {
    absl::StatusOr<ObjectQuery> sent = encoder.ToSent(queries.object_->query);
    if (!sent.ok()) return sent.status();
    queries.sent_object_ = *std::move(sent);
    queries.frames_.insert(queries.object_->frame);
  }
  return queries;
}

SessionConfig TrackQueries::Config() const {
  SessionConfig config;
  config.encoding = FrameEncoding::kJpeg;
  config.frame_size = sent_size_;
  config.processing_size = options_->processing_size;
  config.hop_frames = options_->hop.least;
  config.max_hop_frames = options_->hop.most;
  config.iterations = options_->iterations;
  config.send_provisional = true;  // kept where the session ends before they are final
  config.emit = options_->live ? Emit::kEveryFrame : Emit::kWindows;
  config.points = PointsOf(options_->start_frame);
  config.objects = ObjectsOf(options_->start_frame);
  config.frames_per_second = options_->promise_fps;
  config.label = "holdfast track";
  if (options_->promise_fps > 0) config.expected_points = static_cast<int>(CountPointsFrom(0)) + ObjectPoints();
  return config;
}

SessionConfig TrackQueries::BackwardConfig(size_t points) const {
  SessionConfig config = Config();
  config.objects.clear();
  if (options_->promise_fps > 0) config.expected_points = static_cast<int>(points);
  config.label = "holdfast track --both";
  return config;
}

std::vector<PointQuery> TrackQueries::PointsOf(int64_t frame) const {
  const auto found = starts_.find(frame);
  return found == starts_.end() ? std::vector<PointQuery>() : found->second;
}

std::vector<ObjectQuery> TrackQueries::ObjectsOf(int64_t frame) const {
  return object_ && object_->frame == frame ? std::vector<ObjectQuery>{sent_object_} : std::vector<ObjectQuery>();
}

size_t TrackQueries::CountPointsFrom(int64_t frame) const {
  size_t points = 0;
  for (auto it = starts_.lower_bound(frame); it != starts_.end(); ++it) points += it->second.size();
  return points;
}

void TrackQueries::NameObjectPoints(TrackUpdate& update) const {
  if (!object_) return;
  const auto name = [this](PointId& id) {
    if (IsObjectPoint(id)) id = object_->first_point + (id - ObjectPointId(ObjectOf(id), 0));
  };
  for (PointRun& run : update.runs) name(run.id);
  for (ObjectRun& run : update.objects) {
    for (ObjectSample& sample : run.samples) {
      std::for_each(sample.left.begin(), sample.left.end(), name);
      std::for_each(sample.joined.begin(), sample.joined.end(), name);
    }
  }
}

int TrackQueries::ObjectPoints() const {
  if (!object_) return 0;
  return object_->query.points > 0 ? object_->query.points : kDefaultObjectPoints;
}

}  // namespace holdfast
