// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/point_queue.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "api/limits.h"
#include "server/engine/input/object_input.h"
#include "server/engine/input/point_check.h"

namespace holdfast {
namespace {

// At one frame a client may well remove all points, add others, and change its mind; no more waits.
constexpr int64_t kMaxChangesPerPoint = 4;
constexpr int64_t kSpareChanges = 1024;  // for sessions of few points

}  // namespace

PointQueue::PointQueue(int max_points)
    : max_points_(max_points), max_waiting_(kMaxChangesPerPoint * max_points + kSpareChanges) {}

void PointQueue::Resume(absl::flat_hash_set<PointId> ids, bool objects, uint64_t next_serial) {
  for (const PointId id : ids) {
    if (IsObjectPoint(id)) ++(objects ? objects_[ObjectOf(id)] : strangers_);
  }
  ids_ = std::move(ids);
  serial_ = next_serial;
}

absl::Status PointQueue::CheckSeeds(absl::string_view list, const std::vector<PointQuery>& points,
                                    int64_t frame) const {
  // Those of an object that has been removed are not free at its own frame: they would be taken for its points.
  if (!objects_.empty() || (frame == frame_ && !new_objects_.empty())) {
    const auto reserved = std::find_if(points.begin(), points.end(), [](const auto& p) { return IsObjectPoint(p.id); });
    if (reserved != points.end()) {
      return InvalidFieldError(absl::StrCat(list, "[", reserved - points.begin(), "].id"),
                               absl::StrCat(reserved->id, " is one of those that points of objects have"));
    }
  }
  const int64_t known = static_cast<int64_t>(ids_.size());
  if (absl::Status status = CheckPointCount(known + CountFresh(points), max_points_); !status.ok()) return status;
  return CheckRoom(list, static_cast<int64_t>(points.size()), frame);
}

int64_t PointQueue::CountFresh(const std::vector<PointQuery>& points) const {
  return std::count_if(points.begin(), points.end(), [this](const PointQuery& p) { return !ids_.contains(p.id); });
}

absl::Status PointQueue::CheckObjects(absl::string_view list, const std::vector<ObjectQuery>& objects,
                                      const std::vector<PointQuery>& points, int64_t frame) const {
  if (objects.empty()) return absl::OkStatus();
  const int64_t more = PointsOf(objects) + CountFresh(points);
  if (absl::Status status = CheckPointCount(static_cast<int64_t>(ids_.size()) + more, max_points_); !status.ok()) {
    return status;
  }
  if (objects.size() + objects_.size() > static_cast<size_t>(kMaxObjects)) {
    return OverloadError("objects of a session", absl::StrCat("at most ", kMaxObjects), absl::ZeroDuration());
  }
  const bool strange = std::any_of(points.begin(), points.end(), [](const auto& p) { return IsObjectPoint(p.id); });
  if (strange || strangers_ > 0 || (frame == frame_ && new_strangers_))
    return InvalidFieldError(list, "the session has points of ids that points of objects have");
  for (size_t i = 0; i < objects.size(); ++i) {
    const ObjectId id = objects[i].id;
    if (!objects_.contains(id) && !(frame == frame_ && new_objects_.contains(id))) continue;
    return InvalidFieldError(absl::StrCat(list, "[", i, "].id"), absl::StrCat(objects[i].id, " is in use"));
  }
  return CheckRoom(list, more, frame);
}

absl::Status PointQueue::CheckRemovals(absl::string_view list, const std::vector<PointId>& ids) const {
  return CheckRoom(list, static_cast<int64_t>(std::min(ids.size(), ids_.size())), frame_);
}

absl::Status PointQueue::CheckRoom(absl::string_view list, int64_t more, int64_t frame) const {
  if ((frame == frame_ ? at_frame_ : 0) + more <= max_waiting_) return absl::OkStatus();
  return OverloadError(list, absl::StrCat("at most ", max_waiting_, " changes of points may wait at one frame"),
                       absl::ZeroDuration());
}

void PointQueue::StartFrame(int64_t frame) {
  if (frame == frame_) return;
  frame_ = frame;
  new_objects_.clear();
  new_strangers_ = false;
  ForgetPlaces();
}

void PointQueue::Seed(absl::string_view list, const std::vector<PointQuery>& points) {
  for (size_t i = 0; i < points.size(); ++i) {
    const PointId id = points[i].id;
    const int64_t replaced = ForgetReplaced(id);
    if (ids_.insert(id).second && IsObjectPoint(id)) ++strangers_;
    if (IsObjectPoint(id)) new_strangers_ = true;
    waiting_.push_back({{PointOp::Kind::kSeed, frame_, points[i], serial_++, replaced + 1}, list, i});
    ++at_frame_;
    newest_[id] = {std::prev(waiting_.end()), waiting_.end()};
  }
}

void PointQueue::SeedObject(const ObjectQuery& object) {
  const int points = PointsOf(object);
  for (int i = 0; i < points; ++i) {
    const PointId id = ObjectPointId(object.id, static_cast<uint32_t>(i));
    ids_.insert(id);
    waiting_.push_back({{PointOp::Kind::kSeed, frame_, {id}, serial_++, 1}, {}, 0});
    ++at_frame_;
  }
  objects_[object.id] = points;
  new_objects_.insert(object.id);
}

void PointQueue::PlaceObject(ObjectId object, int64_t frame, const std::vector<PointQuery>& points) {
  absl::flat_hash_set<PointId> later;  // seeded behind, once all places of this object were removed
  for (auto waiting = waiting_.end(); waiting != waiting_.begin();) {
    PointOp& op = (--waiting)->op;
    const PointId id = op.query.id;
    if (op.frame < frame) break;
    if (op.kind != PointOp::Kind::kSeed || !IsObjectPoint(id) || ObjectOf(id) != object) continue;
    if (op.frame > frame) {
      later.insert(id);
      continue;
    }
    const size_t index = id - ObjectPointId(object, 0);
    if (index < points.size()) {
      op.query = points[index];
      continue;
    }
    if (op.frame == frame_) --at_frame_;
    waiting = waiting_.erase(waiting);
    if (!later.contains(id)) Forget(id);
  }
}

void PointQueue::Forget(PointId id) {
  if (ids_.erase(id) == 0 || !IsObjectPoint(id)) return;
  const auto found = objects_.find(ObjectOf(id));
  if (found == objects_.end()) {
    --strangers_;
  } else if (--found->second == 0) {
    objects_.erase(found);
  }
}

int64_t PointQueue::ForgetReplaced(PointId id) {
  const auto found = newest_.find(id);
  if (found == newest_.end()) return 0;
  const Newest replaced = found->second;
  const int64_t seeds = replaced.seed->op.seeds;
  Erase(replaced.seed);
  if (replaced.removal != waiting_.end()) Erase(replaced.removal);
  return seeds;
}

void PointQueue::Erase(Place place) {
  waiting_.erase(place);
  --at_frame_;
}

PointId PointQueue::Counted(PointId id) const {
  return IsObjectPoint(id) && objects_.contains(ObjectOf(id)) ? ObjectPlace(id) : id;
}

void PointQueue::Remove(const std::vector<PointId>& ids) {
  for (const PointId said : ids) {
    const PointId id = Counted(said);
    if (!ids_.contains(id)) continue;
    Forget(id);
    waiting_.push_back({{PointOp::Kind::kRemove, frame_, {id}}, {}, 0});
    ++at_frame_;
    // A point from before this frame has no seed here: a later seed does not replace its removal.
    if (const auto found = newest_.find(id); found != newest_.end()) found->second.removal = std::prev(waiting_.end());
  }
}

void PointQueue::CheckPositions(ImageSize size, Violations& violations) const {
  for (const Waiting& waiting : waiting_) {
    if (waiting.op.kind != PointOp::Kind::kSeed || waiting.list.empty()) continue;
    CheckPosition(waiting.list, waiting.index, waiting.op.query, size, violations);
  }
}

std::vector<PointOp> PointQueue::Take(int64_t newest_frame, bool applied) {
  std::vector<PointOp> ops;
  while (!waiting_.empty() && waiting_.front().op.frame <= newest_frame) {
    ops.push_back(waiting_.front().op);
    waiting_.pop_front();
  }
  if (newest_frame < frame_) return ops;
  newest_.clear();
  if (applied) at_frame_ = 0;
  return ops;
}

void PointQueue::DropFrom(int64_t frame) {
  while (!waiting_.empty() && waiting_.back().op.frame >= frame) waiting_.pop_back();
  if (frame <= frame_) ForgetPlaces();
}

void PointQueue::ForgetPlaces() {
  newest_.clear();
  at_frame_ = 0;
}

}  // namespace holdfast
