// SPDX-License-Identifier: Apache-2.0
// The events the engine reports, without a metrics library. Implementations are thread-safe and quick.
#pragma once

#include <cstdint>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "absl/types/span.h"
#include "api/types.h"

namespace holdfast {

enum class Stage { kDecode, kFlow, kQueue, kEncode, kRefine, kEmit };
// As metrics and traces have it.
inline const char* StageName(Stage stage) {
  switch (stage) {
    case Stage::kDecode:
      return "decode";
    case Stage::kFlow:
      return "flow";
    case Stage::kQueue:
      return "queue";
    case Stage::kEncode:
      return "encode";
    case Stage::kRefine:
      return "refine";
    case Stage::kEmit:
      return "emit";
  }
  return "other";
}

enum class SessionOutcome {
  kCompleted,
  kFailed,       // by a fault of the server
  kClientError,  // by what the client sent, or did not send
  kCancelled,    // the client went away
  kSuspended,    // by a planned end; who resumes it begins another session
};
enum class FrameResult { kTracked, kRejected, kDropped };
enum class RejectReason { kSessions, kMemory, kWork };

class EngineMetrics {
 public:
  virtual ~EngineMetrics() = default;
  virtual void SessionOpened() = 0;
  virtual void SessionClosed(SessionOutcome outcome) = 0;
  virtual void AdmissionRejected(RejectReason reason) = 0;
  virtual void PointsActive(int64_t delta) = 0;  // change of the number of points tracked now
  virtual void FrameDone(FrameResult result) = 0;
  virtual void StageTook(Stage stage, absl::Duration duration) = 0;
  virtual void FirstEstimate(absl::Duration since_arrival) = 0;     // of a frame
  virtual void FinalEstimate(absl::Duration since_arrival) = 0;     // of a frame
  virtual void SessionLag(int64_t frames) = 0;                      // received but not processed, seen at each frame
  virtual void BatchRefined(absl::Span<const int> iterations) = 0;  // of each row of a batch
  virtual void CacheBytes(int64_t bytes) = 0;                       // features held now, all sessions
  // Point-frames a second (see WorkMeter): what there is time for, and what sessions were promised of it.
  virtual void WorkBudget(double work) = 0;
  virtual void WorkPromised(double work) = 0;
  // Frames of this processing size are computed in float32 though bfloat16 would be faster: 'why' says how far apart
  // the two were. Once a size.
  virtual void PrecisionFellBack(ImageSize size, absl::string_view why) = 0;
};

class NullEngineMetrics : public EngineMetrics {
 public:
  void SessionOpened() override {}
  void SessionClosed(SessionOutcome) override {}
  void AdmissionRejected(RejectReason) override {}
  void PointsActive(int64_t) override {}
  void FrameDone(FrameResult) override {}
  void StageTook(Stage, absl::Duration) override {}
  void FirstEstimate(absl::Duration) override {}
  void FinalEstimate(absl::Duration) override {}
  void SessionLag(int64_t) override {}
  void BatchRefined(absl::Span<const int>) override {}
  void CacheBytes(int64_t) override {}
  void WorkBudget(double) override {}
  void WorkPromised(double) override {}
  void PrecisionFellBack(ImageSize, absl::string_view) override {}
};

}  // namespace holdfast
