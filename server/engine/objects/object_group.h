// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <utility>

#include "absl/types/span.h"
#include "api/types.h"
#include "server/engine/objects/object_shape.h"
#include "server/engine/objects/object_state.h"

namespace holdfast {

// What the points of one object say together: how it moves, by the similarity that most of its visible points agree
// with, and which of them do not move with it any more. Frames are judged in order, each when all points have an
// estimate of it; a final frame depends on final estimates alone, so that it does not matter how and when they came.
// Memory is bounded by the points and the frames that are not final. Not thread-safe.
class ObjectGroup {
 public:
  // 'points' were placed on 'shape' at frame 'query_frame'.
  ObjectGroup(ObjectId id, int64_t query_frame, const ObjectShape& shape, absl::Span<const PointQuery> points);
  // Goes on where another group was. REQUIRES: there is a standing for each member.
  explicit ObjectGroup(ObjectState state) : state_(std::move(state)), news_from_(state_.next) {}
  // Without estimates that are not final.
  ObjectState state() const;

  ObjectId id() const { return state_.id; }
  int64_t query_frame() const { return state_.query_frame; }
  // Estimates of one of its points. Those of others are ignored, and so are frames that are final.
  void Add(const PointRun& run);
  // The point's track ends after 'frame': later frames are without it.
  void Remove(PointId id, int64_t frame);
  // The point's track has ended; what was added when TakeRun is called next is all there is, though it may end earlier.
  void Close(PointId id);
  // No point is left, and all frames that they were part of are final.
  bool ended() const;

  // What is new since the last call: frames that became final, and with 'provisional' those after them that are new or
  // revised.
  std::optional<ObjectRun> TakeRun(bool provisional);

 private:
  // Whether every point that takes part in 'frame' has an estimate of it (a final one), and there is one.
  bool IsKnown(int64_t frame, bool final) const;
  // Samples of 'run' for the member they belong to; the first frame that changed.
  int64_t Take(const PointRun& run, ObjectMember& member) const;
  void EndClosed();
  // Judges 'frame' by what the object had come to before it.
  ObjectSample Judge(int64_t frame, ObjectJudgement& judgement) const;
  void FinishFrame();

  ObjectState state_;
  std::deque<ObjectJudgement> ahead_;  // by frames state_.next, state_.next + 1..., which are provisional
  int64_t news_from_;                  // frames from here on have to be judged anew
};

}  // namespace holdfast
