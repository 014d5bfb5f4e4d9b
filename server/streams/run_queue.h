// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <list>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "api/types.h"

namespace holdfast {

// Runs that wait to be sent, of points or of objects, coalesced by id: newer estimates replace older ones of the same
// frames, final ones are appended. Not thread-safe.
template <typename Run>
class RunQueue {
 public:
  using Runs = std::list<Run>;

  void Add(Run run);
  const Runs& runs() const { return runs_; }
  bool empty() const { return runs_.empty(); }
  int64_t bytes() const { return bytes_; }  // about what the runs take in messages
  // The oldest runs, about 'max_bytes' of them; what is taken is taken off 'max_bytes'. 'any': at least one sample.
  // REQUIRES: not empty where any.
  std::vector<Run> Take(int64_t& max_bytes, bool any);
  // Remembers the runs that wait now, and whether any of them still do.
  void Mark() { marked_ = runs_.size(); }
  bool marked_waits() const { return marked_ > 0; }

 private:
  Run TakeFront();
  Run SplitFront(int64_t frames);

  Runs runs_;  // in the order they have to be sent
  absl::flat_hash_map<decltype(Run::id), typename std::list<Run>::iterator> newest_;  // of each id in runs_
  size_t marked_ = 0;                                                                 // so many of the first runs_
  int64_t bytes_ = 0;
};

namespace run_queue_internal {

constexpr int64_t kRunBytes = 48;  // id, first frame, final count, lengths

inline int64_t Length(const PointRun& run) { return static_cast<int64_t>(run.x.size()); }
inline int64_t Length(const ObjectRun& run) { return static_cast<int64_t>(run.samples.size()); }

// Of one sample, x, y, visible, confidence; of an object's, the largest there is.
constexpr int64_t kSampleBytes = 13;
inline int64_t SampleBytes(const PointRun&) { return kSampleBytes; }
inline int64_t SampleBytes(const ObjectRun& run) {
  int64_t most = 0;
  for (const ObjectSample& sample : run.samples) {
    const auto corners = static_cast<int64_t>(sample.outline.size()), left = static_cast<int64_t>(sample.left.size());
    most = std::max(most, 32 + 8 * corners + 10 * left);
  }
  return most;
}
template <typename Run>
int64_t Bytes(const Run& run) {
  return kRunBytes + SampleBytes(run) * Length(run);
}

// Calls visit(to's values, from's values) for each kind of value that the samples of a run have.
template <typename To, typename From, typename Visit>
void EachColumn(To& to, From& from, Visit visit) {
  if constexpr (std::is_same_v<std::remove_const_t<To>, ObjectRun>) {
    visit(to.samples, from.samples);
  } else {
    visit(to.x, from.x);
    visit(to.y, from.y);
    visit(to.visible, from.visible);
    visit(to.confidence, from.confidence);
  }
}

// As Merge, where 'newer' begins first.
template <typename Run>
bool Prepend(Run& older, const Run& newer) {
  const int64_t covered = newer.first_frame + Length(newer) - older.first_frame;
  if (covered < 0 || older.final_count > 0) return false;
  Run merged = newer;
  EachColumn(merged, older, [covered](auto& to, const auto& from) {
    if (covered < static_cast<int64_t>(from.size())) to.insert(to.end(), from.begin() + covered, from.end());
  });
  older = std::move(merged);
  return true;
}

// Makes 'older' say what it and then 'newer' say. False, and nothing happens, where one run cannot: there is a gap
// between them, or the final samples would not be the first ones.
template <typename Run>
bool Merge(Run& older, const Run& newer) {
  const int64_t kept = newer.first_frame - older.first_frame;
  if (kept < 0) return Prepend(older, newer);
  if (kept > Length(older)) return false;
  // A run counts its final samples from its beginning. Where the newer run begins among or right behind the older
  // one's, its own go on from there, and must not be fewer: what was final stays so. Where it begins further on,
  // provisional samples lie between, and final ones behind those could not be counted.
  const int64_t finals = kept <= older.final_count ? kept + newer.final_count : older.final_count;
  if (kept <= older.final_count ? finals < older.final_count : newer.final_count > 0) return false;
  EachColumn(older, newer, [kept](auto& to, const auto& from) {
    to.resize(std::max(to.size(), static_cast<size_t>(kept) + from.size()));
    std::copy(from.begin(), from.end(), to.begin() + kept);
  });
  older.final_count = finals;
  return true;
}

}  // namespace run_queue_internal

// Only an id's newest run can take more in: an older one was left behind by a run that did not fit it, and order among
// the runs of an id is what tells a reader which estimate revises which.
template <typename Run>
void RunQueue<Run>::Add(Run run) {
  using namespace run_queue_internal;
  const auto found = newest_.find(run.id);
  if (found != newest_.end()) {
    Run& older = *found->second;
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

template <typename Run>
std::vector<Run> RunQueue<Run>::Take(int64_t& max_bytes, bool any) {
  using namespace run_queue_internal;
  std::vector<Run> taken;
  int64_t left = max_bytes;
  while (!runs_.empty() && Bytes(runs_.front()) <= left) {
    left -= Bytes(runs_.front());
    taken.push_back(TakeFront());
  }
  if (taken.empty() && any) {
    taken.push_back(SplitFront(std::max<int64_t>(1, (max_bytes - kRunBytes) / SampleBytes(runs_.front()))));
    left = 0;
  }
  max_bytes = left;
  return taken;
}

template <typename Run>
Run RunQueue<Run>::TakeFront() {
  const auto found = newest_.find(runs_.front().id);
  if (found != newest_.end() && found->second == runs_.begin()) newest_.erase(found);
  Run run = std::move(runs_.front());
  bytes_ -= run_queue_internal::Bytes(run);
  runs_.pop_front();
  if (marked_ > 0) --marked_;
  return run;
}

// The first 'frames' samples of the front run; the rest stays.
template <typename Run>
Run RunQueue<Run>::SplitFront(int64_t frames) {
  using namespace run_queue_internal;
  Run& rest = runs_.front();
  if (Length(rest) <= frames) return TakeFront();
  bytes_ -= Bytes(rest);
  Run first;
  first.id = rest.id;
  first.first_frame = rest.first_frame;
  EachColumn(first, rest, [frames](auto& to, auto& from) {
    to.assign(std::make_move_iterator(from.begin()), std::make_move_iterator(from.begin() + frames));
    from.erase(from.begin(), from.begin() + frames);
  });
  first.final_count = std::min(rest.final_count, frames);
  rest.first_frame += frames;
  rest.final_count -= first.final_count;
  bytes_ += Bytes(rest);
  return first;
}

}  // namespace holdfast
