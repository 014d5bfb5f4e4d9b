// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/container/btree_map.h"
#include "absl/container/flat_hash_map.h"
#include "absl/synchronization/mutex.h"
#include "absl/types/span.h"
#include "api/types.h"
#include "server/engine/input/session_inbox.h"
#include "server/engine/motion/flow.h"
#include "server/engine/motion/redetection.h"
#include "server/engine/tracker_model.h"
#include "server/engine/tracks/geometry.h"

namespace holdfast {

// The grey pyramids of a session's newest frames, and for each track the chain of positions that optical flow carries
// from its newest estimate to the newest frame. A link of a chain depends on the link before it and two pictures alone.
// A point that is in doubt where its next window ends is looked for there by the surroundings of its query; what comes
// of it, which depends on these, the chain and its pictures alone, is where that window starts and no other. So it does
// not matter when a chain is made or beside which other points. Decode threads add frames and make links, the compute
// thread says where chains begin and reads them. Thread-safe; no lock is held while flow is computed or pictures are
// cut.
class SessionFlow {
 public:
  struct Options {
    bool starts = true;   // chains are starts of windows: the one from the query lasts until the first window is full
    bool live = false;    // chains reach to the newest frame and are reported; otherwise only as far as windows need
    bool patches = true;  // the surroundings of each query are kept
    int64_t window_frames = 24;
    float visible_above = 0.5f;  // confidence of what is reported as visible
  };
  explicit SessionFlow(const Options& options) : options_(options) {}

  // Before the first frame. 'scale': pixels of the pyramids a feature pixel.
  struct Scale {
    float x = 1;
    float y = 1;
  };
  void SetGeometry(const FrameGeometry& geometry, const Scale& scale) ABSL_LOCKS_EXCLUDED(mutex_);

  // Goes on at 'frame', the first to be added, with a point of a session that is resumed. REQUIRES: the geometry is
  // set; no frame was added.
  struct Restored {
    PointOp seed;
    bool ending = false;
    int64_t last_frame = 0;  // of a track that is ending, and from where it is not reported
    int64_t stop = 0;
    std::optional<FlowPatch> patch;
  };
  void StartAt(int64_t frame) ABSL_LOCKS_EXCLUDED(mutex_);
  void Restore(Restored point) ABSL_LOCKS_EXCLUDED(mutex_);

  // --- Decode threads.
  // Frames may come in any order; chains grow over those that have no gap before them.
  void AddFrame(int64_t index, FlowPyramidPtr pyramid) ABSL_LOCKS_EXCLUDED(mutex_);
  // The right to call Step and Search; one thread at a time has it. False: another one has it and will see what is new.
  bool BeginSteps() ABSL_LOCKS_EXCLUDED(mutex_);
  // Cuts out the surroundings of new queries, and carries the chains that are furthest behind by one frame. False:
  // there was no such chain.
  bool Step() ABSL_LOCKS_EXCLUDED(mutex_);
  // Looks for some of the points that are in doubt, which their windows wait for: as many as take some 20 milliseconds,
  // or one. False: there was none.
  bool Search() ABSL_LOCKS_EXCLUDED(mutex_);
  // False, and the right is kept: there is something new since BeginSteps.
  bool EndSteps() ABSL_LOCKS_EXCLUDED(mutex_);
  // Positions of live chains that were not reported yet, up to frame 'newest': provisional runs in pixels of the frame.
  // What the stream says of points before that frame has been applied, so that nothing is reported of removed ones.
  std::vector<PointRun> TakeLive(int64_t newest) ABSL_LOCKS_EXCLUDED(mutex_);
  // The newest frame without a gap before it; -1 before the first.
  int64_t newest() const ABSL_LOCKS_EXCLUDED(mutex_);

  // --- Either, in the order of the stream.
  void Apply(absl::Span<const PointOp> ops) ABSL_LOCKS_EXCLUDED(mutex_);

  // --- The compute thread.
  struct Base {
    uint64_t serial = 0;
    int64_t frame = 0;
    Position position;
    float confidence = 0;
    float assurance = 1;  // that the point is not lost
    bool search = true;   // the point is to be looked for if it is in doubt
    int64_t until = 0;    // the last frame of the window to come
    bool early = false;   // the first window, not full: only what is reported begins here
  };
  // A window has run: its track's chain begins anew.
  void Rebase(absl::Span<const Base> bases) ABSL_LOCKS_EXCLUDED(mutex_);
  // Whether the track's chain reaches 'frame', and nothing is to be looked for there any more.
  bool Reaches(uint64_t serial, int64_t frame) const ABSL_LOCKS_EXCLUDED(mutex_);
  // The chain after the frame it begins at, up to 'last'. REQUIRES: Reaches(serial, last).
  std::vector<Position> Starts(uint64_t serial, int64_t last) const ABSL_LOCKS_EXCLUDED(mutex_);
  std::shared_ptr<const FlowPatch> PatchOf(uint64_t serial) const ABSL_LOCKS_EXCLUDED(mutex_);
  // Null where it is not kept.
  FlowPyramidPtr PictureOf(int64_t frame) const ABSL_LOCKS_EXCLUDED(mutex_);
  // first .. last.
  std::vector<FlowPyramidPtr> Pyramids(int64_t first, int64_t last) const ABSL_LOCKS_EXCLUDED(mutex_);
  void Drop(uint64_t serial) ABSL_LOCKS_EXCLUDED(mutex_);
  void EvictBefore(int64_t frame) ABSL_LOCKS_EXCLUDED(mutex_);
  // Forgets everything; later calls do nothing.
  void Close() ABSL_LOCKS_EXCLUDED(mutex_);
  int64_t oldest() const ABSL_LOCKS_EXCLUDED(mutex_);
  int64_t bytes() const ABSL_LOCKS_EXCLUDED(mutex_);

  // Once the geometry is set.
  FlowPoint ToFlow(Position position) const { return {position.x * scale_.x, position.y * scale_.y}; }
  Position ToFeatures(FlowPoint point) const { return {point.x / scale_.x, point.y / scale_.y}; }

 private:
  struct Chain {
    int64_t first = 0;  // frame of points[0], which is where the chain begins
    std::vector<FlowPoint> points;
    std::vector<float> confidence;  // of the points
    int64_t until = 0;              // no need to go on
    float assurance = 1;            // of the head
    bool search = true;
    bool doubted = false;          // the point is to be looked for at 'until' before a window starts from there
    std::vector<FlowPoint> found;  // by that: 'points' up to 'until' instead; empty: nothing
    void Grow(const FlowStep& step);
    int64_t head() const { return first + static_cast<int64_t>(points.size()) - 1; }
  };
  // A query's surroundings, cut out when they are first asked for: encoding them takes a while with many points, and
  // those who say where points start hold others up.
  class QueryPatch {
   public:
    QueryPatch(FlowPyramidPtr picture, FlowPoint at) : picture_(std::move(picture)), at_(at) {}
    explicit QueryPatch(FlowPatch patch) : patch_(std::move(patch)) {}
    const FlowPatch& Get() ABSL_LOCKS_EXCLUDED(mutex_);

   private:
    absl::Mutex mutex_;
    FlowPyramidPtr picture_ ABSL_GUARDED_BY(mutex_);  // null: it is cut
    FlowPoint at_;
    FlowPatch patch_;  // changes no more once it is cut
  };
  struct Entry {
    PointQuery query;
    int64_t query_frame = 0;
    Chain chain;                // from the newest estimate of a full window, or from the query
    std::optional<Chain> live;  // from the newest estimate where 'chain' begins elsewhere
    int64_t report_from = 0;    // the first frame of the reported chain that was not reported
    int64_t last_frame = std::numeric_limits<int64_t>::max();  // the point was removed or re-seeded there
    int64_t stop = std::numeric_limits<int64_t>::max();        // and is not reported from here on
    uint64_t generation = 0;                                   // counts the chains
    std::shared_ptr<QueryPatch> patch;
  };
  struct Head {  // a chain that can grow
    uint64_t serial = 0;
    uint64_t generation = 0;
    bool live = false;
    FlowPoint at;
  };
  struct Work {
    int64_t frame = 0;  // the heads stand here
    std::vector<Head> heads;
    FlowPyramidPtr from;
    FlowPyramidPtr to;
  };

  struct Doubt {  // a point that is to be looked for
    Head head;
    std::shared_ptr<QueryPatch> patch;
    LostChain chain;
  };

  void CutPatches() ABSL_LOCKS_EXCLUDED(mutex_);
  void SeedLocked(const PointOp& op) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // The newest entry of the id; an end that it has already holds where it is earlier.
  void EndLocked(PointId id, int64_t last_frame, int64_t stop) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  Work NextWorkLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool CanGrowLocked(const Entry& entry, const Chain& chain) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Null where the head's chain has begun anew, or its track is gone.
  Entry* EntryOfLocked(const Head& head) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void GrowLocked(const Work& work, absl::Span<const FlowStep> steps) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Whether the point is to be looked for where the chain stands now.
  bool InDoubtLocked(const Entry& entry, const Chain& chain) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // All in the same picture.
  std::vector<Doubt> NextDoubtsLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void FoundLocked(const Doubt& doubt) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  PointRun RunOf(const Entry& entry, const Chain& chain, int64_t end) const;
  int64_t NewestLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const Options options_;
  // Set before the first frame, which is before they are read.
  FrameGeometry geometry_;
  Scale scale_;

  mutable absl::Mutex mutex_;
  std::deque<FlowPyramidPtr> pyramids_ ABSL_GUARDED_BY(mutex_);  // from oldest_ on; null: not there yet
  int64_t oldest_ ABSL_GUARDED_BY(mutex_) = 0;
  int64_t without_gap_ ABSL_GUARDED_BY(mutex_) = 0;  // frames before this one have come
  absl::btree_map<uint64_t, Entry> entries_ ABSL_GUARDED_BY(mutex_);
  absl::flat_hash_map<PointId, uint64_t> newest_ ABSL_GUARDED_BY(mutex_);  // of each id the entry seeded last
  std::vector<std::shared_ptr<QueryPatch>> uncut_ ABSL_GUARDED_BY(mutex_);
  bool stepping_ ABSL_GUARDED_BY(mutex_) = false;
  bool news_ ABSL_GUARDED_BY(mutex_) = false;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace holdfast
