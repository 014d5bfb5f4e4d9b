// SPDX-License-Identifier: Apache-2.0
#include "server/engine/precision_switch.h"

#include <utility>

#include "model/precision_check.h"

namespace holdfast {
namespace {

torch::ScalarType TypeOf(const PointModel& model) { return model->parameters().front().scalar_type(); }

}  // namespace

PrecisionSwitch::PrecisionSwitch(PointModel only, EngineMetrics& metrics)
    : exact_(std::move(only)), metrics_(metrics) {}

PrecisionSwitch::PrecisionSwitch(PointModel exact, PointModel fast, EngineMetrics& metrics)
    : exact_(std::move(exact)), fast_(std::move(fast)), metrics_(metrics) {}

PointModel& PrecisionSwitch::ForSize(ImageSize size) {
  if (!has_choice()) return exact_;
  const std::pair<int, int> key(size.width, size.height);
  {
    absl::MutexLock lock(&mutex_);
    const auto known = is_fast_right_.find(key);
    if (known != is_fast_right_.end()) return known->second ? fast_ : exact_;
  }
  const PrecisionDifference difference = ComparePrecisions(exact_, fast_, CheckPicture(size.height, size.width));
  const bool right = difference.within();
  if (!right) metrics_.PrecisionFellBack(size, ToString(difference));
  absl::MutexLock lock(&mutex_);
  is_fast_right_[key] = right;
  return right ? fast_ : exact_;
}

PointModel& PrecisionSwitch::SourceOf(const WindowRows& rows) {
  const torch::ScalarType dtype = rows.frames.front().levels.front().scalar_type();
  return has_choice() && dtype == TypeOf(fast_) ? fast_ : exact_;
}

// A batch of a network has features of one type. Sizes that fell back are rare, so that neighbours of one network go
// together and no more is done about it.
std::vector<WindowEstimate> PrecisionSwitch::Refine(std::vector<WindowRows> groups, const RefineOptions& options) {
  std::vector<WindowEstimate> estimates;
  for (size_t begin = 0; begin < groups.size();) {
    PointModel& model = SourceOf(groups[begin]);
    std::vector<WindowRows> batch;
    size_t end = begin;
    while (end < groups.size() && &SourceOf(groups[end]) == &model) batch.push_back(std::move(groups[end++]));
    for (WindowEstimate& estimate : model->Refine(batch, options)) estimates.push_back(std::move(estimate));
    begin = end;
  }
  return estimates;
}

torch::ScalarType PrecisionSwitch::FeatureType(ImageSize size) const {
  if (!has_choice()) return TypeOf(exact_);
  absl::MutexLock lock(&mutex_);
  const auto known = is_fast_right_.find({size.width, size.height});
  return known != is_fast_right_.end() && known->second ? TypeOf(fast_) : TypeOf(exact_);
}

}  // namespace holdfast
