// SPDX-License-Identifier: Apache-2.0
#include "server/engine/session_objects.h"

#include <utility>

namespace holdfast {

void SessionObjects::Remove(PointId id, int64_t frame) {
  if (!IsObjectPoint(id)) return;
  for (ObjectGroup& group : groups_) group.Remove(id, frame);
}

void SessionObjects::Close(PointId id, int64_t frame) {
  for (ObjectGroup& group : groups_) {
    if (group.query_frame() == frame) group.Close(id);
  }
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
    if (auto report = group.TakeRun(provisional_)) reports.push_back(*std::move(report));
  }
  groups_.remove_if([](const ObjectGroup& group) { return group.ended(); });
  return reports;
}

std::vector<ObjectState> SessionObjects::StatesBefore(int64_t frame) const {
  std::vector<ObjectState> states;
  for (const ObjectGroup& group : groups_) {
    if (group.query_frame() >= frame) continue;
    ObjectState& state = states.emplace_back(group.state());
    for (ObjectMember& member : state.members) {
      if (member.end == frame + 1 && !member.closed) member.end = ObjectMember::kNever;  // it comes again
    }
  }
  return states;
}

}  // namespace holdfast
