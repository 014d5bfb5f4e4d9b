// SPDX-License-Identifier: Apache-2.0
#include "training/distributed.h"

#include <gtest/gtest.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <map>
#include <torch/csrc/distributed/c10d/TCPStore.hpp>

#include "api/clock.h"
#include "model/presets.h"
#include "tests/support/free_port.h"
#include "tests/support/status_matchers.h"
#include "tests/support/two_ranks.h"
#include "training/gradient.h"
#include "training/loss/clip_step.h"
#include "training/training_data.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;

absl::StatusOr<GroupOptions> From(const std::map<std::string, std::string>& variables) {
  return GroupOptionsFromEnvironment([&](const char* name) -> const char* {
    const auto found = variables.find(name);
    return found == variables.end() ? nullptr : found->second.c_str();
  });
}

// The first of two processes, and what else is said.
absl::StatusOr<GroupOptions> FromTwo(std::map<std::string, std::string> variables) {
  variables.insert({{"RANK", "0"}, {"WORLD_SIZE", "2"}, {"MASTER_ADDR", "a"}, {"MASTER_PORT", "1"}});
  return From(variables);
}

void ExpectSums(ProcessGroup& group) {
  torch::Tensor sum = torch::tensor({1.0f + static_cast<float>(group.rank()), 10.0f});
  ASSERT_THAT(group.Sum(sum), IsOk());
  EXPECT_TRUE(torch::equal(sum, torch::tensor({3.0f, 20.0f})));
}

TEST(GroupOptionsTest, WithoutVariablesThereIsOneProcess) {
  const auto options = From({});
  ASSERT_THAT(options, IsOk());
  EXPECT_EQ(options->world, 1);
  EXPECT_EQ(options->rank, 0);
}

// Kubernetes tells every container of a service named "master" in variables of these names.
TEST(GroupOptionsTest, ASingleProcessIgnoresWhatNamesOthers) {
  std::map<std::string, std::string> variables = {
      {"MASTER_PORT", "tcp://10.0.0.7:80"}, {"MASTER_ADDR", "10.0.0.7"}, {"RANK", "first"}, {"LOCAL_RANK", "3"}};
  EXPECT_THAT(From(variables), IsOk());
  variables["WORLD_SIZE"] = "1";
  const auto options = From(variables);
  ASSERT_THAT(options, IsOk());
  EXPECT_EQ(options->world, 1);
  EXPECT_EQ(options->rank, 0);
  variables["WORLD_SIZE"] = "2";
  EXPECT_THAT(From(variables), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("RANK")));
}

// Each of them would train by itself, in the directory of all.
TEST(GroupOptionsTest, ARankOfAGroupOfUnknownSizeIsRefused) {
  for (const char* size : {"", "1"}) {
    std::map<std::string, std::string> variables = {{"RANK", "2"}, {"MASTER_ADDR", "node-0"}};
    if (*size != 0) variables["WORLD_SIZE"] = size;
    EXPECT_THAT(From(variables), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("RANK"))) << size;
  }
}

TEST(GroupOptionsTest, ReadsTheStandardVariables) {
  const auto options = From({{"RANK", "2"}, {"WORLD_SIZE", "4"}, {"MASTER_ADDR", "node-0"}, {"MASTER_PORT", "29500"}});
  ASSERT_THAT(options, IsOk());
  EXPECT_EQ(options->rank, 2);
  EXPECT_EQ(options->world, 4);
  EXPECT_EQ(options->address, "node-0");
  EXPECT_EQ(options->port, 29500);
}

TEST(GroupOptionsTest, EachProcessOfAMachineHasAGpuOfItsOwn) {
  const auto options =
      From({{"RANK", "3"}, {"LOCAL_RANK", "1"}, {"WORLD_SIZE", "4"}, {"MASTER_ADDR", "a"}, {"MASTER_PORT", "1"}});
  ASSERT_THAT(options, IsOk());
  EXPECT_EQ(DeviceOf("cuda", *options), "cuda:1");
  EXPECT_EQ(DeviceOf("cuda:0", *options), "cuda:0") << "told";
  EXPECT_EQ(DeviceOf("cpu", *options), "cpu");
  EXPECT_EQ(DeviceOf("cuda", GroupOptions()), "cuda");
}

TEST(GroupOptionsTest, ReadsWhatTorchrunSaysOfItsStore) {
  EXPECT_EQ(FromTwo({})->agent_prefix, "");
  EXPECT_EQ(FromTwo({{"TORCHELASTIC_USE_AGENT_STORE", "False"}})->agent_prefix, "");
  EXPECT_EQ(FromTwo({{"TORCHELASTIC_USE_AGENT_STORE", "True"}, {"TORCHELASTIC_RESTART_COUNT", "3"}})->agent_prefix,
            "/worker/attempt_3");
}

TEST(GroupOptionsTest, ReadsTheInterfacesOfTheNetwork) {
  EXPECT_TRUE(FromTwo({})->interfaces.empty());
  EXPECT_EQ(FromTwo({{"GLOO_SOCKET_IFNAME", "eth0,eth1"}})->interfaces, (std::vector<std::string>{"eth0", "eth1"}));
}

TEST(GroupOptionsTest, NamesTheVariableThatIsWrong) {
  EXPECT_THAT(FromTwo({{"LOCAL_RANK", "2"}}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("LOCAL_RANK")));
  EXPECT_THAT(From({{"WORLD_SIZE", "two"}}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("WORLD_SIZE")));
  EXPECT_THAT(From({{"WORLD_SIZE", "2"}, {"RANK", "2"}}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("RANK")));
  EXPECT_THAT(From({{"WORLD_SIZE", "2"}}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("MASTER_ADDR")));
  EXPECT_THAT(From({{"WORLD_SIZE", "2"}, {"MASTER_ADDR", "a"}, {"MASTER_PORT", "70000"}}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("MASTER_PORT")));
}

TEST(ProcessGroupTest, ASingleProcessKeepsItsNumbers) {
  const auto group = ProcessGroup::Join({}, torch::kCPU);
  ASSERT_THAT(group, IsOk());
  torch::Tensor tensor = torch::tensor({1.0f, 2.0f});
  ASSERT_THAT((*group)->Sum(tensor), IsOk());
  ASSERT_THAT((*group)->Broadcast(tensor), IsOk());
  EXPECT_TRUE(torch::equal(tensor, torch::tensor({1.0f, 2.0f})));
}

TEST(ProcessGroupTest, TwoProcessesSumAndTakeOver) {
  AsTwoRanks([](ProcessGroup& group) {
    ExpectSums(group);
    torch::Tensor first = torch::full({2}, static_cast<float>(group.rank()) + 5);
    ASSERT_THAT(group.Broadcast(first), IsOk());
    EXPECT_TRUE(torch::equal(first, torch::tensor({5.0f, 5.0f})));
  });
}

// The collectives take the numbers as they lie in memory, and NCCL none that do not lie in a row.
TEST(ProcessGroupTest, ExchangesNumbersByTheirIndicesHoweverTheyLieInMemory) {
  AsTwoRanks([](ProcessGroup& group) {
    const torch::Tensor numbers = torch::arange(6, torch::kFloat32).view({2, 3});
    const torch::Tensor columns = numbers.t().contiguous().t();  // the same, column by column
    torch::Tensor first = group.rank() == 0 ? columns.clone() : torch::zeros({2, 3});
    ASSERT_THAT(group.Broadcast(first), IsOk());
    EXPECT_TRUE(torch::equal(first, numbers));
    torch::Tensor taken = group.rank() == 0 ? numbers.clone() : torch::zeros_like(columns);
    ASSERT_THAT(group.Broadcast(taken), IsOk());
    EXPECT_TRUE(torch::equal(taken, numbers));
    torch::Tensor sum = group.rank() == 0 ? columns.clone() : numbers.clone();
    ASSERT_THAT(group.Sum(sum), IsOk());
    EXPECT_TRUE(torch::equal(sum, 2 * numbers));
  });
}

TEST(ProcessGroupTest, JoinsAtTheStoreOfAnAgentTimeAndAgain) {
  c10d::TCPStoreOptions store;
  store.port = 0;
  store.isServer = true;
  store.waitWorkers = false;
  const c10d::TCPStore agent("127.0.0.1", store);
  GroupOptions options = TwoProcesses();
  options.port = agent.getPort();
  for (const char* attempt : {"/worker/attempt_0", "/worker/attempt_1"}) {
    options.agent_prefix = attempt;
    AsTwoRanks(options, ExpectSums);
  }
}

TEST(ProcessGroupTest, JoinsByTheInterfaceThatIsAskedFor) {
  GroupOptions options = TwoProcesses();
  options.interfaces = {"lo"};
  AsTwoRanks(options, ExpectSums);
  options.interfaces = {"no-such-one"};
  options.port = FreePort();
  EXPECT_THAT(ProcessGroup::Join(options, torch::kCPU),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("no-such-one")));
}

TEST(ProcessGroupTest, WaitsNoLongerThanItMayForTheOthers) {
  const auto group = ProcessGroup::Join({1, 2, "127.0.0.1", FreePort(), absl::Milliseconds(200)}, torch::kCPU);
  EXPECT_THAT(group, StatusIs(absl::StatusCode::kUnavailable, HasSubstr("rank 1 of 2 could not join")));
}

// The gradient of the given clips, scaled as a step of two clips scales it.
torch::Tensor GradientOf(const std::vector<size_t>& indices, ProcessGroup& group, std::vector<double>& extra) {
  torch::manual_seed(3);
  PointModel network(*PresetByName("test"));
  torch::NoGradGuard no_grad;
  torch::manual_seed(4);
  for (const torch::Tensor& parameter : network->parameters()) {
    parameter.copy_(torch::sin(torch::arange(parameter.numel()).to(torch::kFloat32)).view(parameter.sizes()) * 0.1);
  }
  torch::AutoGradMode with_grad(true);
  TrainingDataOptions data;
  data.frames = 6;
  const auto clips = OpenTrainingData(data, {1, 48, 64, 8, 2});
  for (const size_t index : indices) {
    Rng rng(9, index);
    const ClipTensors clip = *ToTensors(*(*clips)->Get(index, rng), 8);
    extra[0] += AddClipGradient(*network, clip, {{}, {0.5, 0}, 2}, rng, SystemClock()).loss.total;
  }
  return *SumGradients(network->parameters(), 0.5, group, extra);
}

TEST(ProcessGroupTest, GradientsOfTwoProcessesEqualThoseOfOneWithTheWholeBatch) {
  const auto single = ProcessGroup::Join({}, torch::kCPU);
  std::vector<double> whole_loss = {0};
  const torch::Tensor whole = GradientOf({0, 1}, **single, whole_loss);
  ASSERT_GT(whole.norm().item<float>(), 0);
  AsTwoRanks([&](ProcessGroup& group) {
    std::vector<double> loss = {0};
    const torch::Tensor gradient = GradientOf({static_cast<size_t>(group.rank())}, group, loss);
    EXPECT_LT(((gradient - whole).norm() / whole.norm()).item<double>(), 1e-5);
    EXPECT_NEAR(loss[0], whole_loss[0], 1e-4 * whole_loss[0]);
  });
}

}  // namespace
}  // namespace holdfast
