// SPDX-License-Identifier: Apache-2.0
#include "server/engine/session_flow.h"

#include <algorithm>
#include <utility>

#include "server/engine/tracks/confidence.h"

namespace holdfast {
namespace {

constexpr float kMaxRoundTrip = 2;  // pixels of a picture 512 wide
// What is left of the confidence after a frame that flow carried a point over, and after one where it lost it.
constexpr float kHeldConfidence = 0.99f;
constexpr float kLostConfidence = 0.5f;
// Pixels of the pictures in which points are looked for in one step, a picture a point; one of a million or fewer takes
// some 5 ms. Others want the thread too.
constexpr int64_t kSearchedPixels = 4'000'000;
constexpr int64_t kLeastPixels = 1'000'000;

float ConfidenceAfter(float before, const FlowStep& step) {
  return before * (step.held ? kHeldConfidence : kLostConfidence);
}

int64_t SearchesOfAStep(ImageSize picture) {
  return std::max<int64_t>(kSearchedPixels / std::max(Pixels(picture), kLeastPixels), 1);
}

}  // namespace

void SessionFlow::SetGeometry(const FrameGeometry& geometry, const Scale& scale) {
  absl::MutexLock lock(&mutex_);
  geometry_ = geometry;
  scale_ = scale;
}

void SessionFlow::AddFrame(int64_t index, FlowPyramidPtr pyramid) {
  absl::MutexLock lock(&mutex_);
  if (closed_ || index < oldest_) return;
  const size_t at = static_cast<size_t>(index - oldest_);
  if (pyramids_.size() <= at) pyramids_.resize(at + 1);
  pyramids_[at] = std::move(pyramid);
  while (without_gap_ - oldest_ < static_cast<int64_t>(pyramids_.size()) &&
         pyramids_[without_gap_ - oldest_] != nullptr)
    ++without_gap_;
}

bool SessionFlow::BeginSteps() {
  absl::MutexLock lock(&mutex_);
  if (closed_) return false;
  news_ = true;
  if (stepping_) return false;
  stepping_ = true;
  news_ = false;
  return true;
}

bool SessionFlow::EndSteps() {
  absl::MutexLock lock(&mutex_);
  if (news_ && !closed_) {
    news_ = false;
    return false;
  }
  stepping_ = false;
  return true;
}

bool SessionFlow::Step() {
  CutPatches();
  Work work;
  {
    absl::MutexLock lock(&mutex_);
    work = NextWorkLocked();
  }
  if (work.heads.empty()) return false;
  std::vector<FlowPoint> points;
  for (const Head& head : work.heads) points.push_back(head.at);
  const std::vector<FlowStep> steps =
      CarryPoints(*work.from, *work.to, points, FlowPixels(kMaxRoundTrip, work.from->size()));
  absl::MutexLock lock(&mutex_);
  GrowLocked(work, steps);
  return true;
}

bool SessionFlow::Search() {
  std::vector<Doubt> doubts;
  {
    absl::MutexLock lock(&mutex_);
    doubts = NextDoubtsLocked();
  }
  if (doubts.empty()) return false;
  std::vector<LostChain> chains;
  for (Doubt& doubt : doubts) {
    doubt.chain.patch = &doubt.patch->Get();
    chains.push_back(std::move(doubt.chain));
  }
  FindAgain(absl::MakeSpan(chains), FlowPixels(kMaxRoundTrip, chains[0].pictures.back()->size()));
  absl::MutexLock lock(&mutex_);
  for (size_t i = 0; i < doubts.size(); ++i) {
    doubts[i].chain = std::move(chains[i]);
    FoundLocked(doubts[i]);
  }
  return true;
}

void SessionFlow::CutPatches() {
  std::vector<std::shared_ptr<QueryPatch>> uncut;
  {
    absl::MutexLock lock(&mutex_);
    uncut.swap(uncut_);
  }
  for (const std::shared_ptr<QueryPatch>& patch : uncut) (void)patch->Get();
}

const FlowPatch& SessionFlow::QueryPatch::Get() {
  absl::MutexLock lock(&mutex_);
  if (picture_ != nullptr) {
    patch_ = CutPatch(*picture_, at_);
    picture_.reset();
  }
  return patch_;
}

SessionFlow::Work SessionFlow::NextWorkLocked() const {
  Work work;
  work.frame = std::numeric_limits<int64_t>::max();
  const auto consider = [&](uint64_t serial, const Entry& entry, const Chain& chain, bool live) {
    mutex_.AssertHeld();
    if (!CanGrowLocked(entry, chain) || chain.head() > work.frame) return;
    if (chain.head() < work.frame) work.heads.clear();
    work.frame = chain.head();
    work.heads.push_back({serial, entry.generation, live, chain.points.back()});
  };
  for (const auto& [serial, entry] : entries_) {
    if (options_.starts || !entry.live) consider(serial, entry, entry.chain, false);
    if (entry.live) consider(serial, entry, *entry.live, true);
  }
  if (work.heads.empty()) return work;
  work.from = pyramids_[work.frame - oldest_];
  work.to = pyramids_[work.frame + 1 - oldest_];
  return work;
}

bool SessionFlow::CanGrowLocked(const Entry& entry, const Chain& chain) const {
  if (!options_.starts && !options_.live) return false;
  const bool reported = options_.live && (!entry.live || &chain == &*entry.live);
  const int64_t wanted = reported ? NewestLocked() : std::min(NewestLocked(), chain.until);
  return chain.head() >= oldest_ && chain.head() < std::min(wanted, entry.last_frame);
}

SessionFlow::Entry* SessionFlow::EntryOfLocked(const Head& head) {
  const auto found = entries_.find(head.serial);
  return found != entries_.end() && found->second.generation == head.generation ? &found->second : nullptr;
}

void SessionFlow::GrowLocked(const Work& work, absl::Span<const FlowStep> steps) {
  for (size_t i = 0; i < work.heads.size(); ++i) {
    const Head& head = work.heads[i];
    Entry* const entry = EntryOfLocked(head);
    if (entry == nullptr) continue;
    Chain& chain = head.live ? *entry->live : entry->chain;
    chain.Grow(steps[i]);
    if (!head.live) chain.doubted = chain.doubted || InDoubtLocked(*entry, chain);
  }
}

void SessionFlow::Chain::Grow(const FlowStep& step) {
  points.push_back(step.at);
  confidence.push_back(ConfidenceAfter(confidence.back(), step));
  assurance = ConfidenceAfter(assurance, step);
}

bool SessionFlow::InDoubtLocked(const Entry& entry, const Chain& chain) const {
  return options_.starts && entry.patch != nullptr && chain.search && chain.head() == chain.until &&
         chain.first < chain.until && chain.first >= oldest_ && chain.assurance < kDoubtBelow;
}

std::vector<SessionFlow::Doubt> SessionFlow::NextDoubtsLocked() const {
  std::vector<Doubt> doubts;
  int64_t until = 0;
  for (const auto& [serial, entry] : entries_) {
    const Chain& chain = entry.chain;
    if (!chain.doubted || chain.first < oldest_ || (!doubts.empty() && chain.until != until)) continue;
    until = chain.until;
    Doubt doubt{{serial, entry.generation, /*live=*/false, chain.points.back()}, entry.patch, {}};
    doubt.chain.points.assign(chain.points.begin(), chain.points.begin() + (until - chain.first + 1));
    const auto pictures = pyramids_.begin() + (chain.first - oldest_);
    doubt.chain.pictures.assign(pictures, pictures + static_cast<ptrdiff_t>(doubt.chain.points.size()));
    doubts.push_back(std::move(doubt));
    if (static_cast<int64_t>(doubts.size()) == SearchesOfAStep(doubts[0].chain.pictures.back()->size())) break;
  }
  return doubts;
}

// Where the point has been found is kept beside the chain: a window that ends earlier, as the point's last one may,
// starts from what was known without.
void SessionFlow::FoundLocked(const Doubt& doubt) {
  Entry* const entry = EntryOfLocked(doubt.head);
  if (entry == nullptr) return;
  Chain& chain = entry->chain;
  chain.doubted = false;
  if (!doubt.chain.found) return;
  chain.found = doubt.chain.points;
  // What is reported goes on from there.
  if (chain.head() == chain.until) chain.points.back() = chain.found.back();
}

std::vector<PointRun> SessionFlow::TakeLive(int64_t newest) {
  std::vector<PointRun> runs;
  absl::MutexLock lock(&mutex_);
  if (!options_.live) return runs;
  for (auto& [serial, entry] : entries_) {
    const Chain& chain = entry.live ? *entry.live : entry.chain;
    const int64_t end = std::min({chain.head(), newest, entry.stop - 1}) + 1;
    if (entry.report_from < chain.first || entry.report_from >= end) continue;
    runs.push_back(RunOf(entry, chain, end));
    entry.report_from = end;
  }
  return runs;
}

PointRun SessionFlow::RunOf(const Entry& entry, const Chain& chain, int64_t end) const {
  PointRun run;
  run.id = entry.query.id;
  run.first_frame = entry.report_from;
  for (int64_t frame = entry.report_from; frame < end; ++frame) {
    const Position at = ToFeatures(chain.points[frame - chain.first]);
    const float confidence = chain.confidence[frame - chain.first];
    const bool queried = frame == entry.query_frame;
    run.x.push_back(queried ? entry.query.x : geometry_.ToFrameX(at));
    run.y.push_back(queried ? entry.query.y : geometry_.ToFrameY(at));
    run.confidence.push_back(confidence);
    run.visible.push_back(confidence > options_.visible_above && geometry_.Inside(at) ? 1 : 0);
  }
  return run;
}

int64_t SessionFlow::NewestLocked() const { return without_gap_ - 1; }

int64_t SessionFlow::newest() const {
  absl::MutexLock lock(&mutex_);
  return NewestLocked();
}

void SessionFlow::Apply(absl::Span<const PointOp> ops) {
  absl::MutexLock lock(&mutex_);
  if (closed_) return;
  for (const PointOp& op : ops) {
    if (op.kind == PointOp::Kind::kSeed) {
      EndLocked(op.query.id, /*last_frame=*/op.frame, /*stop=*/op.frame);
      SeedLocked(op);
    } else {
      EndLocked(op.query.id, op.frame, op.frame + 1);
    }
  }
}

void SessionFlow::SeedLocked(const PointOp& op) {
  Entry entry;
  entry.query = op.query;
  entry.query_frame = entry.report_from = op.frame;
  const FlowPoint at = ToFlow(geometry_.ToFeatures(op.query.x, op.query.y));
  entry.chain.first = op.frame;
  entry.chain.points = {at};
  entry.chain.confidence = {1.0f};
  entry.chain.until = op.frame + options_.window_frames - 1;
  // Memory may have been short for the picture; the session is about to end then.
  if (options_.patches && op.frame >= oldest_ && op.frame < without_gap_) {
    entry.patch = std::make_shared<QueryPatch>(pyramids_[op.frame - oldest_], at);
    uncut_.push_back(entry.patch);
  }
  entries_.emplace(op.serial, std::move(entry));
  newest_[op.query.id] = op.serial;
}

void SessionFlow::StartAt(int64_t frame) {
  absl::MutexLock lock(&mutex_);
  oldest_ = without_gap_ = frame;
}

void SessionFlow::Restore(Restored point) {
  absl::MutexLock lock(&mutex_);
  SeedLocked(point.seed);
  Entry& entry = entries_.at(point.seed.serial);
  if (point.patch) entry.patch = std::make_shared<QueryPatch>(*std::move(point.patch));
  if (!point.ending) return;
  entry.last_frame = point.last_frame;
  entry.stop = point.stop;
}

void SessionFlow::EndLocked(PointId id, int64_t last_frame, int64_t stop) {
  const auto found = newest_.find(id);
  if (found == newest_.end()) return;
  Entry& entry = entries_.at(found->second);
  entry.last_frame = std::min(entry.last_frame, last_frame);
  entry.stop = std::min(entry.stop, stop);
}

void SessionFlow::Rebase(absl::Span<const Base> bases) {
  absl::MutexLock lock(&mutex_);
  for (const Base& base : bases) {
    const auto found = entries_.find(base.serial);
    if (found == entries_.end()) continue;
    Entry& entry = found->second;
    const bool beside = base.early && options_.starts;
    if (beside && !options_.live) continue;
    const Chain chain{base.frame, {ToFlow(base.position)}, {base.confidence}, base.until, base.assurance, base.search};
    ++entry.generation;
    entry.report_from = base.frame + 1;
    if (beside) {
      entry.live = chain;
    } else {
      entry.chain = chain;
      entry.live.reset();
    }
  }
}

bool SessionFlow::Reaches(uint64_t serial, int64_t frame) const {
  absl::MutexLock lock(&mutex_);
  const auto found = entries_.find(serial);
  if (found == entries_.end()) return false;
  const Chain& chain = found->second.chain;
  return chain.head() >= frame && !(chain.doubted && chain.until == frame);
}

std::vector<Position> SessionFlow::Starts(uint64_t serial, int64_t last) const {
  absl::MutexLock lock(&mutex_);
  const Chain& chain = entries_.at(serial).chain;
  const std::vector<FlowPoint>& points = last == chain.until && !chain.found.empty() ? chain.found : chain.points;
  std::vector<Position> starts;
  for (int64_t frame = chain.first + 1; frame <= last; ++frame) {
    starts.push_back(ToFeatures(points[frame - chain.first]));
  }
  return starts;
}

std::shared_ptr<const FlowPatch> SessionFlow::PatchOf(uint64_t serial) const {
  std::shared_ptr<QueryPatch> patch;
  {
    absl::MutexLock lock(&mutex_);
    if (const auto found = entries_.find(serial); found != entries_.end()) patch = found->second.patch;
  }
  if (patch == nullptr) return nullptr;
  const FlowPatch& cut = patch->Get();
  return {patch, &cut};
}

FlowPyramidPtr SessionFlow::PictureOf(int64_t frame) const {
  absl::MutexLock lock(&mutex_);
  return frame >= oldest_ && frame < without_gap_ && !pyramids_.empty() ? pyramids_[frame - oldest_] : nullptr;
}

std::vector<FlowPyramidPtr> SessionFlow::Pyramids(int64_t first, int64_t last) const {
  absl::MutexLock lock(&mutex_);
  std::vector<FlowPyramidPtr> pyramids;
  for (int64_t frame = first; frame <= last; ++frame) pyramids.push_back(pyramids_[frame - oldest_]);
  return pyramids;
}

void SessionFlow::Drop(uint64_t serial) {
  absl::MutexLock lock(&mutex_);
  const auto found = entries_.find(serial);
  if (found == entries_.end()) return;
  const auto newest = newest_.find(found->second.query.id);
  if (newest != newest_.end() && newest->second == serial) newest_.erase(newest);
  entries_.erase(found);
}

void SessionFlow::EvictBefore(int64_t frame) {
  absl::MutexLock lock(&mutex_);
  for (; oldest_ < std::min(frame, without_gap_); ++oldest_) pyramids_.pop_front();
}

void SessionFlow::Close() {
  absl::MutexLock lock(&mutex_);
  closed_ = true;
  pyramids_.clear();
  entries_.clear();
  uncut_.clear();
  newest_.clear();
}

int64_t SessionFlow::oldest() const {
  absl::MutexLock lock(&mutex_);
  return oldest_;
}

int64_t SessionFlow::bytes() const {
  absl::MutexLock lock(&mutex_);
  int64_t bytes = 0;
  for (const FlowPyramidPtr& pyramid : pyramids_) bytes += pyramid == nullptr ? 0 : pyramid->bytes();
  for (const auto& [serial, entry] : entries_) bytes += entry.patch == nullptr ? 0 : FlowPatch::kBytes;
  return bytes;
}

}  // namespace holdfast
