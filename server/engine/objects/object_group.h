// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "absl/types/span.h"
#include "api/types.h"
#include "server/engine/objects/object_shape.h"
#include "server/engine/objects/object_state.h"
#include "server/engine/objects/reseeding.h"

namespace holdfast {

// The windows that points are followed in: one of 'frames' every 'hop'. A window makes its first hop + 1 frames final.
struct ObjectWindows {
  int64_t frames = 0;
  int64_t hop = 0;  // 0: no point is placed anew
};

// What the points of one object say together: how it moves, by the similarity that most of its visible points agree
// with, and which of them do not move with it any more. Frames are judged in order, each when all points have an
// estimate of it; a final frame depends on final estimates alone, so that it does not matter how and when they came.
// Memory is bounded by the points and the frames that are not final. Not thread-safe.
//
// Points that have left are placed anew where the windows of its points meet, hop by hop from its query: such a frame
// is the last one that a window makes final and the first one of the next. What it says is decided on before anything
// follows: no frame after it is judged, and none of the points' next windows may run, until Reseed has been called.
class ObjectGroup {
 public:
  // 'points' were placed on 'shape' at frame 'query_frame'.
  ObjectGroup(ObjectId id, int64_t query_frame, const ObjectShape& shape, absl::Span<const PointQuery> points,
              const ObjectWindows& windows = {});
  // Goes on where another group was. REQUIRES: there is a standing for each member.
  explicit ObjectGroup(ObjectState state, const ObjectWindows& windows = {})
      : windows_(windows), state_(std::move(state)), news_from_(state_.next) {}
  // As before what the caller said at 'frame', without estimates that are not final. REQUIRES: !reseeding().
  ObjectState StateBefore(int64_t frame) const;

  ObjectId id() const { return state_.id; }
  int64_t query_frame() const { return state_.query_frame; }
  // Estimates of one of its points. Those of others are ignored, and so are frames that are final.
  void Add(const PointRun& run);
  // The tracks of the points at this one's place end after 'frame': later frames are without them. Their ids.
  std::vector<PointId> Remove(PointId id, int64_t frame);
  // The track of a point that was queried at 'frame' has ended; what was added when TakeRun is called next is all there
  // is, though it may end earlier.
  void Close(PointId id, int64_t frame);
  // No point is left, and all frames that they were part of are final.
  bool ended() const;

  // What is new since the last call: frames that became final, and with 'provisional' those after them that are new or
  // revised. 'newest': the newest frame there is.
  std::optional<ObjectRun> TakeRun(bool provisional, int64_t newest = ObjectMember::kNever);

  // The next frame whose final word may have points placed anew; never, where none are.
  int64_t meeting() const;
  // The window that makes that frame final covers frames up to this one.
  int64_t covered_at_meeting() const;
  // That word, once it has been said and before Reseed has been called.
  const std::optional<Reseeding>& reseeding() const { return reseeding_; }
  struct Reseeded {
    PointQuery point;
    PointId before = 0;                    // the point whose place it has taken
    int64_t before_queried = 0;            // the frame that this one was queried at
    std::optional<int64_t> removed_after;  // the caller has removed the place's points after this frame
  };
  // Points were placed here for some of those that were lost, the first ones. REQUIRES: reseeding().
  std::vector<Reseeded> Reseed(absl::Span<const Pixel> places);
  // The point was placed anew at 'frame'.
  bool WasPlacedAnew(PointId id, int64_t frame) const;

 private:
  // Whether every point that takes part in 'frame' has an estimate of it (a final one), and there is one.
  bool IsKnown(int64_t frame, bool final) const;
  bool TakesPart(const ObjectMember& member, int64_t frame) const {
    return frame < member.end && (frame > member.queried || member.queried == query_frame());
  }
  // Samples of 'run' for the member they belong to; the first frame that changed.
  int64_t Take(const PointRun& run, ObjectMember& member) const;
  void EndClosed();
  bool HasSuccessor(const ObjectMember& member) const;
  // Judges 'frame' by what the object had come to before it; 'told': enough points agreed on its motion.
  ObjectSample Judge(int64_t frame, ObjectJudgement& judgement, bool& told) const;
  // Judges the next frame for good.
  ObjectSample Finish(int64_t newest);
  void DropEnded();

  ObjectWindows windows_;
  ObjectState state_;
  std::optional<Reseeding> reseeding_;
  std::deque<ObjectJudgement> ahead_;  // by frames state_.next, state_.next + 1..., which are provisional
  int64_t news_from_;                  // frames from here on have to be judged anew
};

}  // namespace holdfast
