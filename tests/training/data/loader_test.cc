// SPDX-License-Identifier: Apache-2.0
#include "training/data/loader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "absl/synchronization/notification.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// Sample i is named after i and after the first number of its Rng; indices in 'bad' are damaged, 'throwing' ones throw.
class NumberedSamples : public Dataset {
 public:
  explicit NumberedSamples(size_t size) : size_(size) {}
  size_t size() const override { return size_; }
  absl::StatusOr<Sample> Get(size_t index, Rng& rng) const override {
    ++calls;
    if (gate != nullptr) gate->WaitForNotification();
    if (bad.count(index) != 0) return absl::DataLossError("file " + std::to_string(index) + " is damaged");
    if (throwing.count(index) != 0) throw std::runtime_error("codec");
    Sample sample;
    sample.source = std::to_string(index) + "/" + std::to_string(rng.Next() % 1000);
    return sample;
  }
  mutable std::atomic<int> calls{0};
  std::set<size_t> bad, throwing;
  absl::Notification* gate = nullptr;

 private:
  const size_t size_;
};

std::vector<std::string> Names(const std::vector<Sample>& batch) {
  std::vector<std::string> names;
  for (const Sample& sample : batch) names.push_back(sample.source);
  return names;
}

std::vector<std::string> Read(const Dataset& dataset, const LoaderOptions& options, int batches) {
  const auto loader = Loader::Create(dataset, options).value();
  std::vector<std::string> names;
  for (int i = 0; i < batches; ++i) {
    for (const std::string& name : Names(loader->Next().value())) names.push_back(name);
  }
  return names;
}

LoaderOptions Options(int64_t batch_size, int workers) {
  LoaderOptions options;
  options.batch_size = batch_size;
  options.workers = workers;
  options.seed = 9;
  return options;
}

TEST(LoaderTest, BatchesAreTheSameWithAnyNumberOfWorkers) {
  NumberedSamples samples(7);
  samples.bad = {3};
  const std::vector<std::string> expected = Read(samples, Options(3, 0), 20);
  ASSERT_EQ(expected.size(), 60u);
  for (const int workers : {1, 2, 5}) EXPECT_EQ(Read(samples, Options(3, workers), 20), expected) << workers;
}

TEST(LoaderTest, TheNextEpochDrawsTheSameSamplesWithOtherChances) {
  const NumberedSamples samples(2);
  const std::vector<std::string> names = Read(samples, Options(2, 0), 2);
  EXPECT_EQ(names[0].substr(0, 2), "0/");
  EXPECT_EQ(names[2].substr(0, 2), "0/");
  EXPECT_NE(names[0], names[2]);
}

TEST(LoaderTest, GoingOnAtABatchGivesWhatAnUninterruptedRunGives) {
  const NumberedSamples samples(7);
  const std::vector<std::string> all = Read(samples, Options(2, 2), 10);
  LoaderOptions resumed = Options(2, 2);
  resumed.first_draw = 12;
  EXPECT_EQ(Read(samples, resumed, 4), std::vector<std::string>(all.begin() + 12, all.end()));
}

TEST(LoaderTest, RanksTogetherSeeTheBatchesOfOneProcess) {
  const NumberedSamples samples(11);
  const std::vector<std::string> whole = Read(samples, Options(4, 0), 1);
  LoaderOptions half = Options(2, 1);
  half.world = 2;
  const std::vector<std::string> first = Read(samples, half, 1);
  half.rank = 1;
  const std::vector<std::string> second = Read(samples, half, 1);
  EXPECT_THAT(whole, ElementsAre(first[0], first[1], second[0], second[1]));
}

TEST(LoaderTest, AnotherNumberOfRanksGoesOnAtTheNextDraw) {
  const NumberedSamples samples(11);
  const std::vector<std::string> whole = Read(samples, Options(1, 0), 5);
  LoaderOptions two = Options(1, 0);
  two.first_draw = 3;
  two.world = 2;
  EXPECT_EQ(Read(samples, two, 1), std::vector<std::string>{whole[3]});
  two.rank = 1;
  EXPECT_EQ(Read(samples, two, 1), std::vector<std::string>{whole[4]});
}

TEST(LoaderTest, DamagedSamplesAreReplacedAndCounted) {
  NumberedSamples samples(4);
  samples.bad = {1};
  samples.throwing = {2};
  for (const int workers : {0, 2}) {
    const auto loader = Loader::Create(samples, Options(4, workers)).value();
    const std::vector<std::string> names = Names(loader->Next().value());
    for (const std::string& name : names) EXPECT_TRUE(name[0] == '0' || name[0] == '3') << name;
    EXPECT_GE(loader->skipped(), 2);
    EXPECT_THAT(loader->last_error(), ::testing::AnyOf(HasSubstr("file 1 is damaged"), HasSubstr("codec")));
  }
}

TEST(LoaderTest, OnlyDamagedSamplesAreAnErrorAndTheLoaderGoesOn) {
  NumberedSamples samples(2);
  samples.bad = {0, 1};
  LoaderOptions options = Options(1, 1);
  options.max_attempts = 5;
  const auto loader = Loader::Create(samples, options).value();
  EXPECT_THAT(loader->Next(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("5 samples in a row")));
  EXPECT_THAT(loader->Next(), StatusIs(absl::StatusCode::kDataLoss));
}

TEST(LoaderTest, ReadsAheadNoFurtherThanAllowed) {
  const NumberedSamples samples(100);
  LoaderOptions options = Options(1, 3);
  options.prefetch = 2;
  const auto loader = Loader::Create(samples, options).value();
  for (int i = 0; i < 10; ++i) {
    ASSERT_THAT(loader->Next(), IsOk());
    EXPECT_LE(samples.calls, i + 1 + options.prefetch);
  }
}

TEST(LoaderTest, StopsCleanlyWhileWorkersAreBusyAndBatchesAreLeft) {
  absl::Notification gate;
  NumberedSamples samples(100);
  samples.gate = &gate;
  auto loader = Loader::Create(samples, Options(1, 3)).value();
  gate.Notify();
  loader.reset();
  EXPECT_LE(samples.calls, 4);
}

TEST(LoaderTest, WrongOptionsAndEmptyDataSetsAreRefused) {
  const NumberedSamples samples(3), none(0);
  std::vector<LoaderOptions> wrong(5, Options(1, 1));
  wrong[0].batch_size = 0;
  wrong[1].workers = -1;
  wrong[2].prefetch = 0;
  wrong[3].rank = 1;
  wrong[4].first_draw = -1;
  for (const LoaderOptions& options : wrong) {
    EXPECT_THAT(Loader::Create(samples, options), StatusIs(absl::StatusCode::kInvalidArgument));
  }
  EXPECT_THAT(Loader::Create(none, Options(1, 1)), StatusIs(absl::StatusCode::kFailedPrecondition));
}

}  // namespace
}  // namespace holdfast
