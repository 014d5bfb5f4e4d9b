// SPDX-License-Identifier: Apache-2.0
#include "server/engine/session_objects.h"

#include <algorithm>
#include <utility>

namespace holdfast {

void SessionObjects::Add(const ObjectQuery& query, int64_t frame, const ObjectShape& shape,
                         absl::Span<const PointQuery> points) {
  groups_.emplace_back(query.id, frame, shape, points, query.reseed ? windows_ : ObjectWindows());
}

std::vector<PointId> SessionObjects::Remove(PointId id, int64_t frame) {
  std::vector<PointId> points;
  if (IsObjectPoint(id)) {
    for (ObjectGroup& group : groups_) {
      if (group.id() != ObjectOf(id)) continue;
      const std::vector<PointId> removed = group.Remove(id, frame);
      points.insert(points.end(), removed.begin(), removed.end());
    }
  }
  if (points.empty()) points.push_back(id);
  return points;
}

void SessionObjects::Close(PointId id, int64_t frame) {
  for (ObjectGroup& group : groups_) group.Close(id, frame);
}

std::vector<ObjectRun> SessionObjects::Report(absl::Span<const PointRun> runs) {
  std::vector<ObjectRun> reports;
  if (groups_.empty()) return reports;
  for (const PointRun& run : runs) {
    if (!IsObjectPoint(run.id)) continue;
    // An object whose id was given anew may not have ended yet: the run is of both, on different frames.
    for (ObjectGroup& group : groups_) {
      if (group.id() == ObjectOf(run.id)) group.Add(run);
    }
  }
  for (ObjectGroup& group : groups_) {
    if (auto report = group.TakeRun(provisional_, newest_)) reports.push_back(*std::move(report));
  }
  groups_.remove_if([](const ObjectGroup& group) { return group.ended(); });
  return reports;
}

std::vector<ObjectState> SessionObjects::StatesBefore(int64_t frame) const {
  std::vector<ObjectState> states;
  for (const ObjectGroup& group : groups_) {
    if (group.query_frame() < frame) states.push_back(group.StateBefore(frame));
  }
  return states;
}

ObjectGroup* SessionObjects::AnyReseeding() {
  const auto found = std::find_if(groups_.begin(), groups_.end(),
                                  [](const ObjectGroup& group) { return group.reseeding().has_value(); });
  return found == groups_.end() ? nullptr : &*found;
}

bool SessionObjects::Holds(PointId id, int64_t frame) const {
  if (!IsObjectPoint(id)) return false;
  return std::any_of(groups_.begin(), groups_.end(),
                     [&](const ObjectGroup& group) { return group.id() == ObjectOf(id) && frame >= group.meeting(); });
}

int64_t SessionObjects::oldest_meeting() const {
  int64_t oldest = ObjectMember::kNever;
  for (const ObjectGroup& group : groups_) oldest = std::min(oldest, group.meeting());
  return oldest;
}

bool SessionObjects::AnyMeeting() const {
  return std::any_of(groups_.begin(), groups_.end(),
                     [this](const ObjectGroup& group) { return group.covered_at_meeting() <= newest_; });
}

bool SessionObjects::WasPlacedAnew(PointId id, int64_t frame) const {
  return std::any_of(groups_.begin(), groups_.end(), [&](const ObjectGroup& group) {
    return group.id() == ObjectOf(id) && group.WasPlacedAnew(id, frame);
  });
}

}  // namespace holdfast
