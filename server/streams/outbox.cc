// SPDX-License-Identifier: Apache-2.0
#include "server/streams/outbox.h"

#include <algorithm>
#include <limits>
#include <set>
#include <utility>
#include <vector>

namespace holdfast {

void Outbox::Add(TrackUpdate update) {
  for (PointRun& run : update.runs) points_.Add(std::move(run));
  for (ObjectRun& run : update.objects) objects_.Add(std::move(run));
  for (const FrameTime& time : update.capture_times) capture_times_.emplace(time.frame, time.capture_time);
  frames_received_ = std::max(frames_received_, update.frames_received);
  frames_processed_ = std::max(frames_processed_, update.frames_processed);
  watermark_changed_ = frames_received_ != sent_received_ || frames_processed_ != sent_processed_;
}

TrackUpdate Outbox::Take(int64_t max_bytes) {
  TrackUpdate update;
  if (!points_.empty()) update.runs = points_.Take(max_bytes, /*any=*/true);
  // Behind the points that they speak of.
  if (points_.empty() && !objects_.empty()) update.objects = objects_.Take(max_bytes, /*any=*/update.runs.empty());
  AddCaptureTimes(update);
  DropCaptureTimes();
  if (points_.empty() && objects_.empty()) {
    sent_received_ = frames_received_;
    sent_processed_ = frames_processed_;
    watermark_changed_ = false;
  }
  update.frames_received = sent_received_;
  update.frames_processed = sent_processed_;
  return update;
}

// Of the frames of its runs.
void Outbox::AddCaptureTimes(TrackUpdate& update) {
  if (capture_times_.empty()) return;
  std::set<int64_t> frames;
  for (const PointRun& run : update.runs) {
    for (size_t i = 0; i < run.x.size(); ++i) frames.insert(run.first_frame + static_cast<int64_t>(i));
  }
  for (const int64_t frame : frames) {
    const auto found = capture_times_.find(frame);
    if (found != capture_times_.end()) update.capture_times.push_back({frame, found->second});
  }
}

// Of frames whose results do not wait any more.
void Outbox::DropCaptureTimes() {
  int64_t oldest = std::numeric_limits<int64_t>::max();
  for (const PointRun& run : points_.runs()) oldest = std::min(oldest, run.first_frame);
  capture_times_.erase(capture_times_.begin(), capture_times_.lower_bound(oldest));
}

}  // namespace holdfast
