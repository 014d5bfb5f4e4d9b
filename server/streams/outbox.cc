// SPDX-License-Identifier: Apache-2.0
#include "server/streams/outbox.h"

#include <algorithm>
#include <limits>
#include <set>
#include <utility>
#include <vector>

namespace holdfast {
namespace {

constexpr int64_t kSampleBytes = 13;  // x, y, visible, confidence
constexpr int64_t kRunBytes = 48;     // id, first frame, final count, lengths

int64_t Length(const PointRun& run) { return static_cast<int64_t>(run.x.size()); }
int64_t Bytes(const PointRun& run) { return kRunBytes + kSampleBytes * Length(run); }

// Writes 'from' over 'to' beginning at index 'at' <= to.size().
template <typename T>
void Overwrite(std::vector<T>& to, const std::vector<T>& from, int64_t at) {
  to.resize(std::max(to.size(), static_cast<size_t>(at) + from.size()));
  std::copy(from.begin(), from.end(), to.begin() + at);
}

// As Merge, where 'newer' begins first.
bool Prepend(PointRun& older, const PointRun& newer) {
  const int64_t covered = newer.first_frame + Length(newer) - older.first_frame;
  if (covered < 0 || older.final_count > 0) return false;
  PointRun merged = newer;
  const auto append = [covered](auto& to, const auto& from) {
    if (covered < static_cast<int64_t>(from.size())) to.insert(to.end(), from.begin() + covered, from.end());
  };
  append(merged.x, older.x);
  append(merged.y, older.y);
  append(merged.visible, older.visible);
  append(merged.confidence, older.confidence);
  older = std::move(merged);
  return true;
}

// Makes 'older' say what it and then 'newer' say. False, and nothing happens, where one run cannot: there is a gap
// between them, or the final samples would not be the first ones.
bool Merge(PointRun& older, const PointRun& newer) {
  const int64_t kept = newer.first_frame - older.first_frame;
  if (kept < 0) return Prepend(older, newer);
  if (kept > Length(older)) return false;
  // A run counts its final samples from its beginning. Where the newer run begins among or right behind the older
  // one's, its own go on from there, and must not be fewer: what was final stays so. Where it begins further on,
  // provisional samples lie between, and final ones behind those could not be counted.
  const int64_t finals = kept <= older.final_count ? kept + newer.final_count : older.final_count;
  if (kept <= older.final_count ? finals < older.final_count : newer.final_count > 0) return false;
  Overwrite(older.x, newer.x, kept);
  Overwrite(older.y, newer.y, kept);
  Overwrite(older.visible, newer.visible, kept);
  Overwrite(older.confidence, newer.confidence, kept);
  older.final_count = finals;
  return true;
}

template <typename T>
std::vector<T> TakeFirst(std::vector<T>& from, int64_t count) {
  std::vector<T> first(from.begin(), from.begin() + count);
  from.erase(from.begin(), from.begin() + count);
  return first;
}

}  // namespace

void Outbox::Add(TrackUpdate update) {
  for (PointRun& run : update.runs) AddRun(std::move(run));
  for (const FrameTime& time : update.capture_times) capture_times_.emplace(time.frame, time.capture_time);
  frames_received_ = std::max(frames_received_, update.frames_received);
  frames_processed_ = std::max(frames_processed_, update.frames_processed);
  watermark_changed_ = frames_received_ != sent_received_ || frames_processed_ != sent_processed_;
}

// Only a point's newest run can take more in: an older one was left behind by a run that did not fit it, and order
// among the runs of a point is what tells a reader which estimate revises which.
void Outbox::AddRun(PointRun run) {
  const auto found = newest_.find(run.id);
  if (found != newest_.end()) {
    PointRun& older = *found->second;
    const int64_t before = Bytes(older);
    if (Merge(older, run)) {
      bytes_ += Bytes(older) - before;
      return;
    }
  }
  bytes_ += Bytes(run);
  runs_.push_back(std::move(run));
  newest_[runs_.back().id] = std::prev(runs_.end());
}

TrackUpdate Outbox::Take(int64_t max_bytes) {
  TrackUpdate update;
  int64_t left = max_bytes;
  while (!runs_.empty() && Bytes(runs_.front()) <= left) {
    left -= Bytes(runs_.front());
    update.runs.push_back(TakeFront());
  }
  if (update.runs.empty() && !runs_.empty()) {
    update.runs.push_back(SplitFront(std::max<int64_t>(1, (max_bytes - kRunBytes) / kSampleBytes)));
  }
  AddCaptureTimes(update);
  DropCaptureTimes();
  if (runs_.empty()) {
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
    for (int64_t i = 0; i < Length(run); ++i) frames.insert(run.first_frame + i);
  }
  for (const int64_t frame : frames) {
    const auto found = capture_times_.find(frame);
    if (found != capture_times_.end()) update.capture_times.push_back({frame, found->second});
  }
}

// Of frames whose results do not wait any more.
void Outbox::DropCaptureTimes() {
  int64_t oldest = std::numeric_limits<int64_t>::max();
  for (const PointRun& run : runs_) oldest = std::min(oldest, run.first_frame);
  capture_times_.erase(capture_times_.begin(), capture_times_.lower_bound(oldest));
}

PointRun Outbox::TakeFront() {
  const auto found = newest_.find(runs_.front().id);
  if (found != newest_.end() && found->second == runs_.begin()) newest_.erase(found);
  PointRun run = std::move(runs_.front());
  bytes_ -= Bytes(run);
  runs_.pop_front();
  if (marked_ > 0) --marked_;
  return run;
}

// The first 'frames' samples of the front run; the rest stays.
PointRun Outbox::SplitFront(int64_t frames) {
  PointRun& rest = runs_.front();
  if (Length(rest) <= frames) return TakeFront();
  PointRun first;
  first.id = rest.id;
  first.first_frame = rest.first_frame;
  first.x = TakeFirst(rest.x, frames);
  first.y = TakeFirst(rest.y, frames);
  first.visible = TakeFirst(rest.visible, frames);
  first.confidence = TakeFirst(rest.confidence, frames);
  first.final_count = std::min(rest.final_count, frames);
  rest.first_frame += frames;
  rest.final_count -= first.final_count;
  bytes_ -= kSampleBytes * frames;
  return first;
}

}  // namespace holdfast
