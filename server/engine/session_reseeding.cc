// SPDX-License-Identifier: Apache-2.0
#include "server/engine/session_reseeding.h"

#include <utility>
#include <vector>

#include "server/engine/objects/reseeding.h"

namespace holdfast {

void SeedTracks(absl::Span<const PointOp> seeds, TrackerModel& model, TrackSet& tracks) {
  std::vector<Position> positions;
  for (const PointOp& seed : seeds) positions.push_back(tracks.geometry().ToFeatures(seed.query.x, seed.query.y));
  std::vector<std::vector<float>> features = model.Sample(*tracks.cache().At(seeds.front().frame), positions);
  for (size_t i = 0; i < seeds.size(); ++i) {
    tracks.Seed({seeds[i].serial, seeds[i].query, seeds[i].frame, positions[i], std::move(features[i])});
  }
}

std::optional<int64_t> SessionReseeding::Run(SessionObjects& objects, TrackerModel& model) {
  std::optional<int64_t> points;
  while (ObjectGroup* group = objects.AnyReseeding()) points = points.value_or(0) + Reseed(*group, model);
  return points;
}

int64_t SessionReseeding::Reseed(ObjectGroup& group, TrackerModel& model) {
  const Reseeding& reseeding = *group.reseeding();
  const int64_t frame = reseeding.frame, stop = group.covered_at_meeting() + 1;
  // A session that was resumed with an impossible object may not have the frame.
  const FeatureCache& cache = tracks_.cache();
  const bool there = frame >= cache.oldest() && frame <= cache.newest();
  std::vector<Pixel> places;
  if (there) places = PlaceAnew(reseeding, PictureOf(frame), inbox_.frame_size());
  uint64_t serial = inbox_.TakeSerials(static_cast<int64_t>(places.size()));
  std::vector<PointOp> seeds, removals;
  for (const ObjectGroup::Reseeded& made : group.Reseed(places)) {
    seeds.push_back({PointOp::Kind::kSeed, frame, made.point, serial++, 1});
    if (tracks_.Stop(made.before, made.before_queried, stop)) {
      removals.push_back({PointOp::Kind::kRemove, stop - 1, {made.before}});
    }
    if (made.removed_after) removals.push_back({PointOp::Kind::kRemove, *made.removed_after, {made.point.id}});
  }
  if (seeds.empty()) return 0;
  SeedTracks(seeds, model, tracks_);
  for (const PointOp& removal : removals) tracks_.Remove(removal.query.id, removal.frame);
  if (flow_ != nullptr) {
    flow_->Apply(seeds);
    flow_->Apply(removals);
  }
  return static_cast<int64_t>(seeds.size());
}

GrayImage SessionReseeding::PictureOf(int64_t frame) const {
  if (flow_ != nullptr) {
    if (const FlowPyramidPtr pyramid = flow_->PictureOf(frame)) return pyramid->picture();
  }
  const ImageSize size = FlowSize(inbox_.frame_size(), processing_);
  return {size, std::vector<uint8_t>(static_cast<size_t>(Pixels(size)))};
}

}  // namespace holdfast
