// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/engine/tracker_model.h"

namespace holdfast {

// A network whose answers are known by hand. A frame's feature is the value of its first pixel (so frames can be told
// apart), a template is (value at the query, x of the query), and refining moves every position but the first by
// 'step' feature pixels a frame in x, starting from the position before it: tracks are straight lines through the
// locked position. Counts what it is asked for.
class FakeTrackerModel : public TrackerModel {
 public:
  struct Counts {
    std::atomic<int64_t> frames{0};
    std::atomic<int64_t> encode_calls{0};
    std::atomic<int64_t> rows{0};
    std::atomic<int64_t> refine_calls{0};
    std::atomic<int64_t> alive{0};      // features that exist now
    std::atomic<int64_t> max_alive{0};  // most there ever were
  };

  static constexpr int64_t kFrameBytes = 1000;
  static constexpr size_t kChannels = 2;  // of a template

  explicit FakeTrackerModel(int window_frames = 24) : counts_(std::make_shared<Counts>()) {
    info_.name = "fake";
    info_.preset = "custom";
    info_.precision = "float32";
    info_.device = "cpu";
    info_.window_frames = window_frames;
    info_.channels = static_cast<int>(kChannels);
  }

  // Outlives the model, for tests that hand the model over.
  std::shared_ptr<const Counts> counts() const { return counts_; }
  float step = 0.5f;
  float similarity = 1.0f;
  bool keep_starts = false;  // instead: estimates are the starts, 'step' to the right of them but for the first
  // Called at the beginning of Encode and Refine, on the engine's thread; may block or throw.
  std::function<void()> before_encode = [] {};
  std::function<void(absl::Span<const WindowGroup>)> before_refine = [](absl::Span<const WindowGroup>) {};

  void SetCosts(const WorkCosts& costs) { info_.costs = costs; }
  void SetCalibration(std::string json) { info_.calibration = std::move(json); }

  const ModelInfo& info() const override { return info_; }
  int64_t FrameBytes(ImageSize) const override { return kFrameBytes; }
  void PrepareThread() override {}

  std::vector<FrameFeaturesPtr> Encode(absl::Span<const RgbImage* const> images) override {
    before_encode();
    ++counts_->encode_calls;
    counts_->frames += static_cast<int64_t>(images.size());
    std::vector<FrameFeaturesPtr> features;
    for (const RgbImage* image : images) features.push_back(std::make_shared<Features>(counts_, image->pixels.at(0)));
    return features;
  }

  std::vector<std::vector<float>> Sample(const FrameFeatures& frame, absl::Span<const Position> at) override {
    std::vector<std::vector<float>> templates;
    for (const Position& p : at) templates.push_back({static_cast<float>(ValueOf(frame)), p.x});
    return templates;
  }

  std::vector<RowEstimate> Refine(absl::Span<const WindowGroup> groups, const RefineOptions& options) override {
    before_refine(groups);
    ++counts_->refine_calls;
    std::vector<RowEstimate> estimates;
    for (const WindowGroup& group : groups) {
      for (const WindowRow& row : group.rows) estimates.push_back(Move(row, options));
    }
    counts_->rows += static_cast<int64_t>(estimates.size());
    return estimates;
  }

  static uint8_t ValueOf(const FrameFeatures& features) { return static_cast<const Features&>(features).value; }

 private:
  struct Features final : FrameFeatures {
    Features(std::shared_ptr<Counts> counts, uint8_t value) : counts(std::move(counts)), value(value) {
      const int64_t alive = ++this->counts->alive;
      int64_t most = this->counts->max_alive;
      while (most < alive && !this->counts->max_alive.compare_exchange_weak(most, alive)) {
      }
    }
    ~Features() override { --counts->alive; }
    int64_t bytes() const override { return kFrameBytes; }
    const std::shared_ptr<Counts> counts;
    const uint8_t value;
  };

  RowEstimate Move(const WindowRow& row, const RefineOptions& options) const {
    EXPECT_EQ(row.feature.size(), kChannels) << "a template that Sample would not give";
    RowEstimate estimate;
    estimate.positions = row.start;
    for (size_t t = 1; t < row.start.size(); ++t) {
      const Position& from = keep_starts ? row.start[t] : estimate.positions[t - 1];
      estimate.positions[t] = {from.x + step, from.y};
    }
    estimate.similarity.assign(row.start.size(), similarity);
    estimate.last_step.assign(row.start.size(), 0.0f);
    estimate.iterations = options.iterations;
    if (options.keep_templates) estimate.templates = {{row.feature[0]}, {row.feature[1]}};
    return estimate;
  }

  std::shared_ptr<Counts> counts_;
  ModelInfo info_;
};

}  // namespace holdfast
