// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <list>
#include <vector>

#include "absl/types/span.h"
#include "api/types.h"
#include "server/engine/objects/object_group.h"
#include "server/engine/objects/object_state.h"

namespace holdfast {

// The objects of a session: what is reported of their points, on its way out, makes what is reported of them. Not
// thread-safe.
class SessionObjects {
 public:
  // 'provisional': estimates that are not final are reported too. 'windows': those of the session's points.
  SessionObjects(bool provisional, const ObjectWindows& windows) : provisional_(provisional), windows_(windows) {}

  // 'points' were placed on 'shape' at 'frame' for this query.
  void Add(const ObjectQuery& query, int64_t frame, const ObjectShape& shape, absl::Span<const PointQuery> points);
  void Restore(ObjectState state) { groups_.emplace_back(std::move(state), windows_); }
  // What the caller calls this point ends after 'frame': those whose tracks that ends, which are all of its place where
  // it is an object's.
  std::vector<PointId> Remove(PointId id, int64_t frame);
  // A point's track that was queried at 'frame' has ended: the runs of the next Report are its last ones.
  void Close(PointId id, int64_t frame);
  // The newest frame there is.
  void Reach(int64_t newest) { newest_ = newest; }
  // What these runs say of objects. Objects that have ended are forgotten.
  std::vector<ObjectRun> Report(absl::Span<const PointRun> runs);
  // As before what was said at 'frame'.
  std::vector<ObjectState> StatesBefore(int64_t frame) const;

  // --- Points that are placed anew, see ObjectGroup.
  // An object that waits for it; null: none does.
  ObjectGroup* AnyReseeding();
  // Whether windows that begin at 'frame' have to wait until something is decided about the object of this point.
  bool Holds(PointId id, int64_t frame) const;
  // The oldest frame that points may yet be placed anew at.
  int64_t oldest_meeting() const;
  // Whether the frames there are have more to say of who is placed anew than they have said.
  bool AnyMeeting() const;
  bool WasPlacedAnew(PointId id, int64_t frame) const;

 private:
  const bool provisional_;
  const ObjectWindows windows_;
  int64_t newest_ = -1;
  std::list<ObjectGroup> groups_;  // in the order they were queried
};

}  // namespace holdfast
