// SPDX-License-Identifier: Apache-2.0
#include "training/trainer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "model/checkpoint/checkpoint.h"
#include "model/checkpoint/safetensors.h"
#include "model/presets.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/two_ranks.h"
#include "training/training_checkpoint.h"
#include "training/training_data.h"

namespace holdfast {
namespace {

using ::testing::Contains;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

// Remembers what it hears; 'on_step' may interfere.
class Recorder : public TrainingObserver {
 public:
  void StepDone(const StepReport& report) override {
    steps.push_back(report);
    if (on_step) on_step(report);
  }
  void Validated(const ValidationReport& report) override { validations.push_back(report); }
  void Notice(absl::string_view text) override { notices.emplace_back(text); }

  std::vector<double> losses() const {
    std::vector<double> values;
    for (const StepReport& step : steps) values.push_back(step.loss.total);
    return values;
  }

  std::function<void(const StepReport&)> on_step;
  std::vector<StepReport> steps;
  std::vector<ValidationReport> validations;
  std::vector<std::string> notices;
};

// Synthetic clips, changed on their way or not delivered at all.
class ChangedClips : public Dataset {
 public:
  ChangedClips(std::unique_ptr<Dataset> source, std::function<absl::Status(size_t, Sample&)> change)
      : source_(std::move(source)), change_(std::move(change)) {}
  size_t size() const override { return source_->size(); }
  absl::StatusOr<Sample> Get(size_t index, Rng& rng) const override {
    absl::StatusOr<Sample> sample = source_->Get(index, rng);
    if (!sample.ok()) return sample;
    const absl::Status status = change_(index, *sample);
    if (!status.ok()) return status;
    return sample;
  }

 private:
  std::unique_ptr<Dataset> source_;
  std::function<absl::Status(size_t, Sample&)> change_;
};

class ChangedSource : public ClipSource {
 public:
  explicit ChangedSource(std::function<absl::Status(size_t, Sample&)> change) : change_(std::move(change)) {}
  absl::StatusOr<std::unique_ptr<Loader>> Open(const Phase& phase, int64_t first_draw) override {
    TrainingDataOptions data;
    data.frames = 6;
    clips_ = std::make_unique<ChangedClips>(*OpenTrainingData(data, phase), change_);
    LoaderOptions options;
    options.first_draw = first_draw;
    return Loader::Create(*clips_, options);
  }

 private:
  std::function<absl::Status(size_t, Sample&)> change_;
  std::unique_ptr<ChangedClips> clips_;
};

TrainingDataOptions TestData() {
  TrainingDataOptions data;
  data.frames = 6;
  return data;
}

// Of a file of tensors; empty where it cannot be read.
std::map<std::string, std::string> Metadata(const std::string& path) {
  const absl::StatusOr<TensorFile> file = ReadSafetensors(path);
  return file.ok() ? file->metadata : std::map<std::string, std::string>();
}

class TrainerTest : public ::testing::Test {
 protected:
  TrainerTest() {
    options_.recipe = *RecipeByName("test");
    options_.checkpoint_every = 0;
    options_.validate_every = 0;
  }

  // To validate on.
  absl::StatusOr<Validation> TwoClips() const {
    const auto clips = OpenTrainingData(TestData(), options_.recipe.phases[0]);
    return Validation::Create(**clips, /*clips=*/2, /*seed=*/5, /*iterations=*/2);
  }

  absl::StatusOr<TrainingSummary> Train(const TempDir& dir, Recorder& recorder, ClipSource* clips = nullptr,
                                        const Validation* validation = nullptr) {
    options_.directory = dir.path();
    torch::manual_seed(11);
    network_ = PointModel(network_options_);
    const auto group = ProcessGroup::Join({}, torch::kCPU);
    return TrainAs(**group, network_, recorder, clips, validation);
  }

  absl::StatusOr<TrainingSummary> TrainAs(ProcessGroup& group, const PointModel& network, Recorder& recorder,
                                          ClipSource* clips = nullptr, const Validation* validation = nullptr) {
    TrainingClips synthetic(TestData(), {options_.recipe.batch_size, 1, group.rank(), group.world()});
    TrainerParts parts;
    parts.model = network;
    parts.clips = clips == nullptr ? &synthetic : clips;
    parts.validation = validation;
    parts.group = &group;
    parts.observer = &recorder;
    parts.clock = &clock_;
    parts.stop = &stop_;
    auto trainer = Trainer::Create(options_, parts);
    if (!trainer.ok()) return trainer.status();
    return (*trainer)->Run();
  }

  // As two processes; what each of them ends with.
  std::array<absl::Status, 2> TrainAsTwo(const TempDir& dir, Recorder& recorder) {
    options_.directory = dir.path();
    std::array<absl::Status, 2> ends;
    AsTwoRanks([&](ProcessGroup& group) {
      Recorder of_the_other;  // hears nothing
      ends[static_cast<size_t>(group.rank())] =
          TrainAs(group, PointModel(network_options_), group.rank() == 0 ? recorder : of_the_other).status();
    });
    return ends;
  }

  // Until after step 'last', as if a signal came then.
  absl::StatusOr<TrainingSummary> TrainUntil(int64_t last, const TempDir& dir, Recorder& recorder) {
    recorder.on_step = [this, last](const StepReport& report) { stop_ = report.step >= last - 1; };
    const auto summary = Train(dir, recorder);
    stop_ = false;
    recorder.on_step = nullptr;
    return summary;
  }

  ModelOptions network_options_ = *PresetByName("test");
  TrainerOptions options_;
  SimulatedClock clock_;
  std::atomic<bool> stop_{false};
  PointModel network_{nullptr};
};

TEST_F(TrainerTest, LearnsASingleClip) {
  options_.recipe.steps = 60;
  options_.recipe.noisy_start = options_.recipe.streaming_windows = 0;
  options_.recipe.schedule.peak_rate = 5e-3;
  ChangedSource one([](size_t, Sample& sample) {
    TrainingDataOptions data = TestData();
    Rng rng(0);
    sample = *(*OpenTrainingData(data, {1, 48, 64, 8, 2}))->Get(3, rng);
    return absl::OkStatus();
  });
  const TempDir dir;
  Recorder recorder;
  ASSERT_THAT(Train(dir, recorder, &one), IsOk());
  EXPECT_LT(recorder.steps.back().loss.total, 0.5 * recorder.steps.front().loss.total);
}

TEST_F(TrainerTest, ClipsBesideEachOtherGiveTheWeightsOfClipsOneAfterTheOther) {
  options_.recipe.steps = 3;
  options_.recipe.batch_size = 2;
  const int threads = torch::get_num_threads();
  const TempDir one, two, four;
  Recorder after, beside, inside;
  torch::set_num_threads(1);
  ASSERT_THAT(Train(one, after), IsOk());
  const std::vector<torch::Tensor> want = network_->parameters();
  torch::set_num_threads(2);
  ASSERT_THAT(Train(two, beside), IsOk());
  EXPECT_EQ(beside.losses(), after.losses());
  for (size_t i = 0; i < want.size(); ++i) EXPECT_TRUE(torch::equal(network_->parameters()[i], want[i])) << i;
  torch::set_num_threads(4);  // too many for two clips beside each other: they share the threads inside operations
  ASSERT_THAT(Train(four, inside), IsOk());
  torch::set_num_threads(threads);
  EXPECT_NEAR(inside.losses()[0], after.losses()[0], 1e-4 * after.losses()[0]);
}

TEST_F(TrainerTest, AResumedRunHasTheLossesOfAnUninterruptedOne) {
  const TempDir whole, parts;
  Recorder uninterrupted, first, second;
  ASSERT_THAT(Train(whole, uninterrupted), IsOk());
  const auto stopped = TrainUntil(3, parts, first);
  ASSERT_THAT(stopped, IsOk());
  EXPECT_EQ(stopped->reason, StopReason::kAsked);
  EXPECT_EQ(stopped->step, 3);
  const auto finished = Train(parts, second);
  ASSERT_THAT(finished, IsOk());
  EXPECT_EQ(finished->reason, StopReason::kFinished);
  std::vector<double> joined = first.losses();
  for (const double loss : second.losses()) joined.push_back(loss);
  EXPECT_EQ(joined, uninterrupted.losses());
  const auto a = LoadModel(whole.File("final.safetensors")), b = LoadModel(parts.File("final.safetensors"));
  ASSERT_THAT(a, IsOk());
  ASSERT_THAT(b, IsOk());
  for (const auto& item : a->model->named_parameters()) {
    EXPECT_TRUE(torch::equal(item.value(), b->model->named_parameters()[item.key()])) << item.key();
  }
}

TEST_F(TrainerTest, ResumesExactlyInBfloat16WithAccumulationAndPhases) {
  options_.recipe.bfloat16 = true;
  options_.recipe.accumulate = 2;
  options_.recipe.phases = {{0.5, 48, 64, 8, 2}, {1.0, 64, 64, 8, 2}};
  const TempDir whole, parts;
  Recorder uninterrupted, first, second;
  ASSERT_THAT(Train(whole, uninterrupted), IsOk());
  ASSERT_THAT(TrainUntil(5, parts, first), IsOk());
  ASSERT_THAT(Train(parts, second), IsOk());
  std::vector<double> joined = first.losses();
  for (const double loss : second.losses()) joined.push_back(loss);
  EXPECT_EQ(joined, uninterrupted.losses());
  EXPECT_EQ(uninterrupted.steps.front().clips, 2);
}

TEST_F(TrainerTest, RemovesWhatAKilledProcessLeftHalfWritten) {
  const TempDir dir;
  const std::string left = dir.File(".holdfast-0123456789abcdef.tmp.safetensors");
  std::ofstream(left) << "half";
  Recorder recorder;
  ASSERT_THAT(Train(dir, recorder), IsOk());
  EXPECT_FALSE(std::filesystem::exists(left));
}

TEST_F(TrainerTest, AFinishedTrainingHasNothingLeftToDo) {
  const TempDir dir;
  Recorder first, again;
  ASSERT_THAT(Train(dir, first), IsOk());
  const std::string state = dir.File("checkpoint-00000008.state.safetensors");
  const auto written = Metadata(state);
  clock_.Advance(absl::Seconds(2));
  const auto summary = Train(dir, again);
  ASSERT_THAT(summary, IsOk());
  EXPECT_EQ(summary->step, options_.recipe.steps);
  EXPECT_TRUE(again.steps.empty());
  EXPECT_EQ(Metadata(state), written) << "the pair is not written again";
}

TEST_F(TrainerTest, AnotherNumberOfProcessesGoesOnAtTheNextClip) {
  const TempDir dir;
  Recorder first, second;
  ASSERT_THAT(TrainUntil(3, dir, first), IsOk());
  for (const absl::Status& end : TrainAsTwo(dir, second)) ASSERT_THAT(end, IsOk());
  EXPECT_THAT(second.notices, Contains(HasSubstr("processes: 1 before, 2 now; a step has 2 clips")));
  EXPECT_EQ((*FindTrainingCheckpoint(dir.path()))->state.next_draw, 3 + 2 * 5);
}

TEST_F(TrainerTest, ACheckpointThatCountsBatchesGoesOn) {
  const TempDir whole, dir;
  Recorder uninterrupted, first, second;
  options_.recipe.batch_size = 2;
  ASSERT_THAT(Train(whole, uninterrupted), IsOk());
  ASSERT_THAT(TrainUntil(3, dir, first), IsOk());
  const std::string path = dir.File("checkpoint-00000003.state.safetensors");
  auto file = ReadSafetensors(path);
  ASSERT_THAT(file, IsOk());
  file->metadata["holdfast.training_state"] = absl::StrReplaceAll(
      file->metadata["holdfast.training_state"], {{"\"next_draw\":6", "\"next_batch\":3"}, {",\"world\":1", ""}});
  ASSERT_THAT(file->metadata["holdfast.training_state"], HasSubstr("next_batch"));
  ASSERT_THAT(WriteSafetensors(path, *file), IsOk());
  ASSERT_THAT(Train(dir, second), IsOk());
  EXPECT_EQ(second.losses().back(), uninterrupted.losses().back());
}

TEST_F(TrainerTest, RefusesToGoOnWithAnotherRecipeSeedOrNetwork) {
  const TempDir dir;
  Recorder recorder;
  ASSERT_THAT(TrainUntil(2, dir, recorder), IsOk());
  options_.seed = 1;
  EXPECT_THAT(Train(dir, recorder), StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("seed=0")));
  options_.seed = 0;
  options_.recipe.loss.alpha = 0.5;
  EXPECT_THAT(Train(dir, recorder), StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("another recipe")));
  options_.recipe.loss.alpha = 0.15;
  network_options_.update_base = 16;
  EXPECT_THAT(Train(dir, recorder), StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("another network")));
}

TEST_F(TrainerTest, AStepWithoutAFiniteLossChangesNothingAndIsCounted) {
  ChangedSource clips([](size_t index, Sample& sample) {
    if (index == 2) {
      sample.SetPosition(3, 0, {3e38f, 3e38f});  // its distance overflows
      sample.visible[sample.At(3, 0)] = 0;
      sample.valid[sample.At(3, 0)] = 1;
    }
    return absl::OkStatus();
  });
  const TempDir dir;
  Recorder recorder;
  torch::Tensor before, after;
  recorder.on_step = [&](const StepReport& report) {
    if (report.step == 2) before = network_->parameters()[0].detach().clone();
    if (report.step == 3) after = network_->parameters()[0].detach().clone();
  };
  ASSERT_THAT(Train(dir, recorder, &clips), IsOk());
  EXPECT_FALSE(recorder.steps[1].skipped);
  EXPECT_TRUE(recorder.steps[2].skipped);
  EXPECT_TRUE(torch::equal(before, after));
  EXPECT_EQ(recorder.steps.back().skipped_steps, 1);
  EXPECT_TRUE(std::isfinite(recorder.steps.back().loss.total));
}

TEST_F(TrainerTest, StopsAfterManyStepsWithoutAFiniteLossAndKeepsTheLastGoodCheckpoint) {
  options_.recipe.steps = 100;
  options_.checkpoint_every = 4;
  options_.max_skipped_in_row = 3;
  const TempDir dir;
  Recorder recorder;
  recorder.on_step = [this](const StepReport& report) {
    torch::NoGradGuard no_grad;
    if (report.step == 5) network_->parameters()[0].fill_(std::nanf(""));
  };
  EXPECT_THAT(Train(dir, recorder), StatusIs(absl::StatusCode::kAborted, HasSubstr("3 steps in a row")));
  EXPECT_EQ(recorder.steps.size(), 8u);
  EXPECT_EQ((*FindTrainingCheckpoint(dir.path()))->state.step, 4);
  EXPECT_FALSE(std::filesystem::exists(dir.File("final.safetensors")));
}

TEST_F(TrainerTest, DamagedClipsAreSkippedAndCounted) {
  ChangedSource clips([](size_t index, Sample&) {
    return index % 3 == 1 ? absl::DataLossError("frame 00003.jpg does not decode") : absl::OkStatus();
  });
  const TempDir dir;
  Recorder recorder;
  ASSERT_THAT(Train(dir, recorder, &clips), IsOk());
  EXPECT_EQ(recorder.steps.size(), 8u);
  EXPECT_GE(recorder.steps.back().skipped_samples, 2);
  ASSERT_THAT(recorder.notices, Not(IsEmpty()));
  EXPECT_THAT(recorder.notices, Each(HasSubstr("00003.jpg does not decode")));
  EXPECT_LE(recorder.notices.size(), 4u) << "one each time the number has doubled";
}

TEST_F(TrainerTest, DataThatNeverComesEndsTheTrainingWithItsError) {
  ChangedSource clips([](size_t, Sample&) { return absl::DataLossError("frame 00003.jpg does not decode"); });
  const TempDir dir;
  Recorder recorder;
  EXPECT_THAT(Train(dir, recorder, &clips).status().message(), HasSubstr("00003.jpg"));
}

TEST_F(TrainerTest, NoProcessIsDoneBeforeTheResultIsWritten) {
  const TempDir dir;
  std::filesystem::create_directories(dir.path() / "final.safetensors");  // no file can take its place
  Recorder recorder;
  const auto failed = TrainAsTwo(dir, recorder);
  EXPECT_THAT(failed[0].message(), HasSubstr("final.safetensors"));
  EXPECT_THAT(failed[1], StatusIs(absl::StatusCode::kUnavailable, HasSubstr("another process failed")));
  std::filesystem::remove(dir.path() / "final.safetensors");
  for (const absl::Status& end : TrainAsTwo(dir, recorder)) EXPECT_THAT(end, IsOk());
  EXPECT_TRUE(std::filesystem::is_regular_file(dir.File("final.safetensors")));
}

TEST_F(TrainerTest, ATimeBudgetAnnealsTheRateAndEndsTheTraining) {
  options_.recipe.steps = 0;
  options_.time_budget = absl::Seconds(10);
  const TempDir dir;
  Recorder recorder;
  recorder.on_step = [this](const StepReport&) { clock_.Advance(absl::Seconds(2)); };
  const auto summary = Train(dir, recorder);
  ASSERT_THAT(summary, IsOk());
  EXPECT_EQ(summary->reason, StopReason::kFinished);
  EXPECT_EQ(summary->step, 6);
  EXPECT_DOUBLE_EQ(recorder.steps[3].progress, 0.6000000238418579);  // single precision travels with the gradients
  EXPECT_LT(recorder.steps.back().learning_rate, 0.3 * recorder.steps[2].learning_rate);
  EXPECT_TRUE(std::filesystem::exists(dir.File("final.safetensors")));
}

TEST_F(TrainerTest, AWallClockThatJumpsChangesStampsAlone) {
  options_.recipe.steps = 0;
  options_.time_budget = absl::Seconds(10);
  const TempDir dir;
  Recorder recorder;
  recorder.on_step = [this](const StepReport& report) {
    clock_.Advance(absl::Seconds(2));
    clock_.SetWallBy(report.step % 2 == 0 ? absl::Hours(30) : -absl::Hours(20));
  };
  const auto summary = Train(dir, recorder);
  ASSERT_THAT(summary, IsOk());
  EXPECT_EQ(summary->step, 6);
  EXPECT_EQ(recorder.steps[1].when - recorder.steps[0].when, absl::Seconds(2) - absl::Hours(20));
  for (const StepReport& step : recorder.steps) {
    EXPECT_EQ(step.elapsed, absl::Seconds(2) * (step.step - 1));
    EXPECT_EQ(step.times.total(), absl::ZeroDuration());
  }
}

TEST_F(TrainerTest, ElapsedTimeAddsUpOverRuns) {
  options_.recipe.steps = 0;
  options_.time_budget = absl::Seconds(10);
  const TempDir dir;
  Recorder first, second;
  first.on_step = [this](const StepReport& report) {
    clock_.Advance(absl::Seconds(2));
    stop_ = report.step == 2;
  };
  ASSERT_THAT(Train(dir, first), IsOk());
  stop_ = false;
  clock_.Advance(absl::Hours(5));
  second.on_step = [this](const StepReport&) { clock_.Advance(absl::Seconds(2)); };
  ASSERT_THAT(Train(dir, second), IsOk());
  EXPECT_EQ(first.steps.size() + second.steps.size(), 6u);
}

TEST_F(TrainerTest, ALongerTimeBudgetGoesOnWithAFinishedTraining) {
  options_.recipe.steps = 0;
  options_.time_budget = absl::Seconds(4);
  const TempDir dir;
  Recorder first, second;
  first.on_step = second.on_step = [this](const StepReport&) { clock_.Advance(absl::Seconds(2)); };
  ASSERT_THAT(Train(dir, first), IsOk());
  options_.time_budget = absl::Seconds(8);
  const auto summary = Train(dir, second);
  ASSERT_THAT(summary, IsOk());
  EXPECT_EQ(summary->reason, StopReason::kFinished);
  EXPECT_GT(summary->step, static_cast<int64_t>(first.steps.size()));
}

TEST_F(TrainerTest, ValidatesTheAveragedWeightsAndKeepsTheBest) {
  options_.validate_every = 4;
  const auto validation = TwoClips();
  ASSERT_THAT(validation, IsOk());
  const TempDir dir;
  Recorder recorder;
  const auto summary = Train(dir, recorder, nullptr, &*validation);
  ASSERT_THAT(summary, IsOk());
  ASSERT_EQ(recorder.validations.size(), 3u);  // at the start, after 4, at the end
  EXPECT_EQ(recorder.validations[0].step, 0);
  EXPECT_TRUE(recorder.validations[0].best);
  double best = -1;
  for (const ValidationReport& report : recorder.validations) best = std::max(best, *report.metrics.delta_vis);
  EXPECT_EQ(summary->best, best);
  EXPECT_TRUE(recorder.validations[0].metrics.oa.has_value());
  EXPECT_THAT(LoadModel(dir.File("best.safetensors")), IsOk());
}

TEST_F(TrainerTest, WeightsCarryTheirOwnValidation) {
  options_.validate_every = 4;
  const auto validation = TwoClips();
  ASSERT_THAT(validation, IsOk());
  const TempDir dir;
  Recorder recorder, again;
  recorder.on_step = [this](const StepReport& report) {
    torch::NoGradGuard no_grad;
    if (report.step != 5) return;
    for (const torch::Tensor& parameter : network_->parameters()) parameter.add_(1);  // for the worse
  };
  const auto summary = Train(dir, recorder, nullptr, &*validation);
  ASSERT_THAT(summary, IsOk());
  const double last = *recorder.validations.back().metrics.delta_vis;
  ASSERT_LT(last, summary->best);
  const auto metadata = [&](const char* name) { return Metadata(dir.File(name)); };
  EXPECT_EQ(metadata("best.safetensors")["holdfast.validation_delta_vis"], absl::StrCat(summary->best));
  EXPECT_EQ(metadata("final.safetensors")["holdfast.validation_delta_vis"], absl::StrCat(last));
  ASSERT_THAT(Train(dir, again, nullptr, &*validation), IsOk());
  EXPECT_EQ(metadata("final.safetensors")["holdfast.validation_delta_vis"], absl::StrCat(last)) << "started again";
}

TEST_F(TrainerTest, WeightsThatWereNotValidatedSayNothingOfIt) {
  const TempDir dir;
  Recorder recorder;
  ASSERT_THAT(Train(dir, recorder), IsOk());
  const auto metadata = Metadata(dir.File("final.safetensors"));
  EXPECT_EQ(metadata.count("holdfast.step"), 1u);
  EXPECT_EQ(metadata.count("holdfast.validation_delta_vis"), 0u);
}

TEST_F(TrainerTest, ReportsWhereTheTimeWentAndTheLearningRate) {
  const TempDir dir;
  Recorder recorder;
  ASSERT_THAT(Train(dir, recorder), IsOk());
  EXPECT_DOUBLE_EQ(recorder.steps[0].learning_rate, LearningRate(options_.recipe.schedule, 0));
  EXPECT_DOUBLE_EQ(recorder.steps[4].learning_rate, LearningRate(options_.recipe.schedule, 0.5));
  EXPECT_GT(recorder.steps[0].gradient_norm, 0);
  EXPECT_TRUE(std::isfinite(recorder.steps[0].loss.visibility));
}

TEST_F(TrainerTest, OptionsThatCannotWorkAreRefused) {
  const TempDir dir;
  Recorder recorder;
  options_.recipe.steps = 0;
  EXPECT_THAT(Train(dir, recorder), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("time budget")));
}

}  // namespace
}  // namespace holdfast
