// SPDX-License-Identifier: Apache-2.0
#include "training/data/track_selection.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace holdfast {
namespace {

bool Good(const Sample& sample, int64_t s, int64_t n) { return sample.Visible(s, n) && sample.Valid(s, n); }

bool SeenEnough(const TrackRules& rules, const Sample& sample, int64_t n) {
  const int64_t frames = sample.num_frames();
  int64_t good = 0;
  for (int64_t s = 0; s < frames; ++s) {
    if (Good(sample, s, n)) {
      ++good;
    } else if (s < rules.good_at_start) {
      return false;
    }
  }
  const double share = std::pow(static_cast<double>(frames), rules.good_frames_power);
  const int64_t least = rules.good_frames_power < 1 ? static_cast<int64_t>(std::ceil(share)) : 0;
  return good >= std::max(least, std::min(rules.good_frames_least, frames));
}

bool OnMaskEdge(const Sample& sample, int64_t n) {
  if (!sample.has_masks()) return false;
  const cv::Point2f at = sample.Position(0, n);
  const int32_t id = sample.IdAt(0, at);
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      const cv::Point2f beside = at + cv::Point2f(static_cast<float>(dx), static_cast<float>(dy));
      if (sample.Inside(beside) && sample.IdAt(0, beside) != id) return true;
    }
  }
  return false;
}

// Differences of order 1, 2 and 3 over the runs of valid frames stay below the bounds.
bool MovesCalmly(const TrackRules& rules, const Sample& sample, int64_t n) {
  const double side = std::max(sample.size().width, sample.size().height);
  const std::array<double, 3> bounds = {rules.max_velocity, rules.max_acceleration, rules.max_jerk};
  std::array<cv::Point2f, 4> now, before;  // differences of order 0 to 3 at this frame and at the last
  int run = 0;                             // valid frames in a row
  for (int64_t s = 0; s < sample.num_frames(); ++s) {
    if (!sample.Valid(s, n)) {
      run = 0;
      continue;
    }
    now[0] = sample.Position(s, n);
    for (int order = 1; order <= std::min(run, 3); ++order) {
      const size_t i = static_cast<size_t>(order);
      now[i] = now[i - 1] - before[i - 1];
      if (bounds[i - 1] > 0 && std::hypot(now[i].x, now[i].y) >= bounds[i - 1] * side) return false;
    }
    before = now;
    ++run;
  }
  return true;
}

// Start (x, y) and mean motion of a track, pixels.
std::array<float, 4> Summary(const Sample& sample, int64_t n) {
  int64_t last = 0;
  for (int64_t s = 0; s < sample.num_frames(); ++s) {
    if (sample.Valid(s, n)) last = s;
  }
  const cv::Point2f start = sample.Position(0, n);
  const cv::Point2f motion = last > 0 ? (sample.Position(last, n) - start) / static_cast<float>(last) : cv::Point2f();
  return {start.x, start.y, motion.x, motion.y};
}

}  // namespace

void MarkOutside(const TrackRules& rules, Sample& sample) {
  const float right = static_cast<float>(sample.size().width - 1), low = static_cast<float>(sample.size().height - 1);
  const auto within = [&](cv::Point2f p, float rim) {
    return p.x >= -rim && p.y >= -rim && p.x <= right + rim && p.y <= low + rim;
  };
  for (int64_t s = 0; s < sample.num_frames(); ++s) {
    for (int64_t n = 0; n < sample.num_points(); ++n) {
      const size_t at = sample.At(s, n);
      const cv::Point2f p = sample.Position(s, n);
      if (!within(p, rules.valid_outside_px)) sample.valid[at] = 0;
      if (!sample.valid[at] || !within(p, -rules.visible_margin_px)) sample.visible[at] = 0;
    }
  }
}

std::vector<int64_t> GoodTracks(const TrackRules& rules, const Sample& sample) {
  std::vector<int64_t> good;
  for (int64_t n = 0; n < sample.num_points(); ++n) {
    if (SeenEnough(rules, sample, n) && !(rules.off_mask_edges && OnMaskEdge(sample, n)) &&
        MovesCalmly(rules, sample, n)) {
      good.push_back(n);
    }
  }
  return good;
}

std::vector<int64_t> SpreadOut(const Sample& sample, const std::vector<int64_t>& candidates, int64_t count) {
  if (static_cast<int64_t>(candidates.size()) <= count) return candidates;
  std::vector<std::array<float, 4>> summaries;
  summaries.reserve(candidates.size());
  for (const int64_t n : candidates) summaries.push_back(Summary(sample, n));
  std::vector<float> distance(candidates.size(), std::numeric_limits<float>::max());  // to the nearest chosen, squared
  std::vector<int64_t> chosen;
  size_t next = 0;
  while (static_cast<int64_t>(chosen.size()) < count) {
    chosen.push_back(candidates[next]);
    for (size_t i = 0; i < candidates.size(); ++i) {
      float squared = 0;
      for (size_t k = 0; k < 4; ++k)
        squared += (summaries[i][k] - summaries[next][k]) * (summaries[i][k] - summaries[next][k]);
      distance[i] = std::min(distance[i], squared);
    }
    distance[next] = -1;  // never again, even if all the rest coincide
    next = static_cast<size_t>(std::max_element(distance.begin(), distance.end()) - distance.begin());
  }
  return chosen;
}

std::vector<int64_t> EvenlyPicked(const std::vector<int64_t>& candidates, int64_t count) {
  const int64_t all = static_cast<int64_t>(candidates.size());
  if (count <= 0 || all <= count) return candidates;
  std::vector<int64_t> picked;
  for (int64_t i = 0; i < count; ++i) picked.push_back(candidates[static_cast<size_t>(i * all / count)]);
  return picked;
}

void PadPoints(int64_t count, Sample& sample) {
  const int64_t old = sample.num_points();
  if (old >= count) return;
  Sample padded;
  padded.frames = sample.frames;
  padded.AllocatePoints(count);
  for (int64_t n = 0; n < old; ++n) {
    padded.object_ids[static_cast<size_t>(n)] = sample.object_ids[static_cast<size_t>(n)];
    for (int64_t s = 0; s < sample.num_frames(); ++s) {
      padded.SetPosition(s, n, sample.Position(s, n));
      padded.visible[padded.At(s, n)] = sample.visible[sample.At(s, n)];
      padded.valid[padded.At(s, n)] = sample.valid[sample.At(s, n)];
    }
  }
  sample.tracks = std::move(padded.tracks);
  sample.visible = std::move(padded.visible);
  sample.valid = std::move(padded.valid);
  sample.object_ids = std::move(padded.object_ids);
}

}  // namespace holdfast
