// SPDX-License-Identifier: Apache-2.0
#include "model/thread_count.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

// A file system of its own. Quotas of the tests are below one processor where they are to be seen on any machine.
class ThreadCountTest : public ::testing::Test {
 protected:
  void Write(const std::string& name, const std::string& content) {
    const std::filesystem::path file = root_.path() / name;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file) << content;
  }
  void WriteMembership(const std::string& content) { Write("proc/self/cgroup", content); }
  int Permitted() const { return PermittedThreads(root_.path()); }
  // Those that the process may run on.
  const int all_ = PermittedThreads("/nowhere");

 private:
  TempDir root_;
};

TEST_F(ThreadCountTest, WithoutControlGroupsAllProcessorsMayBeKeptBusy) {
  EXPECT_GE(all_, 1);
  EXPECT_EQ(Permitted(), all_);
  WriteMembership("0::/\n");
  EXPECT_EQ(Permitted(), all_);
}

TEST_F(ThreadCountTest, AContainersQuotaIsThatOfTheRootThatItSees) {
  WriteMembership("0::/\n");
  Write("sys/fs/cgroup/cpu.max", "50000 100000\n");
  EXPECT_EQ(Permitted(), 1);
  Write("sys/fs/cgroup/cpu.max", "max 100000\n");
  EXPECT_EQ(Permitted(), all_);
}

TEST_F(ThreadCountTest, QuotasAreRoundedUpAndNeverMoreThanThereAreProcessors) {
  WriteMembership("0::/\n");
  Write("sys/fs/cgroup/cpu.max", "110000 100000\n");
  EXPECT_EQ(Permitted(), std::min(2, all_));
  Write("sys/fs/cgroup/cpu.max", "99999900000 100000\n");
  EXPECT_EQ(Permitted(), all_);
  Write("sys/fs/cgroup/cpu.max", "1000 100000\n");
  EXPECT_EQ(Permitted(), 1);
}

TEST_F(ThreadCountTest, GroupsAboveLimitItToo) {
  WriteMembership("0::/kubepods/pod7/main\n");
  Write("sys/fs/cgroup/kubepods/pod7/main/cpu.max", "max 100000\n");
  EXPECT_EQ(Permitted(), all_);
  Write("sys/fs/cgroup/kubepods/pod7/cpu.max", "30000 100000\n");
  EXPECT_EQ(Permitted(), 1);
}

TEST_F(ThreadCountTest, GroupsBesideItDoNot) {
  WriteMembership("0::/kubepods/pod7\n");
  Write("sys/fs/cgroup/kubepods/pod8/cpu.max", "30000 100000\n");
  EXPECT_EQ(Permitted(), all_);
}

TEST_F(ThreadCountTest, TheFirstVersionHasTwoFiles) {
  WriteMembership("5:memory:/docker/a\n4:cpu,cpuacct:/docker/a\n1:name=systemd:/docker/a\n");
  Write("sys/fs/cgroup/memory/docker/a/cpu.cfs_quota_us", "1000\n");  // not where quotas are
  Write("sys/fs/cgroup/memory/docker/a/cpu.cfs_period_us", "100000\n");
  EXPECT_EQ(Permitted(), all_);
  Write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us", "-1\n");
  Write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us", "100000\n");
  EXPECT_EQ(Permitted(), all_);
  Write("sys/fs/cgroup/cpu,cpuacct/docker/cpu.cfs_quota_us", "60000\n");
  Write("sys/fs/cgroup/cpu,cpuacct/docker/cpu.cfs_period_us", "100000\n");
  EXPECT_EQ(Permitted(), 1);
}

TEST_F(ThreadCountTest, WhatMakesNoSenseLimitsNothing) {
  WriteMembership("0::/\nnonsense\n::::\n");
  for (const char* content : {"\n", "one two\n", "-5 100000\n", "50000\n", "50000 0\n"}) {
    Write("sys/fs/cgroup/cpu.max", content);
    EXPECT_EQ(Permitted(), all_) << content;
  }
}

TEST_F(ThreadCountTest, WhatCannotBeReadLimitsNothing) {
  WriteMembership("0::/\n");
  Write("sys/fs/cgroup/cpu.max/file", "a directory is in its place");
  EXPECT_EQ(Permitted(), all_);
}

TEST_F(ThreadCountTest, WhoAsksForThreadsGetsThem) {
  EXPECT_EQ(ThreadCount(7), 7);
  EXPECT_EQ(ThreadCount(0), PermittedThreads());
}

}  // namespace
}  // namespace holdfast
