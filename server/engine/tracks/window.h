// SPDX-License-Identifier: Apache-2.0
// Which window of frames a point is refined in next, and what is final afterwards. Arithmetic only: no threads, no
// features. Letters: S frames of a window, h hop, q the frame a point is queried at, s_k = q + k h.
#pragma once

#include <cstdint>
#include <optional>

namespace holdfast {

struct WindowOptions {
  int64_t frames = 24;  // S, at least 2
  int64_t hop = 8;      // h, 1 .. S - 1
  bool early = true;    // run the first window every h frames until it is full
  // Frames that become final wait for their polished positions.
  bool polish = false;
  // The last window may revise estimates of the window before it, as the published script does: they stay provisional
  // for longer.
  bool revise_last = false;
};

enum class WindowKind {
  kEarly,  // the first window before it is full
  kFull,   // s_k .. s_k + S - 1; with a hop of S - 1 it makes all of them final, and runs once the next frame is there
  kLast,   // at the end of the stream: shifted back to end on the last frame, or the first window of a short clip
};

struct WindowPlan {
  WindowKind kind = WindowKind::kFull;
  int64_t first = 0;         // frame at position 0
  int64_t last = 0;          // newest frame; the positions up to S - 1 that follow it repeat it
  bool from_query = false;   // starts as the query repeated; otherwise from the estimates there are
  int64_t final_before = 0;  // frames before this one are final once the window has run

  friend bool operator==(const WindowPlan& a, const WindowPlan& b) {
    return a.kind == b.kind && a.first == b.first && a.last == b.last && a.from_query == b.from_query &&
           a.final_before == b.final_before;
  }
};

// The windows of one point, in order. Use: while (plan = Next(...)) { run it; Ran(*plan); }
class WindowSchedule {
 public:
  WindowSchedule(const WindowOptions& options, int64_t query_frame)
      : WindowSchedule(options, query_frame, query_frame, query_frame) {}
  // One that goes on: see next_start() and covered().
  WindowSchedule(const WindowOptions& options, int64_t query_frame, int64_t next_start, int64_t covered)
      : options_(options), query_(query_frame), next_start_(next_start), covered_(covered) {}

  // The window to run when frames up to 'newest' are there; 'ended': none will follow. Empty: nothing to do, which at
  // the end of the stream means that every frame has its last estimate.
  std::optional<WindowPlan> Next(int64_t newest, bool ended) const;
  // REQUIRES: 'plan' came from Next and no other window ran since.
  void Ran(const WindowPlan& plan);

  // s_k of the next full window. No window to come needs a frame before this one, save the last, which needs S frames.
  int64_t next_start() const { return next_start_; }
  // The newest frame that a window has covered; the query's before the first one.
  int64_t covered() const { return covered_; }
  bool began() const { return next_start_ > query_; }  // a full window has run
  // No window to come starts from an estimate before this frame.
  int64_t oldest_start() const { return began() ? next_start_ - options_.hop : query_; }

 private:
  WindowPlan First(WindowKind kind, int64_t last) const;
  WindowPlan Full() const;
  WindowPlan Shifted(int64_t last) const;

  WindowOptions options_;
  int64_t query_;
  int64_t next_start_;
  int64_t covered_;
};

}  // namespace holdfast
