// SPDX-License-Identifier: Apache-2.0
#include "server/engine/torch_tracker_model.h"

#include <ATen/Parallel.h>
#include <torch/types.h>

#include <algorithm>
#include <cstring>
#include <new>
#include <optional>
#include <string>
#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "model/device.h"
#include "model/ops/sampling.h"
#include "model/precision.h"
#include "model/precision_check.h"
#include "model/presets.h"
#include "model/shares.h"
#include "model/thread_count.h"
#include "server/engine/precision_switch.h"
#include "server/engine/tracks/calibration.h"
#include "server/engine/warm_up.h"

namespace holdfast {
namespace {

constexpr ShareSize kFrameShare = {1, 1};
constexpr ShareSize kRowShare = {8, 64};  // what a batch of rows costs, however few they are, is that of three rows

static_assert(sizeof(Position) == 2 * sizeof(float), "positions are copied as pairs of floats");

class TorchFeatures final : public FrameFeatures {
 public:
  explicit TorchFeatures(FeaturePyramid pyramid) : pyramid_(std::move(pyramid)), bytes_(pyramid_.bytes()) {}
  const FeaturePyramid& pyramid() const { return pyramid_; }
  int64_t bytes() const override { return bytes_; }

 private:
  const FeaturePyramid pyramid_;
  const int64_t bytes_;
};

const FeaturePyramid& PyramidOf(const FrameFeatures& features) {
  return static_cast<const TorchFeatures&>(features).pyramid();
}

// positions [N, S] -> [N, S, 2] float32.
torch::Tensor StartsOf(absl::Span<const WindowRow> rows) {
  const int64_t frames = static_cast<int64_t>(rows.front().start.size());
  torch::Tensor starts = torch::empty({static_cast<int64_t>(rows.size()), frames, 2});
  float* out = starts.data_ptr<float>();
  for (const WindowRow& row : rows) {
    std::memcpy(out, row.start.data(), row.start.size() * sizeof(Position));
    out += row.start.size() * 2;
  }
  return starts;
}

torch::Tensor FeaturesOf(absl::Span<const WindowRow> rows) {  // [N, C] float32
  const int64_t channels = static_cast<int64_t>(rows.front().feature.size());
  torch::Tensor features = torch::empty({static_cast<int64_t>(rows.size()), channels});
  float* out = features.data_ptr<float>();
  for (const WindowRow& row : rows) out = std::copy(row.feature.begin(), row.feature.end(), out);
  return features;
}

// The rows' f2 or f4, [N, S, C] float32; f1 at every frame for rows that carry none.
torch::Tensor CarriedOf(absl::Span<const WindowRow> rows, std::vector<float> CarriedTemplates::*which) {
  const int64_t frames = static_cast<int64_t>(rows.front().start.size());
  const int64_t channels = static_cast<int64_t>(rows.front().feature.size());
  torch::Tensor carried = torch::empty({static_cast<int64_t>(rows.size()), frames, channels});
  float* out = carried.data_ptr<float>();
  for (const WindowRow& row : rows) {
    if (row.carried != nullptr) {
      const std::vector<float>& values = row.carried->*which;
      out = std::copy(values.begin(), values.end(), out);
    } else {
      for (int64_t t = 0; t < frames; ++t) out = std::copy(row.feature.begin(), row.feature.end(), out);
    }
  }
  return carried;
}

// 'some' of the group's rows.
WindowRows ToWindowRows(const WindowGroup& group, absl::Span<const WindowRow> some) {
  WindowRows rows;
  for (const FrameFeaturesPtr& frame : group.frames) rows.frames.push_back(PyramidOf(*frame));
  rows.start = StartsOf(some);
  rows.feature = FeaturesOf(some);
  const bool carried =
      std::any_of(some.begin(), some.end(), [](const WindowRow& row) { return row.carried != nullptr; });
  if (carried) {
    rows.carried_f2 = CarriedOf(some, &CarriedTemplates::f2);
    rows.carried_f4 = CarriedOf(some, &CarriedTemplates::f4);
  }
  return rows;
}

// Rows [begin, end) of those of all groups.
std::vector<WindowRows> RowsBetween(absl::Span<const WindowGroup> groups, int64_t begin, int64_t end) {
  std::vector<WindowRows> rows;
  for (const WindowGroup& group : groups) {
    const auto size = static_cast<int64_t>(group.rows.size());
    const int64_t first = std::clamp<int64_t>(begin, 0, size), last = std::clamp<int64_t>(end, 0, size);
    if (first < last) {
      rows.push_back(ToWindowRows(group, absl::MakeConstSpan(group.rows).subspan(first, last - first)));
    }
    begin -= size;
    end -= size;
  }
  return rows;
}

int64_t CountRows(absl::Span<const WindowGroup> groups) {
  int64_t rows = 0;
  for (const WindowGroup& group : groups) rows += static_cast<int64_t>(group.rows.size());
  return rows;
}

// Row 'row' of x [N, ...] float32 contiguous on the CPU; empty for an undefined x.
std::vector<float> RowOf(const torch::Tensor& x, int64_t row) {
  if (!x.defined()) return {};
  const int64_t size = x.numel() / x.size(0);
  const float* begin = x.data_ptr<float>() + row * size;
  return {begin, begin + size};
}

torch::Tensor OnCpu(const torch::Tensor& x) {
  return x.defined() ? x.to(torch::kCPU, torch::kFloat32).contiguous() : x;
}

// Writes one a row, and returns where the next one goes.
RowEstimate* WriteEstimates(const WindowEstimate& group, RowEstimate* out) {
  const torch::Tensor positions = OnCpu(group.positions), logit = OnCpu(group.visibility_logit),
                      similarity = OnCpu(group.similarity), last_step = OnCpu(group.last_step), f2 = OnCpu(group.f2),
                      f4 = OnCpu(group.f4);
  const torch::Tensor iterations = group.iterations.cpu();
  for (int64_t row = 0; row < positions.size(0); ++row, ++out) {
    const std::vector<float> xy = RowOf(positions, row);
    for (size_t i = 0; i < xy.size(); i += 2) out->positions.push_back({xy[i], xy[i + 1]});
    out->visibility_logit = RowOf(logit, row);
    out->similarity = RowOf(similarity, row);
    out->last_step = RowOf(last_step, row);
    out->iterations = static_cast<int>(iterations.data_ptr<int64_t>()[row]);
    out->templates = {RowOf(f2, row), RowOf(f4, row)};
  }
  return out;
}

// Memory that ends is an overload, anything else a bug.
template <typename Work>
auto WithMemoryErrors(Work work) -> decltype(work()) {
  try {
    return work();
  } catch (const c10::OutOfMemoryError&) {
    throw std::bad_alloc();
  } catch (const c10::Error& e) {  // the CPU's allocator throws no type of its own
    if (absl::StrContains(e.what_without_backtrace(), "allocate memory")) throw std::bad_alloc();
    throw;
  }
}

// [F, H, W, 3] uint8
torch::Tensor FramesOf(absl::Span<const RgbImage* const> images) {
  std::vector<torch::Tensor> frames;
  for (const RgbImage* image : images) {
    frames.push_back(torch::from_blob(const_cast<uint8_t*>(image->pixels.data()),  // only read
                                      {image->size.height, image->size.width, 3}, torch::kUInt8));
  }
  return torch::stack(frames);
}

const char* NameOf(torch::ScalarType dtype) { return dtype == torch::kBFloat16 ? "bfloat16" : "float32"; }

class TorchTrackerModel final : public TrackerModel {
 public:
  TorchTrackerModel(ModelInfo info, const ModelOptions& options, std::unique_ptr<PrecisionSwitch> networks,
                    torch::Device device, int threads)
      : options_(options), networks_(std::move(networks)), device_(device), threads_(threads), info_(std::move(info)) {
    info_.preset = PresetName(options);
    info_.device = device.str();
    info_.window_frames = static_cast<int>(options.window);
    info_.stride = static_cast<int>(options.stride);
    info_.channels = static_cast<int>(options.feature_channels);
  }

  const ModelInfo& info() const override { return info_; }
  // What clients are told is the precision of frames of this size. Both before the model is shared.
  void NamePrecisionAt(ImageSize size) { info_.precision = NameOf(networks_->FeatureType(size)); }
  void SetCosts(const WorkCosts& costs) { info_.costs = costs; }

  int64_t FrameBytes(ImageSize size) const override {
    int64_t height = size.height / options_.stride, width = size.width / options_.stride, cells = 0;
    for (int64_t level = 0; level < options_.correlation_levels; ++level, height /= 2, width /= 2) {
      cells += height * width;
    }
    const auto bytes = static_cast<int64_t>(c10::elementSize(networks_->FeatureType(size)));
    return cells * options_.feature_channels * bytes;
  }

  void PrepareThread() override { at::set_num_threads(threads_); }

  std::vector<FrameFeaturesPtr> Encode(absl::Span<const RgbImage* const> images) override {
    return WithMemoryErrors([&] {
      const c10::InferenceMode guard;
      PointModel& model = networks_->ForSize(images.front()->size);
      std::vector<FrameFeaturesPtr> features(images.size());
      ForEachShareHere(static_cast<int64_t>(images.size()), kFrameShare, [&](int64_t begin, int64_t end) {
        const torch::Tensor maps = model->Encode(FramesOf(images.subspan(begin, end - begin)).to(device_));
        for (FeaturePyramid& pyramid : BuildPyramids(maps, options_.correlation_levels)) {
          features[begin++] = std::make_shared<TorchFeatures>(std::move(pyramid));
        }
      });
      AwaitDevice(device_);  // who measures this call, and promises work by it, measures the work
      return features;
    });
  }

  std::vector<std::vector<float>> Sample(const FrameFeatures& frame, absl::Span<const Position> at) override {
    return WithMemoryErrors([&] {
      const c10::InferenceMode guard;
      torch::Tensor xy = torch::empty({static_cast<int64_t>(at.size()), 2});
      std::memcpy(xy.data_ptr<float>(), at.data(), at.size() * sizeof(Position));
      const torch::Tensor features = OnCpu(SampleFeatures(PyramidOf(frame), xy.to(device_)));
      std::vector<std::vector<float>> templates;
      for (int64_t i = 0; i < features.size(0); ++i) templates.push_back(RowOf(features, i));
      return templates;
    });
  }

  std::vector<RowEstimate> Refine(absl::Span<const WindowGroup> groups, const RefineOptions& options) override {
    return WithMemoryErrors([&] {
      std::vector<RowEstimate> estimates(CountRows(groups));
      ForEachShareHere(static_cast<int64_t>(estimates.size()), kRowShare, [&](int64_t begin, int64_t end) {
        RowEstimate* out = &estimates[begin];
        for (const WindowEstimate& group : networks_->Refine(
                 RowsBetween(groups, begin, end), {options.iterations, options.keep_templates, options.least_step})) {
          out = WriteEstimates(group, out);
        }
      });
      return estimates;
    });
  }

 private:
  // The processor's threads take shares; other devices want all at once.
  void ForEachShareHere(int64_t count, ShareSize size, absl::FunctionRef<void(int64_t, int64_t)> work) const {
    const auto infer = [&](int64_t begin, int64_t end) {
      const c10::InferenceMode guard;
      work(begin, end);
    };
    device_.is_cpu() ? ForEachShare(count, size, infer) : infer(0, count);
  }

  const ModelOptions options_;
  const std::unique_ptr<PrecisionSwitch> networks_;
  const torch::Device device_;
  const int threads_;
  ModelInfo info_;
};

// What the network is warmed up with.
RgbImage PictureOf(ImageSize size) {
  const torch::Tensor picture = CheckPicture(size.height, size.width);
  const uint8_t* pixels = picture.data_ptr<uint8_t>();
  return {size, {pixels, pixels + picture.numel()}};
}

// Both networks when there is a choice to be made at each size, else the one that was asked for.
std::unique_ptr<PrecisionSwitch> MakeSwitch(PointModel model, Precision precision, const torch::Device& device,
                                            EngineMetrics& metrics) {
  model->eval();
  model->to(device);
  if (precision == Precision::kAuto && ComputesBFloat16Faster(device)) {
    PointModel fast = CopyInPrecision(model, torch::kBFloat16);
    return std::make_unique<PrecisionSwitch>(std::move(model), std::move(fast), metrics);
  }
  if (precision == Precision::kBFloat16) model->to(torch::kBFloat16);
  model->PackWeights();
  return std::make_unique<PrecisionSwitch>(std::move(model), metrics);
}

}  // namespace

absl::StatusOr<std::unique_ptr<TrackerModel>> MakeTorchTrackerModel(LoadedModel loaded, const EngineOptions& options,
                                                                    const Clock& clock, EngineMetrics& metrics) {
  const absl::StatusOr<torch::Device> device = OpenDevice(options.device);
  if (!device.ok()) return device.status();
  ModelInfo info;
  info.name = std::move(loaded.name);
  info.weights_sha256 = std::move(loaded.sha256);
  if (const auto found = loaded.metadata.find(Calibration::kMetadataKey); found != loaded.metadata.end()) {
    info.calibration = std::move(found->second);
  }
  const ModelOptions network = loaded.model->options();
  std::unique_ptr<TorchTrackerModel> model;
  try {
    model = std::make_unique<TorchTrackerModel>(
        std::move(info), network, MakeSwitch(std::move(loaded.model), options.precision, *device, metrics), *device,
        ThreadCount(options.compute_threads));
  } catch (const std::exception&) {
    return absl::ResourceExhaustedError(absl::StrCat("the network does not fit on ", options.device));
  }
  const absl::StatusOr<WorkCosts> costs = WarmUp(*model, PictureOf(options.processing_size), options.iterations, clock);
  if (!costs.ok()) return costs.status();
  model->SetCosts(*costs);
  model->NamePrecisionAt(options.processing_size);
  return model;
}

}  // namespace holdfast
