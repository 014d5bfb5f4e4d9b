// SPDX-License-Identifier: Apache-2.0
#include "client/final_filter.h"

#include <algorithm>
#include <limits>
#include <vector>

namespace holdfast {
namespace {

int64_t Length(const PointRun& run) { return static_cast<int64_t>(run.x.size()); }
int64_t Length(const ObjectRun& run) { return static_cast<int64_t>(run.samples.size()); }

template <typename Value>
void DropFirst(int64_t count, std::vector<Value>& values) {
  values.erase(values.begin(), values.begin() + count);
}
void DropFirst(int64_t count, PointRun& run) {
  DropFirst(count, run.x);
  DropFirst(count, run.y);
  DropFirst(count, run.visible);
  DropFirst(count, run.confidence);
}
void DropFirst(int64_t count, ObjectRun& run) { DropFirst(count, run.samples); }

// Takes from the runs what 'repeated' says is known: frames of an id before the one that it has there.
template <typename Run, typename Frames>
void CutRepeated(const Frames& repeated, std::vector<Run>& runs) {
  for (Run& run : runs) {
    const auto found = repeated.find(run.id);
    if (found == repeated.end() || found->second <= run.first_frame) continue;
    const int64_t count = std::min(found->second - run.first_frame, Length(run));
    DropFirst(count, run);
    run.first_frame += count;
    run.final_count = std::max<int64_t>(0, run.final_count - count);
  }
  runs.erase(std::remove_if(runs.begin(), runs.end(), [](const Run& run) { return Length(run) == 0; }), runs.end());
}

// Those of frames that no run speaks of any more.
void DropOldTimes(TrackUpdate& update) {
  int64_t first = std::numeric_limits<int64_t>::max();
  for (const PointRun& run : update.runs) first = std::min(first, run.first_frame);
  auto& times = update.capture_times;
  times.erase(times.begin(),
              std::find_if(times.begin(), times.end(), [first](const FrameTime& time) { return time.frame >= first; }));
}

template <typename Run, typename Frames>
void Remember(const std::vector<Run>& runs, Frames& reported) {
  for (const Run& run : runs) {
    if (run.final_count == 0) continue;
    int64_t& before = reported[run.id];
    before = std::max(before, run.first_frame + run.final_count);
  }
}

}  // namespace

void FinalFilter::Apply(TrackUpdate& update) {
  update.frames_received = frames_received_ = std::max(frames_received_, update.frames_received);
  update.frames_processed = frames_processed_ = std::max(frames_processed_, update.frames_processed);
  if (!repeated_.empty()) {
    CutRepeated(repeated_, update.runs);
    DropOldTimes(update);
  }
  if (!repeated_objects_.empty()) CutRepeated(repeated_objects_, update.objects);
  Remember(update.runs, reported_);
  Remember(update.objects, reported_objects_);
}

void FinalFilter::ForgetBefore(int64_t frame) {
  const auto old = [frame](const auto& reported) { return reported.second <= frame; };
  absl::erase_if(reported_, old);
  absl::erase_if(repeated_, old);
  absl::erase_if(reported_objects_, old);
  absl::erase_if(repeated_objects_, old);
}

}  // namespace holdfast
