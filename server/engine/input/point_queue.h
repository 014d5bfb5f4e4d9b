// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/container/flat_hash_set.h"
#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "api/errors.h"
#include "api/types.h"

namespace holdfast {

// A change of the points, in the order of the stream.
struct PointOp {
  enum class Kind { kSeed, kRemove };
  Kind kind = Kind::kSeed;
  int64_t frame = 0;    // takes effect when this frame is there
  PointQuery query;     // kRemove: only its id
  uint64_t serial = 0;  // of a seed, unique within the session
  int64_t seeds = 0;    // how many seeds of the stream it stands for: those it replaced and itself
};

// The changes of one session's points that have not been taken yet. Changes belong to the newest frame. A seed replaces
// what waits of its id at its frame: the seed before it, whose track would have ended where it began, and the removal
// of that. Other changes that a client might pile up at one frame are refused above a bound, so that no stream makes
// the queue longer than that bound for each frame that waits. Points of objects are seeded before it is known where: no
// seed may be taken before its object was placed. They count by their places: who stands there, the first one or one
// that was placed anew, matters to nobody here. Not thread-safe.
class PointQueue {
 public:
  explicit PointQueue(int max_points);

  // Goes on behind another queue: these ids are tracked, those of objects among them if there are any, and serial
  // numbers begin here. REQUIRES: the queue is new.
  void Resume(absl::flat_hash_set<PointId> ids, bool objects, uint64_t next_serial);
  uint64_t next_serial() const { return serial_; }
  // The first of so many that no seed of the stream will have.
  uint64_t TakeSerials(int64_t count) { return std::exchange(serial_, serial_ + static_cast<uint64_t>(count)); }

  // Whether seeds at 'frame', the newest or the one to come, are within the limits: RESOURCE_EXHAUSTED says which one
  // they exceed, 'list' the field.
  absl::Status CheckSeeds(absl::string_view list, const std::vector<PointQuery>& points, int64_t frame) const;
  // As CheckSeeds, for the points of objects, which come beside 'points'; INVALID_ARGUMENT where an object's id, or
  // that of one of its points, is in use or was at this frame.
  absl::Status CheckObjects(absl::string_view list, const std::vector<ObjectQuery>& objects,
                            const std::vector<PointQuery>& points, int64_t frame) const;
  absl::Status CheckRemovals(absl::string_view list, const std::vector<PointId>& ids) const;

  // Changes belong to 'frame' from now on. They belong to frame 0 from the beginning.
  void StartFrame(int64_t frame);
  int64_t frame() const { return frame_; }
  // REQUIRES: the check has passed. 'list' outlives the queue.
  void Seed(absl::string_view list, const std::vector<PointQuery>& points);
  // REQUIRES: the check has passed, CheckObjects of object_input.h too.
  void SeedObject(const ObjectQuery& object);
  // Where the first points of an object are that was seeded at 'frame'; the others are not seeded after all.
  void PlaceObject(ObjectId object, int64_t frame, const std::vector<PointQuery>& points);
  // Ids without a point are ignored; that of any point of an object means its place.
  void Remove(const std::vector<PointId>& ids);

  // Adds the seeds that lie outside a frame of this size, by the names that they came with.
  void CheckPositions(ImageSize size, Violations& violations) const;

  // The changes up to 'newest_frame', in order. Where they are not 'applied' at once they still count as waiting, until
  // a later call takes what is to be.
  std::vector<PointOp> Take(int64_t newest_frame, bool applied = true);
  void DropFrom(int64_t frame);
  bool empty() const { return waiting_.empty(); }
  int64_t size() const { return static_cast<int64_t>(waiting_.size()); }

 private:
  struct Waiting {
    PointOp op;
    absl::string_view list;  // a seed's place in its message
    size_t index = 0;
  };
  using Place = std::list<Waiting>::iterator;
  struct Newest {  // of one id at frame_
    Place seed;
    Place removal;  // of that seed; the list's end: none
  };

  // So many of 'points' have ids that are not in use.
  int64_t CountFresh(const std::vector<PointQuery>& points) const;
  absl::Status CheckRoom(absl::string_view list, int64_t more, int64_t frame) const;
  // The id that a point is counted by.
  PointId Counted(PointId id) const;
  // The number of seeds that the removed ones stood for.
  int64_t ForgetReplaced(PointId id);
  void Erase(Place place);
  // The id is not in use any more.
  void Forget(PointId id);
  void ForgetPlaces();

  const int64_t max_points_;
  const int64_t max_waiting_;  // at one frame
  std::list<Waiting> waiting_;
  uint64_t serial_ = 0;  // of the next seed
  int64_t frame_ = 0;
  int64_t at_frame_ = 0;                            // changes at frame_ that wait, here or where they were taken to
  absl::flat_hash_map<PointId, Newest> newest_;     // ids whose last seed waits and belongs to frame_, but of objects
  absl::flat_hash_set<PointId> ids_;                // tracked once every change has taken effect
  absl::flat_hash_map<ObjectId, int64_t> objects_;  // how many of ids_ each has
  int64_t strangers_ = 0;                           // how many of ids_ look like an object's and are not
  absl::flat_hash_set<ObjectId> new_objects_;       // seeded at frame_, though they may have been removed since
  bool new_strangers_ = false;                      // the same of strangers
};

}  // namespace holdfast
