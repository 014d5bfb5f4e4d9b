// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/session_inbox.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/engine/input/object_input.h"
#include "server/engine/input/point_check.h"

namespace holdfast {
namespace {

constexpr absl::string_view kFramePoints = "frame.points";
constexpr absl::string_view kFrameObjects = "frame.objects";

absl::Status BadFrame(int64_t index, const absl::Status& why) {
  if (!absl::IsInvalidArgument(why) || !FieldViolations(why).empty()) return why;
  return InvalidFieldError("frame.data", absl::StrCat("frame ", index, ": ", why.message()));
}

}  // namespace

SessionInbox::SessionInbox(const Options& options) : options_(options), points_(options.limits.max_points) {
  if (IsRaw(options.format.encoding)) frame_size_ = options.format.raw_size;
  if (!options.resumed) return;
  frame_size_ = options.resumed->frame_size;
  points_.Resume(options.resumed->ids, options.resumed->objects, options.resumed->next_serial);
}

absl::StatusOr<Room> SessionInbox::Push(Frame frame, SteadyTime now) {
  const absl::StatusOr<ImageSize> size = FrameSize(frame.bytes, options_.format);
  const absl::Status count = CheckPointCount(static_cast<int64_t>(frame.points.size()), options_.limits.max_points);
  Violations violations;
  if (size.ok() && count.ok()) {
    violations = CheckPoints(kFramePoints, frame.points, *size);
    violations.Append(CheckObjects(kFrameObjects, frame.objects, *size));
  }
  absl::MutexLock lock(&mutex_);
  if (absl::Status status = CheckOpenLocked(); !status.ok()) return status;
  if (absl::Status status = CheckIndexLocked(frame.index); !status.ok()) return status;
  if (options_.resumed && frame.index < options_.resumed->next) {
    received_ = frame.index + 1;
    any_received_ = true;
    return Room::kAvailable;
  }
  if (absl::Status status = CheckFrameLocked(frame, size); !status.ok()) return status;
  if (!count.ok()) return count;
  if (IsRepeatedLocked(frame.index)) {
    frame.points.clear();
    frame.objects.clear();
    violations = Violations();
  }
  if (!any_received_) CheckFirstLocked(*size, violations);
  if (!violations.empty()) return violations.ToStatus();
  absl::Status seeds = points_.CheckSeeds(kFramePoints, frame.points, frame.index);
  seeds.Update(points_.CheckObjects(kFrameObjects, frame.objects, frame.points, frame.index));
  if (!seeds.ok()) return seeds;
  frame_size_ = *size;
  points_.StartFrame(frame.index);
  points_.Seed(kFramePoints, frame.points);
  std::vector<WaitingObject> objects = SeedObjectsLocked(std::move(frame.objects));
  pending_.push_back({frame.index, now, std::move(frame.bytes), std::move(objects), std::nullopt});
  received_ = frame.index + 1;
  any_received_ = true;
  told_full_ = FullLocked();
  return told_full_ ? Room::kFull : Room::kAvailable;
}

absl::Status SessionInbox::CheckOpenLocked() const {
  if (!ended_) return absl::OkStatus();
  return end_status_.ok() ? absl::FailedPreconditionError("the stream has finished") : end_status_;
}

bool SessionInbox::IsRepeatedLocked(int64_t frame) const { return options_.resumed && frame < options_.resumed->taken; }

absl::Status SessionInbox::CheckIndexLocked(int64_t index) const {
  if (options_.resumed && !any_received_) {
    const int64_t next = options_.resumed->next;
    if (index >= 0 && index <= next) return absl::OkStatus();
    return InvalidFieldError("frame.index",
                             absl::StrCat("frame ", index, " came first, but the session goes on with frame ", next));
  }
  if (index == received_) return absl::OkStatus();
  return InvalidFieldError("frame.index", absl::StrCat("frame ", index, " came instead of frame ", received_));
}

absl::Status SessionInbox::CheckFrameLocked(const Frame& frame, const absl::StatusOr<ImageSize>& size) const {
  const int64_t index = frame.index;
  if (options_.limits.max_frames > 0 && index >= options_.limits.max_frames) {
    return OverloadError("frames of a session", absl::StrCat("at most ", options_.limits.max_frames),
                         absl::ZeroDuration());
  }
  if (FullLocked()) return absl::FailedPreconditionError("no room for a frame");
  const int64_t bytes = static_cast<int64_t>(frame.bytes.size());
  if (bytes > options_.limits.max_frame_bytes) {
    return BadFrame(
        index, absl::InvalidArgumentError(absl::StrCat(bytes, " bytes, at most ", options_.limits.max_frame_bytes)));
  }
  if (!size.ok()) return BadFrame(index, size.status());
  if (frame_size_ && *frame_size_ != *size) {
    return BadFrame(index, absl::InvalidArgumentError(absl::StrCat("its size is ", ToString(*size), ", the first was ",
                                                                   ToString(*frame_size_))));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::optional<ImageSize>> SessionInbox::SizeIfOpen() const {
  absl::MutexLock lock(&mutex_);
  if (absl::Status status = CheckOpenLocked(); !status.ok()) return status;
  return frame_size_;
}

absl::Status SessionInbox::AddPoints(absl::string_view list, const std::vector<PointQuery>& points) {
  const auto size = SizeIfOpen();
  if (!size.ok()) return size.status();
  const int64_t count = static_cast<int64_t>(points.size());
  if (absl::Status status = CheckPointCount(count, options_.limits.max_points); !status.ok()) return status;
  Violations violations = CheckPoints(list, points, *size);
  absl::MutexLock lock(&mutex_);
  if (absl::Status status = CheckOpenLocked(); !status.ok()) return status;
  if (IsRepeatedLocked(received_ - 1)) return absl::OkStatus();
  if (frame_size_ != *size) violations = CheckPoints(list, points, frame_size_);  // the first frame came meanwhile
  if (!violations.empty()) return violations.ToStatus();
  if (absl::Status status = points_.CheckSeeds(list, points, points_.frame()); !status.ok()) return status;
  points_.Seed(list, points);
  return absl::OkStatus();
}

absl::Status SessionInbox::AddObjects(absl::string_view list, std::vector<ObjectQuery> objects) {
  const auto size = SizeIfOpen();
  if (!size.ok()) return size.status();
  const Violations violations = CheckObjects(list, objects, *size);
  if (!violations.empty()) return violations.ToStatus();
  absl::MutexLock lock(&mutex_);
  if (absl::Status status = points_.CheckObjects(list, objects, {}, points_.frame()); !status.ok()) return status;
  for (ObjectQuery& object : objects) {
    points_.SeedObject(object);
    first_objects_.push_back({std::move(object), absl::StrCat(list, "[", first_objects_.size(), "]")});
  }
  return absl::OkStatus();
}

void SessionInbox::CheckFirstLocked(ImageSize size, Violations& violations) const {
  if (frame_size_) return;  // it was known, and they were held against it
  points_.CheckPositions(size, violations);
  for (const WaitingObject& object : first_objects_) {
    violations.Append(CheckObject(object.field, object.query, size));
  }
}

std::vector<WaitingObject> SessionInbox::SeedObjectsLocked(std::vector<ObjectQuery> objects) {
  std::vector<WaitingObject> waiting = std::exchange(first_objects_, {});
  for (size_t i = 0; i < objects.size(); ++i) {
    points_.SeedObject(objects[i]);
    waiting.push_back({std::move(objects[i]), absl::StrCat(kFrameObjects, "[", i, "]")});
  }
  return waiting;
}

absl::Status SessionInbox::RemovePoints(const std::vector<PointId>& ids) {
  absl::MutexLock lock(&mutex_);
  if (absl::Status status = CheckOpenLocked(); !status.ok()) return status;
  if (IsRepeatedLocked(received_ - 1)) return absl::OkStatus();
  if (absl::Status status = points_.CheckRemovals("remove_points.ids", ids); !status.ok()) return status;
  points_.Remove(ids);
  return absl::OkStatus();
}

void SessionInbox::End(absl::Status status) {
  absl::MutexLock lock(&mutex_);
  if (ended_) return;
  ended_ = true;
  end_status_ = std::move(status);
  if (!any_received_) points_.DropFrom(0);  // there will be no frame for them
}

void SessionInbox::Suspend(absl::Status status) {
  absl::MutexLock lock(&mutex_);
  if (cancelled_ || suspended_) return;
  suspended_ = ended_ = true;
  end_status_ = std::move(status);
  // What was said about points at frames that have been taken belongs to the state that they leave behind.
  DropFromLocked(pending_.empty() ? received_ : pending_.front().index);
}

void SessionInbox::Cancel() {
  absl::MutexLock lock(&mutex_);
  cancelled_ = ended_ = true;
  end_status_ = absl::CancelledError("the session was cancelled");
  DropFromLocked(0);
}

void SessionInbox::Close(const absl::Status& status) {
  absl::MutexLock lock(&mutex_);
  ended_ = true;
  end_status_ = status;
  DropFromLocked(0);
}

std::optional<std::string> SessionInbox::TakeBytes(int64_t index) {
  absl::MutexLock lock(&mutex_);
  Pending* frame = FindLocked(index);
  if (frame == nullptr) return std::nullopt;
  return std::move(frame->bytes);
}

std::vector<WaitingObject> SessionInbox::TakeObjects(int64_t index) {
  absl::MutexLock lock(&mutex_);
  Pending* frame = FindLocked(index);
  if (frame == nullptr) return {};
  return std::exchange(frame->objects, {});
}

void SessionInbox::PlaceObject(ObjectId object, int64_t index, const std::vector<PointQuery>& points) {
  absl::MutexLock lock(&mutex_);
  points_.PlaceObject(object, index, points);
}

bool SessionInbox::SetDecoded(int64_t index, absl::StatusOr<RgbImage> image, SteadyTime now) {
  absl::MutexLock lock(&mutex_);
  Pending* frame = FindLocked(index);
  if (frame == nullptr) return false;
  if (image.ok()) {
    frame->decoded = DecodedFrame{index, frame->arrival, now, *std::move(image)};
    return true;
  }
  ended_ = true;
  end_status_ = BadFrame(index, image.status());
  DropFromLocked(index);
  --dropped_;  // this one is rejected
  return true;
}

int64_t SessionInbox::ready() const {
  absl::MutexLock lock(&mutex_);
  return ReadyLocked();
}

int64_t SessionInbox::ReadyLocked() const {
  const auto missing =
      std::find_if(pending_.begin(), pending_.end(), [](const Pending& frame) { return !frame.decoded.has_value(); });
  return missing - pending_.begin();
}

SessionInbox::Taken SessionInbox::TakeFrames(int64_t count) {
  absl::MutexLock lock(&mutex_);
  Taken taken;
  for (count = std::min(count, ReadyLocked()); count > 0; --count) {
    taken.frames.push_back(*std::move(pending_.front().decoded));
    pending_.pop_front();
  }
  taken.room = told_full_ && !FullLocked();
  if (taken.room) told_full_ = false;
  return taken;
}

std::vector<PointOp> SessionInbox::TakeOps(int64_t newest_frame, bool applied) {
  absl::MutexLock lock(&mutex_);
  return points_.Take(newest_frame, applied);
}

SessionInbox::Standing SessionInbox::standing() const {
  absl::MutexLock lock(&mutex_);
  return {ended_ && pending_.empty() && points_.empty(), suspended_, cancelled_, end_status_};
}

bool SessionInbox::suspended() const {
  absl::MutexLock lock(&mutex_);
  return suspended_;
}

bool SessionInbox::cancelled() const {
  absl::MutexLock lock(&mutex_);
  return cancelled_;
}

absl::Status SessionInbox::end_status() const {
  absl::MutexLock lock(&mutex_);
  return end_status_;
}

int64_t SessionInbox::frames_received() const {
  absl::MutexLock lock(&mutex_);
  return options_.resumed ? std::max(received_, options_.resumed->taken + 1) : received_;
}

uint64_t SessionInbox::TakeSerials(int64_t count) {
  absl::MutexLock lock(&mutex_);
  return points_.TakeSerials(count);
}

uint64_t SessionInbox::next_serial() const {
  absl::MutexLock lock(&mutex_);
  return points_.next_serial();
}

int64_t SessionInbox::TakeDropped() {
  absl::MutexLock lock(&mutex_);
  return std::exchange(dropped_, 0);
}

ImageSize SessionInbox::frame_size() const {
  absl::MutexLock lock(&mutex_);
  return frame_size_.value_or(ImageSize{});
}

void SessionInbox::DropFromLocked(int64_t index) {
  while (!pending_.empty() && pending_.back().index >= index) {
    pending_.pop_back();
    ++dropped_;
  }
  points_.DropFrom(index);
}

SessionInbox::Pending* SessionInbox::FindLocked(int64_t index) {
  if (pending_.empty() || index < pending_.front().index || index > pending_.back().index) return nullptr;
  return &pending_[index - pending_.front().index];
}

bool SessionInbox::FullLocked() const { return static_cast<int>(pending_.size()) >= options_.max_pending_frames; }

}  // namespace holdfast
