// SPDX-License-Identifier: Apache-2.0
#include "server/engine/objects/object_group.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include "server/engine/objects/similarity.h"

namespace holdfast {
namespace {

constexpr int64_t kNoNews = std::numeric_limits<int64_t>::max();

// Of the object's size, as it is by the motion: how far points may lie from where that leads for agreeing on it,
// and how far beyond that one no longer belongs. Objects bend: where the others lie off as well, one may lie further.
constexpr double kAgree = 0.06;
constexpr double kAstray = 0.15;
constexpr double kTimesTypical = 4;  // the median distance of the others
constexpr double kLeastPixels = 2;
constexpr double kLeastFirst = 0.3;  // of all points: first ones that tell the motion without those that came later
constexpr double kLeastBack = 0.3;   // of all points: that bring back those that have left when the others tell nothing
// Two points that see something else make a similarity too, and a third may agree by chance. Sure is what so many agree
// on that this hardly happens; what fewer do is believed where it is a small step from the motion before.
constexpr size_t kLeastSure = 5;           // points; of an object of fewer than six, all but one
constexpr double kLeastConfirming = 0.15;  // of all that have not left: that agree beside two
constexpr double kLeastUnsure = 2.0 / 3;   // of the visible ones, to be believed at all
constexpr double kUnsureStep = 0.25;       // of the object's size: how far it may take any of its points
constexpr double kUnsurePixels = 8;        // or so far
constexpr int kFramesToLeave = 3;          // in a row that a point lies too far off before it has left
constexpr int kFramesToReturn = 6;         // in a row that it does not before it is back

// The median distance of the votes from where 'motion' leads.
double Typical(const std::vector<Displacement>& votes, const Similarity& motion) {
  std::vector<double> distances;
  distances.reserve(votes.size());
  for (const Displacement& vote : votes) distances.push_back(Distance(motion.Map(vote.from), vote.to));
  const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return *middle;
}

void Weigh(ObjectJudgement::Standing& standing, bool astray) {
  standing.contrary = astray == standing.left ? 0 : standing.contrary + 1;
  if (standing.contrary < (standing.left ? kFramesToReturn : kFramesToLeave)) return;
  standing.left = !standing.left;
  standing.contrary = 0;
}

// A point's part in a frame.
struct Part {
  const ObjectMember& member;
  ObjectMember::Sample sample;
  ObjectJudgement::Standing& standing;
};

struct Votes {
  std::vector<Displacement> cast;  // by those that are visible
  size_t voters = 0;               // they and those that are not
};

Votes VotesOf(const std::vector<Part>& parts, bool first_ones, bool left_ones = false) {
  Votes votes;
  for (const Part& part : parts) {
    if ((part.standing.left && !left_ones) || (first_ones && IsPlacedAnew(part.member.id))) continue;
    ++votes.voters;
    if (part.sample.visible) votes.cast.push_back({part.member.home, part.sample.at});
  }
  return votes;
}

// A point that was placed anew knows where the object was from the others: it would only confirm what they have come
// to, so the first ones have the word while enough of them are there.
Votes VotesOf(const std::vector<Part>& parts) {
  Votes first = VotesOf(parts, /*first_ones=*/true);
  const bool enough = static_cast<double>(first.cast.size()) >= kLeastFirst * static_cast<double>(parts.size());
  return enough ? std::move(first) : VotesOf(parts, /*first_ones=*/false);
}

// Whether so many points of 'parts' agree that it cannot be by chance.
bool IsSure(size_t agree, size_t voters, size_t parts) {
  const size_t least = std::clamp<size_t>(parts - 1, 3, kLeastSure);
  return agree >= least && static_cast<double>(agree - 2) > kLeastConfirming * static_cast<double>(voters);
}

// Whether the object gets from one place to the other in a small step, all over.
bool IsNear(const std::vector<Part>& parts, double size, const Similarity& from, const Similarity& to) {
  const double most = std::max(kUnsurePixels, kUnsureStep * size * from.scale());
  return std::all_of(parts.begin(), parts.end(), [&](const Part& part) {
    return Distance(from.Map(part.member.home), to.Map(part.member.home)) <= most;
  });
}

// Where the points lead; empty: too few see the frame, or agree, to tell.
std::optional<Similarity> MotionBy(const std::vector<Part>& parts, const Votes& votes, double size,
                                   const Similarity& before) {
  const Tolerance tolerance{kAgree * size, kLeastPixels, before.scale()};
  const std::optional<FittedSimilarity> found = FitSimilarity(votes.cast, tolerance, before);
  if (!found) return std::nullopt;
  if (IsSure(found->agree, votes.voters, parts.size())) return found->motion;
  const bool most = static_cast<double>(found->agree) >= kLeastUnsure * static_cast<double>(votes.cast.size());
  if (most && IsNear(parts, size, before, found->motion)) return found->motion;
  return std::nullopt;
}

// How far a visible point may lie from where 'motion' leads and still belong.
double Allowed(const Votes& votes, double size, const Similarity& motion) {
  return std::max({kLeastPixels, kAstray * size * motion.scale(), kTimesTypical * Typical(votes.cast, motion)});
}

// Those that have not left may have gone with something else, and be out of sight with it. Where enough of all that are
// seen agree, those of them that have left are on their way back; the object stays until they are, and have a word.
void WeighLeft(const std::vector<Part>& parts, double size, const Similarity& before) {
  const Votes votes = VotesOf(parts, /*first_ones=*/false, /*left_ones=*/true);
  const Tolerance tolerance{kAgree * size, kLeastPixels, before.scale()};
  const std::optional<FittedSimilarity> found = FitSimilarity(votes.cast, tolerance, before);
  const bool enough = found && static_cast<double>(found->agree) >= kLeastBack * static_cast<double>(parts.size());
  if (!enough || !IsSure(found->agree, votes.voters, parts.size())) return;
  const double allowed = Allowed(votes, size, found->motion);
  for (const Part& part : parts) {
    if (!part.sample.visible || !part.standing.left) continue;
    Weigh(part.standing, Distance(found->motion.Map(part.member.home), part.sample.at) > allowed);
  }
}

// Moves on to where the points lead that have not left, and weighs where each of them stands. False: they do not tell,
// and the object stays.
bool Follow(const std::vector<Part>& parts, double size, Similarity& motion) {
  const Votes votes = VotesOf(parts);
  const std::optional<Similarity> found = MotionBy(parts, votes, size, motion);
  if (!found) {
    WeighLeft(parts, size, motion);
    return false;
  }
  motion = *found;
  const double allowed = Allowed(votes, size, motion);
  for (const Part& part : parts) {
    if (!part.sample.visible) continue;
    Weigh(part.standing, Distance(motion.Map(part.member.home), part.sample.at) > allowed);
  }
  return true;
}

ObjectSample Report(const std::vector<Part>& parts, const ObjectShape& shape, const Similarity& motion) {
  ObjectSample report;
  report.centre = motion.Map(shape.centre);
  report.scale = static_cast<float>(motion.scale());
  report.rotation = static_cast<float>(motion.rotation());
  for (const Pixel& corner : shape.outline) report.outline.push_back(motion.Map(corner));
  int has = 0, sees = 0;
  for (const Part& part : parts) {
    if (part.standing.left) {
      report.left.push_back(part.member.id);
    } else {
      ++has;
      sees += part.sample.visible ? 1 : 0;
    }
  }
  report.visible = has == 0 ? 0 : static_cast<float>(sees) / static_cast<float>(has);
  std::sort(report.left.begin(), report.left.end());
  return report;
}

std::optional<ObjectRun> IfAny(ObjectRun run) {
  if (run.samples.empty()) return std::nullopt;
  return run;
}

}  // namespace

ObjectGroup::ObjectGroup(ObjectId id, int64_t query_frame, const ObjectShape& shape,
                         absl::Span<const PointQuery> points, const ObjectWindows& windows)
    : windows_(windows), news_from_(query_frame) {
  state_.id = id;
  state_.query_frame = state_.next = query_frame;
  state_.shape = shape;
  state_.reseeds = windows.hop > 0;
  for (const PointQuery& point : points) {
    ObjectMember& member = state_.members.emplace_back();
    member.id = point.id;
    member.home = {point.x, point.y};
    member.queried = query_frame;
  }
  state_.judgement.standings.resize(points.size());
}

ObjectState ObjectGroup::StateBefore(int64_t frame) const {
  ObjectState state = state_;
  for (ObjectMember& member : state.members) {
    if (member.end == frame + 1 && !member.closed && !HasSuccessor(member)) member.end = ObjectMember::kNever;
    const int64_t finals = std::max<int64_t>(member.final_before - state.next, 0);
    if (finals < static_cast<int64_t>(member.samples.size())) member.samples.resize(static_cast<size_t>(finals));
  }
  return state;
}

bool ObjectGroup::HasSuccessor(const ObjectMember& member) const {
  return std::any_of(state_.members.begin(), state_.members.end(),
                     [&member](const ObjectMember& other) { return other.id == ObjectSuccessor(member.id); });
}

void ObjectGroup::Add(const PointRun& run) {
  for (ObjectMember& member : state_.members) {
    if (member.id == run.id) news_from_ = std::min(news_from_, Take(run, member));
  }
}

int64_t ObjectGroup::Take(const PointRun& run, ObjectMember& member) const {
  const int64_t first = std::max({run.first_frame, state_.next, member.final_before});
  const int64_t end = std::min(run.first_frame + static_cast<int64_t>(run.x.size()), member.end);
  if (first >= end || first > state_.next + static_cast<int64_t>(member.samples.size())) return kNoNews;
  for (int64_t frame = first; frame < end; ++frame) {
    const size_t from = static_cast<size_t>(frame - run.first_frame), to = static_cast<size_t>(frame - state_.next);
    if (to >= member.samples.size()) member.samples.resize(to + 1);
    member.samples[to] = {{run.x[from], run.y[from]}, run.visible[from] != 0};
  }
  if (run.final_count > 0) {
    member.final_before = std::max(member.final_before, std::min(run.first_frame + run.final_count, end));
  }
  return first;
}

void ObjectGroup::Close(PointId id, int64_t frame) {
  for (ObjectMember& member : state_.members) {
    if (member.id == id && member.queried == frame) member.closed = true;
  }
}

void ObjectGroup::EndClosed() {
  for (ObjectMember& member : state_.members) {
    if (member.closed) member.end = std::min(member.end, std::max(member.final_before, state_.next));
  }
}

std::vector<PointId> ObjectGroup::Remove(PointId id, int64_t frame) {
  std::vector<PointId> points;
  if (frame < query_frame()) return points;  // that was of another object's point of this id
  for (ObjectMember& member : state_.members) {
    if (ObjectPlace(member.id) != ObjectPlace(id) || member.end <= frame) continue;
    points.push_back(member.id);
    member.end = frame + 1;
    news_from_ = std::min(news_from_, std::max(member.end, state_.next));
  }
  return points;
}

bool ObjectGroup::ended() const {
  return std::all_of(state_.members.begin(), state_.members.end(),
                     [this](const ObjectMember& member) { return member.end <= state_.next; });
}

bool ObjectGroup::IsKnown(int64_t frame, bool final) const {
  bool any = false;
  for (const ObjectMember& member : state_.members) {
    if (!TakesPart(member, frame)) continue;
    if (final && member.final_before <= frame) return false;
    if (state_.next + static_cast<int64_t>(member.samples.size()) <= frame) return false;
    any = true;
  }
  return any;
}

std::optional<ObjectRun> ObjectGroup::TakeRun(bool provisional, int64_t newest) {
  EndClosed();
  ObjectRun run;
  run.id = id();
  run.first_frame = state_.next;
  while (!reseeding_ && IsKnown(state_.next, /*final=*/true)) run.samples.push_back(Finish(newest));
  run.final_count = static_cast<int64_t>(run.samples.size());
  if (run.final_count > 0) news_from_ = state_.next;
  if (!provisional || reseeding_ || news_from_ == kNoNews) return IfAny(std::move(run));
  const int64_t begin = std::min(news_from_, state_.next + static_cast<int64_t>(ahead_.size()));
  if (run.samples.empty()) run.first_frame = begin;
  ahead_.resize(static_cast<size_t>(begin - state_.next));
  for (int64_t frame = begin; IsKnown(frame, /*final=*/false); ++frame) {
    ahead_.push_back(ahead_.empty() ? state_.judgement : ahead_.back());
    bool told = false;
    run.samples.push_back(Judge(frame, ahead_.back(), told));
  }
  news_from_ = kNoNews;
  return IfAny(std::move(run));
}

ObjectSample ObjectGroup::Finish(int64_t newest) {
  bool told = false;
  ObjectSample sample = Judge(state_.next, state_.judgement, told);
  if (told && state_.next == meeting() && newest >= covered_at_meeting()) {
    Reseeding found = FindReseeding(state_, covered_at_meeting());
    if (!found.lost.empty()) reseeding_ = std::move(found);
  }
  for (ObjectMember& member : state_.members) {
    if (!member.samples.empty()) member.samples.pop_front();
  }
  if (!ahead_.empty()) ahead_.pop_front();
  ++state_.next;
  return sample;
}

int64_t ObjectGroup::meeting() const {
  if (reseeding_) return reseeding_->frame;
  if (!state_.reseeds || windows_.hop == 0) return ObjectMember::kNever;
  const int64_t hops = (state_.next - query_frame() + windows_.hop - 1) / windows_.hop;
  return query_frame() + std::max<int64_t>(hops, 1) * windows_.hop;
}

int64_t ObjectGroup::covered_at_meeting() const {
  const int64_t frame = meeting();
  return frame == ObjectMember::kNever ? frame : frame - windows_.hop + windows_.frames - 1;
}

std::vector<ObjectGroup::Reseeded> ObjectGroup::Reseed(absl::Span<const Pixel> places) {
  std::vector<Reseeded> reseeded;
  const int64_t end = covered_at_meeting() + 1;
  for (size_t i = 0; i < places.size(); ++i) {
    const auto lost = std::find_if(state_.members.begin(), state_.members.end(),
                                   [&](const ObjectMember& member) { return member.id == reseeding_->lost[i]; });
    ObjectMember member;
    member.id = ObjectSuccessor(lost->id);
    member.home = state_.judgement.motion.MapBack(places[i]);
    member.queried = reseeding_->frame;
    member.end = std::exchange(lost->end, end);
    member.final_before = state_.next;
    Reseeded& made = reseeded.emplace_back();
    made.point = {member.id, places[i].x, places[i].y};
    made.before = lost->id;
    made.before_queried = lost->queried;
    if (member.end != ObjectMember::kNever) made.removed_after = member.end - 1;
    state_.members.push_back(std::move(member));
    state_.judgement.standings.emplace_back();
  }
  reseeding_.reset();
  DropEnded();
  ahead_.clear();
  news_from_ = state_.next;
  return reseeded;
}

void ObjectGroup::DropEnded() {
  for (size_t i = state_.members.size(); i-- > 0;) {
    if (state_.members[i].end > state_.next) continue;
    state_.members.erase(state_.members.begin() + static_cast<std::ptrdiff_t>(i));
    state_.judgement.standings.erase(state_.judgement.standings.begin() + static_cast<std::ptrdiff_t>(i));
  }
}

bool ObjectGroup::WasPlacedAnew(PointId id, int64_t frame) const {
  return std::any_of(state_.members.begin(), state_.members.end(), [&](const ObjectMember& member) {
    return member.id == id && member.queried == frame && frame != query_frame();
  });
}

ObjectSample ObjectGroup::Judge(int64_t frame, ObjectJudgement& judgement, bool& told) const {
  std::vector<Part> parts;
  for (size_t i = 0; i < state_.members.size(); ++i) {
    const ObjectMember& member = state_.members[i];
    if (!TakesPart(member, frame)) continue;
    parts.push_back({member, member.samples[static_cast<size_t>(frame - state_.next)], judgement.standings[i]});
  }
  told = Follow(parts, state_.shape.size, judgement.motion);
  ObjectSample report = Report(parts, state_.shape, judgement.motion);
  for (const Part& part : parts) {
    if (part.member.queried != query_frame() && part.member.queried + 1 == frame)
      report.joined.push_back(part.member.id);
  }
  std::sort(report.joined.begin(), report.joined.end());
  return report;
}

}  // namespace holdfast
