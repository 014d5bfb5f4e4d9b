// SPDX-License-Identifier: Apache-2.0
// The plain values that callers, the in-process engine and the remote client exchange. No protobuf, no torch.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "api/image_size.h"

namespace holdfast {

// Chosen by the caller, unique within a session.
using PointId = uint64_t;

enum class FrameEncoding {
  kJpeg,
  kPng,
  kRgb24,  // raw, rows top to bottom without padding, 3 bytes a pixel
  kBgr24,  // raw, 3 bytes a pixel
  kGray8,  // raw, 1 byte a pixel
};

inline bool IsRaw(FrameEncoding encoding) {
  return encoding != FrameEncoding::kJpeg && encoding != FrameEncoding::kPng;
}

// "Follow what is here in this frame." Pixels of the caller's frame; (0, 0) is the centre of the first pixel.
struct PointQuery {
  PointId id = 0;
  float x = 0;  // in [0, width - 1]
  float y = 0;  // in [0, height - 1]
};

struct Pixel {
  float x = 0;
  float y = 0;
};

// Chosen by the caller, unique among the objects of a session; at most kMaxObjectId.
using ObjectId = uint32_t;

// "Follow what this covers in this frame": a mask or a polygon. The tracker chooses points on it and follows them as a
// group. Their ids are ObjectPointId(id, 0), ObjectPointId(id, 1)...; a session that has objects gives no others of
// those. Each has a place of its own on the object: where one has left it, another one may be placed (see ObjectPlace).
struct ObjectQuery {
  ObjectId id = 0;
  std::string mask_png;        // of the frame's size; what is not zero in any channel is the object; or
  std::vector<Pixel> polygon;  // its corners in order, inside the frame
  int points = 0;              // to be placed, at most kMaxObjectPoints; 0: 64. Small objects get fewer
  bool reseed = true;          // points that have left are placed anew while the object is in sight
};

constexpr PointId ObjectPointId(ObjectId object, uint32_t index) {
  return PointId{1} << 63 | PointId{object} << 32 | index;
}
constexpr bool IsObjectPoint(PointId id) { return id >> 63 != 0; }
constexpr ObjectId ObjectOf(PointId object_point) { return static_cast<ObjectId>(object_point >> 32 & 0x7FFFFFFF); }
constexpr uint32_t ObjectPointIndex(PointId object_point) { return static_cast<uint32_t>(object_point); }
// The id of the first point at this one's place: indices that are the same modulo kMaxObjectPoints share a place.
constexpr PointId ObjectPlace(PointId object_point) {
  return ObjectPointId(ObjectOf(object_point), ObjectPointIndex(object_point) % kMaxObjectPoints);
}
// The id of the point that is placed where this one was.
constexpr PointId ObjectSuccessor(PointId object_point) { return object_point + kMaxObjectPoints; }
constexpr bool IsPlacedAnew(PointId object_point) { return ObjectPointIndex(object_point) >= kMaxObjectPoints; }

enum class Emit {
  kWindows,     // estimates come when a window has run
  kEveryFrame,  // and besides, each frame is answered once decoded with what optical flow says, which windows revise
};

struct SessionConfig {
  FrameEncoding encoding = FrameEncoding::kJpeg;
  ImageSize raw_size;            // of every frame; required for raw encodings, empty otherwise
  ImageSize frame_size;          // of every frame, as far as it is known; only its shape counts
  ImageSize processing_size;     // multiples of 32; empty: the engine's default, turned as raw_size or frame_size is
  int hop_frames = 0;            // 1..window-1 new frames between windows; 0: the engine's default
  int iterations = 0;            // refinement iterations of a window; 0: the engine's default
  bool send_provisional = true;  // kEveryFrame needs it
  Emit emit = Emit::kWindows;
  std::optional<bool> motion_prior;  // windows start from where optical flow leads; empty: the engine's default
  std::optional<bool> polish;        // final positions are moved to where the picture says; empty: the engine's default
  std::vector<PointQuery> points;    // queried at the first frame
  std::vector<ObjectQuery> objects;  // queried at the first frame
  std::string label;                 // for logs only; at most kMaxLabelBytes
  // A checkpoint comes about every so many frames; 0: only before a planned end.
  int checkpoint_interval_frames = 0;
  // Of a checkpoint: this session goes on where that one was. Options left open are those of that session, others have
  // to be the same; 'points' is ignored, as the token holds them.
  std::string resume_token;
  // Frames will come at this rate: the session is taken only where it can be kept up beside what others were promised.
  // 0: at the pace that there is time for.
  double frames_per_second = 0;
  int expected_points = 0;  // that will be tracked at once, where that is more than 'points'
  // The session gets the least hop of hop_frames .. max_hop_frames at which there is work left for it when it begins,
  // at frames_per_second, and keeps it. A default hop above max_hop_frames counts as that. 0: hop_frames alone.
  int max_hop_frames = 0;
  // The session may hold so many points, where that is less than the engine's limit; 0: that limit. Not of the wire:
  // whoever lets the session in says so.
  int max_points = 0;
};

struct Frame {
  int64_t index = 0;  // 0 for a session's first frame, then +1 each
  std::string bytes;
  std::optional<absl::Time> capture_time;
  std::vector<PointQuery> points;    // queried at this very frame
  std::vector<ObjectQuery> objects;  // queried at this very frame
};

// Estimates of one point on consecutive frames first_frame .. first_frame + x.size() - 1.
struct PointRun {
  PointId id = 0;
  int64_t first_frame = 0;
  std::vector<float> x;           // pixels of the caller's frame
  std::vector<float> y;           // pixels of the caller's frame
  std::vector<uint8_t> visible;   // 0 or 1
  std::vector<float> confidence;  // [0, 1]; of being visible and right where weights are calibrated; flow's is no fit
  int64_t final_count = 0;        // the first final_count frames of the run will never be revised
};

struct FrameTime {
  int64_t frame = 0;
  absl::Time capture_time;
};

// What an object's points say about it on one frame. A place q of the frame it was queried at has moved to
// centre + scale R(rotation) (q - centre of that frame). Where too few points are seen to tell, it stands still.
struct ObjectSample {
  Pixel centre;                // pixels of the caller's frame, of what the mask or polygon covered
  float scale = 1;             // since the query
  float rotation = 0;          // radians since the query, from x towards y
  float visible = 0;           // share of the points that it still has which are visible
  std::vector<Pixel> outline;  // convex, at most kMaxOutlineCorners corners
  std::vector<PointId> left;   // its points that do not move with it any more, ascending
  // Its points that were placed anew, at the frame before this one, ascending. Of each the one whose place it has taken
  // ends within a window, and until then is among 'left'.
  std::vector<PointId> joined;
};

// An object on consecutive frames first_frame .. first_frame + samples.size() - 1.
struct ObjectRun {
  ObjectId id = 0;
  int64_t first_frame = 0;
  std::vector<ObjectSample> samples;
  int64_t final_count = 0;  // the first final_count samples will never be revised
};

struct TrackUpdate {
  std::vector<PointRun> runs;
  int64_t frames_received = 0;           // watermark: frames accepted so far
  int64_t frames_processed = 0;          // watermark: frames whose features are computed
  std::vector<FrameTime> capture_times;  // of the frames of 'runs' that came with one, ascending
  std::vector<ObjectRun> objects;
};

struct SessionLimits {
  int max_points = 0;
  int64_t max_frame_bytes = 0;
  int64_t max_frame_pixels = 0;
  int64_t max_frames = 0;         // 0: endless
  int max_objects = kMaxObjects;  // 0: of a server that knows none
};

// What the tracker agreed to; sent once before any update.
struct SessionAccepted {
  std::string session_id;
  ImageSize processing_size;
  int hop_frames = 0;
  int iterations = 0;
  int window_frames = 0;
  Emit emit = Emit::kWindows;
  bool motion_prior = false;
  bool polish = false;
  SessionLimits limits;
  int64_t first_frame = 0;             // of a resumed session: where to begin; earlier frames are ignored
  int checkpoint_interval_frames = 0;  // 0: only before a planned end
  // The most frames that the newest checkpoint may lie behind the newest frame that was tracked: who wants to resume
  // keeps so many, and checkpoint_interval_frames more. 0: this session has no checkpoints.
  int replay_frames = 0;
  std::string trace_id;  // of a remote session: the trace that it belongs to, 32 hexadecimal digits
  std::string server;    // the remote one's address
};

// All that is needed to go on elsewhere, beside the frames from next_frame on.
struct Checkpoint {
  std::string token;       // opaque; empty: this session has outgrown what a token can hold
  int64_t next_frame = 0;  // the first frame to send again
  bool resumable = false;  // by other servers too, and after a restart; otherwise by this process only
};

struct SessionSummary {
  int64_t frames = 0;         // frames tracked
  int64_t points = 0;         // points ever added
  int64_t final_samples = 0;  // (point, frame) pairs made final
};

// What a tracker is doing now. Work is in point-frames a second: one point followed through one frame with the default
// hop and iterations; a frame counts for frame_work of them, whatever its points (at the default processing size).
struct TrackerLoad {
  int sessions = 0;          // open
  int64_t points = 0;        // tracked, over all sessions
  double work_promised = 0;  // to the open sessions
  double work_budget = 0;    // that may be promised, as measured; infinite: nothing bounds it
  double frame_work = 0;
};

struct TrackerInfo {
  std::string model_name;
  std::string preset;          // a preset's name, or "custom"
  std::string weights_sha256;  // hex
  std::string precision;       // "float32" or "bfloat16"
  std::string device;          // "cpu", "cuda:0"
  std::string build;           // version of the program
  ImageSize default_processing_size;
  int window_frames = 0;
  int default_hop_frames = 0;
  int default_iterations = 0;
  bool default_motion_prior = false;
  bool default_polish = false;
  bool calibrated_confidence = false;  // confidence is the probability of being visible and right
  int max_sessions = 0;
  SessionLimits limits;
  TrackerLoad load;
};

}  // namespace holdfast
