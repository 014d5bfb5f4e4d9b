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
  // 'provisional': estimates that are not final are reported too.
  explicit SessionObjects(bool provisional) : provisional_(provisional) {}

  void Add(ObjectGroup group) { groups_.push_back(std::move(group)); }
  // A track ends after 'frame'. Points that are no object's are ignored.
  void Remove(PointId id, int64_t frame);
  // A point's track that was queried at 'frame' has ended: the runs of the next Report are its last ones.
  void Close(PointId id, int64_t frame);
  // What these runs say of objects. Objects that have ended are forgotten.
  std::vector<ObjectRun> Report(absl::Span<const PointRun> runs);
  // As before what was said at 'frame'.
  std::vector<ObjectState> StatesBefore(int64_t frame) const;

 private:
  const bool provisional_;
  std::list<ObjectGroup> groups_;  // in the order they were queried
};

}  // namespace holdfast
