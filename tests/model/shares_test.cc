// SPDX-License-Identifier: Apache-2.0
#include "model/shares.h"

#include <ATen/Parallel.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <new>
#include <stdexcept>
#include <tuple>
#include <vector>

#include "absl/synchronization/barrier.h"
#include "absl/synchronization/mutex.h"

namespace holdfast {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::UnorderedElementsAre;

constexpr ShareSize kOne = {1, 1};
constexpr ShareSize kSome = {8, 64};

class SharesTest : public testing::Test {
 protected:
  ~SharesTest() override { at::set_num_threads(threads_); }

 private:
  const int threads_ = at::get_num_threads();
};

struct Share {
  int64_t begin = 0;
  int64_t end = 0;
  int threads = 0;  // of an operation inside
  bool operator==(const Share& other) const {
    return std::tie(begin, end, threads) == std::tie(other.begin, other.end, other.threads);
  }
};

std::vector<Share> SharesOn(int threads, int64_t count, ShareSize size) {
  at::set_num_threads(threads);
  absl::Mutex mutex;
  std::vector<Share> shares;
  ForEachShare(count, size, [&](int64_t begin, int64_t end) {
    absl::MutexLock lock(&mutex);
    shares.push_back({begin, end, at::get_num_threads()});
  });
  EXPECT_EQ(at::get_num_threads(), threads);
  return shares;
}

TEST_F(SharesTest, EachThingIsInOneShareWhateverTheNumberOfThreads) {
  for (const int threads : {1, 2, 3, 8}) {
    for (const int64_t count : {0, 1, 2, 5, 31, 100, 1000}) {
      for (const ShareSize size : {kOne, kSome}) {
        std::vector<int> times(count);
        for (const Share& share : SharesOn(threads, count, size)) {
          for (int64_t i = share.begin; i < share.end; ++i) ++times[i];
        }
        EXPECT_THAT(times, Each(1)) << count << " for " << threads << " threads";
      }
    }
  }
}

TEST_F(SharesTest, SharesAreEqualAndOperationsInsideThemUseOneThread) {
  EXPECT_THAT(SharesOn(2, 4, kOne),
              UnorderedElementsAre(Share{0, 1, 1}, Share{1, 2, 1}, Share{2, 3, 1}, Share{3, 4, 1}));
  EXPECT_THAT(SharesOn(2, 31, kSome), UnorderedElementsAre(Share{0, 15, 1}, Share{15, 31, 1}));
  EXPECT_THAT(SharesOn(2, 60, kSome),
              UnorderedElementsAre(Share{0, 15, 1}, Share{15, 30, 1}, Share{30, 45, 1}, Share{45, 60, 1}));
  EXPECT_THAT(SharesOn(2, 130, kSome),
              UnorderedElementsAre(Share{0, 32, 1}, Share{32, 65, 1}, Share{65, 97, 1}, Share{97, 130, 1}));
}

TEST_F(SharesTest, WhatWouldLeaveHalfOfTheThreadsIdleComesLastWithAllOfThem) {
  EXPECT_THAT(SharesOn(2, 1, kOne), ElementsAre(Share{0, 1, 2}));
  EXPECT_EQ(SharesOn(2, 3, kOne).back(), (Share{2, 3, 2}));
  EXPECT_EQ(SharesOn(4, 6, kOne).back(), (Share{4, 6, 4}));
  EXPECT_THAT(SharesOn(2, 15, kSome), ElementsAre(Share{0, 15, 2}));
  EXPECT_THAT(SharesOn(4, 3, kOne), UnorderedElementsAre(Share{0, 1, 1}, Share{1, 2, 1}, Share{2, 3, 1}));
}

TEST_F(SharesTest, SharesRunAtTheSameTime) {
  at::set_num_threads(2);
  auto* both = new absl::Barrier(2);  // of two threads, or this test would never end
  ForEachShare(2, kOne, [&](int64_t, int64_t) {
    if (both->Block()) delete both;
  });
}

TEST_F(SharesTest, ThrowsWhatAShareThrew) {
  at::set_num_threads(2);
  const auto fail_at = [](int64_t at, auto error) {
    ForEachShare(5, kOne, [&](int64_t begin, int64_t) {
      if (begin == at) throw error;
    });
  };
  EXPECT_THROW(fail_at(1, std::bad_alloc()), std::bad_alloc);
  EXPECT_THROW(fail_at(4, std::runtime_error("no kernel")), std::runtime_error);
}

}  // namespace
}  // namespace holdfast
