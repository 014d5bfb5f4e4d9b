// SPDX-License-Identifier: Apache-2.0
#include "server/engine/warm_up.h"

#include <algorithm>
#include <functional>
#include <new>
#include <thread>

#include "absl/functional/function_ref.h"
#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

constexpr int kRuns = 5;
constexpr double kEnough = 0.5;  // seconds, after which a large network on a slow machine is not run again
constexpr int kRows = 64;        // enough for a batch to be as efficient as larger ones

double SecondsOf(const Clock& clock, absl::FunctionRef<void()> work) {
  const SteadyTime begin = clock.SteadyNow();
  work();
  return absl::ToDoubleSeconds(clock.Since(begin));
}

// The shortest of a few runs after the first: whatever gets in between makes one longer, nothing makes it shorter.
double SecondsWarm(const Clock& clock, absl::FunctionRef<void()> work) {
  work();
  double shortest = SecondsOf(clock, work), spent = shortest;
  for (int run = 1; run < kRuns && spent < kEnough; ++run) {
    const double seconds = SecondsOf(clock, work);
    spent += seconds;
    shortest = std::min(shortest, seconds);
  }
  return shortest;
}

WorkCosts Measure(TrackerModel& model, const RgbImage& picture, int iterations, const Clock& clock) {
  model.PrepareThread();
  const RgbImage* pictures[] = {&picture};
  FrameFeaturesPtr features;
  const double encode = SecondsWarm(clock, [&] { features = model.Encode(pictures).front(); });
  const Position at{1, 1};
  const std::vector<float> feature = model.Sample(*features, {&at, 1}).front();
  const size_t frames = model.info().window_frames;
  const auto refine = [&](int rows) {
    const WindowRow row{std::vector<Position>(frames, at), feature};
    const WindowGroup group{std::vector<FrameFeaturesPtr>(frames, features), std::vector<WindowRow>(rows, row)};
    return SecondsWarm(clock, [&] { model.Refine({&group, 1}, {iterations, false}); }) / iterations;
  };
  const double one = refine(1), many = refine(kRows);
  WorkCosts costs;
  costs.pixel = encode / static_cast<double>(Pixels(picture.size));
  // One row may have taken longer than many where something else got in between.
  costs.row = many > one ? (many - one) / (kRows - 1) : many / kRows;
  costs.batch = std::max(0.0, many - kRows * costs.row);
  return costs;
}

}  // namespace

absl::StatusOr<WorkCosts> WarmUp(TrackerModel& model, const RgbImage& picture, int iterations, const Clock& clock) {
  absl::StatusOr<WorkCosts> costs;
  std::thread([&] {
    try {
      costs = Measure(model, picture, iterations, clock);
    } catch (const std::bad_alloc&) {
      costs = absl::ResourceExhaustedError("no memory for a frame of the default processing size");
    } catch (const std::exception& e) {
      costs = absl::InternalError(absl::StrCat("the network does not run here: ", e.what()));
    }
  }).join();
  return costs;
}

}  // namespace holdfast
