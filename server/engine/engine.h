// SPDX-License-Identifier: Apache-2.0
// The tracking engine: many sessions, one model, one batch queue. No gRPC, no protobuf; torch stays behind this header.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "api/clock.h"
#include "api/types.h"
#include "server/engine/metrics.h"

namespace holdfast {

enum class Precision { kAuto, kFloat32, kBFloat16 };  // kAuto: bfloat16 where the device computes it faster
enum class Chaining {
  kStandard,   // later windows start with f2 = f4 = f1
  kPublished,  // later windows carry f2 and f4 over, as the published test script does (hop window-1, evaluation only)
};

struct EngineOptions {
  std::string weights_path;
  std::string device = "cpu";  // as LibTorch names it: "cpu", "cuda", "cuda:1"
  Precision precision = Precision::kAuto;
  int compute_threads = 0;                 // threads of one tensor operation; 0: all cores
  int decode_threads = 2;                  // the last free one of several is kept for sessions that use little
  ImageSize processing_size = {512, 384};  // default of sessions; multiples of 32
  int hop_frames = 8;                      // default of sessions
  int iterations = 4;                      // default of sessions
  Chaining chaining = Chaining::kStandard;
  bool motion_prior = true;  // default of sessions; off under kPublished
  bool polish = true;        // default of sessions; off under kPublished
  int max_sessions = 16;
  int max_batch_rows = 256;    // rows of one refinement batch, over all sessions
  int max_batch_frames = 4;    // frames of one encoder batch, over all sessions
  int max_pending_frames = 8;  // accepted frames of a session that are not encoded yet; then PushFrame says "full"
  int64_t cache_budget_bytes = int64_t{4} << 30;  // features of all sessions; a session that would not fit is refused
  int64_t max_processing_pixels = int64_t{1024} * 1024;  // of a session's processing size
  int max_iterations = 16;                               // of a session
  SessionLimits limits{/*max_points=*/2048, /*max_frame_bytes=*/int64_t{16} << 20,
                       /*max_frame_pixels=*/int64_t{3840} * 2160,
                       /*max_frames=*/0};

  absl::Status Validate() const;
};

// Receives what a session produces, on threads of the engine, one call at a time. Calls must return quickly and must
// not destroy the session.
class SessionListener {
 public:
  virtual ~SessionListener() = default;
  virtual void OnTracks(TrackUpdate update) = 0;
  virtual void OnWarning(const absl::Status& warning) = 0;
  // After PushFrame said "full": there is room again. May come before that PushFrame has returned.
  virtual void OnRoomForFrame() = 0;
  // The last call. OK after Finish(), otherwise why the session ended early; its earlier results came before.
  virtual void OnDone(const absl::Status& status, const SessionSummary& summary) = 0;
};

enum class Room { kAvailable, kFull };

// One stream's state. Methods never block and may be called from any thread, in the order the stream has. An
// error of a method ends nothing by itself: the caller decides (a stream ends; see Fail).
class EngineSession {
 public:
  // Cancels, and blocks until the listener is not in use any more: at most as long as the batch that is being computed
  // takes. Not from a call of the listener.
  virtual ~EngineSession() = default;
  virtual const SessionAccepted& accepted() const = 0;
  // Takes the frame and says whether there is room for a next one. REQUIRES: room for this one.
  virtual absl::StatusOr<Room> PushFrame(Frame frame) = 0;
  virtual absl::Status AddPoints(const std::vector<PointQuery>& points) = 0;
  virtual absl::Status RemovePoints(const std::vector<PointId>& ids) = 0;
  // No more frames. Everything pushed so far is tracked and becomes final, then OnDone(OK).
  virtual void Finish() = 0;
  // As Finish, but OnDone carries 'status': nothing already pushed is lost.
  virtual void Fail(absl::Status status) = 0;
  // OnDone(CANCELLED) soon; work not yet begun is dropped.
  virtual void Cancel() = 0;
};

// Thread-safe. Sessions must be destroyed before their engine.
class Engine {
 public:
  // Loads the weights, warms the model up and starts the threads. 'clock' and 'metrics' must outlive the engine.
  static absl::StatusOr<std::unique_ptr<Engine>> Create(const EngineOptions& options, Clock& clock,
                                                        EngineMetrics& metrics);
  virtual ~Engine() = default;
  // INVALID_ARGUMENT with field violations ("config.…"), or an overload error (RESOURCE_EXHAUSTED) at once.
  // 'listener' must outlive the session.
  virtual absl::StatusOr<std::unique_ptr<EngineSession>> OpenSession(const SessionConfig& config,
                                                                     SessionListener& listener) = 0;
  virtual const TrackerInfo& info() const = 0;
};

}  // namespace holdfast
