// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/container/flat_hash_set.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/synchronization/mutex.h"
#include "api/clock.h"
#include "api/errors.h"
#include "api/types.h"
#include "server/engine/engine_session.h"
#include "server/engine/input/frame_decoder.h"
#include "server/engine/input/point_queue.h"
#include "server/engine/tracker_model.h"

namespace holdfast {

struct DecodedFrame {
  int64_t index = 0;
  SteadyTime arrival;
  SteadyTime decoded;
  RgbImage image;  // at the processing size
};

// An object that waits for its frame, and where it stands in its message.
struct WaitingObject {
  ObjectQuery query;
  std::string field;  // "config.objects[0]"
};

// What a stream has sent and the engine has not taken yet: bounded, checked, in order. Callers push, the decode pool
// fills frames in, the compute thread takes them. Points are counted before anything else is done with them, and looked
// at outside the lock that the compute thread takes. Thread-safe.
class SessionInbox {
 public:
  struct Options {
    FrameFormat format;
    SessionLimits limits;
    int max_pending_frames = 8;
    // A session that goes on where another one was: frames before 'next' are ignored, and so is what the stream says
    // about points before frame 'taken', as it has been said already.
    struct Resumed {
      int64_t next = 0;
      int64_t taken = 0;
      ImageSize frame_size;
      absl::flat_hash_set<PointId> ids;  // of the points that are tracked
      bool objects = false;              // there are objects, whose points are among them
      uint64_t next_serial = 0;
    };
    std::optional<Resumed> resumed;
  };
  explicit SessionInbox(const Options& options);

  // --- The stream. The caller decides what follows an error: nothing has changed by then.
  // Checks everything that the bytes' header can tell.
  absl::StatusOr<Room> Push(Frame frame, SteadyTime now) ABSL_LOCKS_EXCLUDED(mutex_);
  // 'list' names the field in errors and outlives the inbox. Queried at the newest frame, or at the first.
  absl::Status AddPoints(absl::string_view list, const std::vector<PointQuery>& points) ABSL_LOCKS_EXCLUDED(mutex_);
  // Queried at the first frame. Before it comes.
  absl::Status AddObjects(absl::string_view list, std::vector<ObjectQuery> objects) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::Status RemovePoints(const std::vector<PointId>& ids) ABSL_LOCKS_EXCLUDED(mutex_);
  // No more input; the session ends with 'status' when it has worked off what is here. Only the first call counts.
  void End(absl::Status status) ABSL_LOCKS_EXCLUDED(mutex_);
  // Drops the frames that are here, and what belongs to them; the session ends with 'status' as it stands. Counts
  // unless it was cancelled before.
  void Suspend(absl::Status status) ABSL_LOCKS_EXCLUDED(mutex_);
  // Drops what is here.
  void Cancel() ABSL_LOCKS_EXCLUDED(mutex_);
  // The session is over: drops what is here, and later calls get 'status'.
  void Close(const absl::Status& status) ABSL_LOCKS_EXCLUDED(mutex_);

  // --- The decode pool.
  // Empty: the frame has been dropped.
  std::optional<std::string> TakeBytes(int64_t index) ABSL_LOCKS_EXCLUDED(mutex_);
  // The objects that are queried at the frame; the second call has none.
  std::vector<WaitingObject> TakeObjects(int64_t index) ABSL_LOCKS_EXCLUDED(mutex_);
  // Where an object's points are, at the frame it was queried at.
  void PlaceObject(ObjectId object, int64_t index, const std::vector<PointQuery>& points) ABSL_LOCKS_EXCLUDED(mutex_);
  // An error ends the session before this frame, whatever had ended it after. False: the frame has been dropped.
  bool SetDecoded(int64_t index, absl::StatusOr<RgbImage> image, SteadyTime now) ABSL_LOCKS_EXCLUDED(mutex_);

  // --- The compute thread.
  // Frames that can be taken: decoded, without a gap.
  int64_t ready() const ABSL_LOCKS_EXCLUDED(mutex_);
  struct Taken {
    std::vector<DecodedFrame> frames;
    bool room = false;  // a stream that was told "full" has room again
  };
  // REQUIRES: count <= ready().
  Taken TakeFrames(int64_t count) ABSL_LOCKS_EXCLUDED(mutex_);
  // As PointQueue::Take.
  std::vector<PointOp> TakeOps(int64_t newest_frame, bool applied = true) ABSL_LOCKS_EXCLUDED(mutex_);
  // How the stream stands, all of it at the same moment: it may end in between two questions.
  struct Standing {
    bool drained = false;  // ended, and nothing is left to take
    bool suspended = false;
    bool cancelled = false;
    absl::Status end_status;
  };
  Standing standing() const ABSL_LOCKS_EXCLUDED(mutex_);
  bool drained() const { return standing().drained; }
  bool suspended() const ABSL_LOCKS_EXCLUDED(mutex_);
  bool cancelled() const ABSL_LOCKS_EXCLUDED(mutex_);
  absl::Status end_status() const ABSL_LOCKS_EXCLUDED(mutex_);
  int64_t frames_received() const ABSL_LOCKS_EXCLUDED(mutex_);
  // Frames dropped since the last call.
  int64_t TakeDropped() ABSL_LOCKS_EXCLUDED(mutex_);
  // The first of so many numbers for points that the session itself adds.
  uint64_t TakeSerials(int64_t count) ABSL_LOCKS_EXCLUDED(mutex_);
  // Of the next point to be added.
  uint64_t next_serial() const ABSL_LOCKS_EXCLUDED(mutex_);
  // Known from the first frame on.
  ImageSize frame_size() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  struct Pending {
    int64_t index = 0;
    SteadyTime arrival;
    std::string bytes;
    std::vector<WaitingObject> objects;
    std::optional<DecodedFrame> decoded;
  };
  // Whether the resumed session knew already what the stream says now.
  bool IsRepeatedLocked(int64_t frame) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status CheckIndexLocked(int64_t index) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status CheckOpenLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status CheckFrameLocked(const Frame& frame, const absl::StatusOr<ImageSize>& size) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // What AddPoints needs to look at points without the lock.
  absl::StatusOr<std::optional<ImageSize>> SizeIfOpen() const ABSL_LOCKS_EXCLUDED(mutex_);
  // What is wrong with what came before the first frame, once its size is known.
  void CheckFirstLocked(ImageSize size, Violations& violations) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Of a frame that was taken.
  std::vector<WaitingObject> SeedObjectsLocked(std::vector<ObjectQuery> objects) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void DropFromLocked(int64_t index) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  Pending* FindLocked(int64_t index) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  int64_t ReadyLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool FullLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const Options options_;
  mutable absl::Mutex mutex_;
  std::deque<Pending> pending_ ABSL_GUARDED_BY(mutex_);  // consecutive frames
  PointQueue points_ ABSL_GUARDED_BY(mutex_);
  std::vector<WaitingObject> first_objects_ ABSL_GUARDED_BY(mutex_);  // of the first frame, until it comes
  std::optional<ImageSize> frame_size_ ABSL_GUARDED_BY(mutex_);
  int64_t received_ ABSL_GUARDED_BY(mutex_) = 0;  // the index of the frame to come
  bool any_received_ ABSL_GUARDED_BY(mutex_) = false;
  int64_t dropped_ ABSL_GUARDED_BY(mutex_) = 0;
  bool told_full_ ABSL_GUARDED_BY(mutex_) = false;
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;
  bool suspended_ ABSL_GUARDED_BY(mutex_) = false;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  absl::Status end_status_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace holdfast
