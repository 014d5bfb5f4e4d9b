// SPDX-License-Identifier: Apache-2.0
#include "training/distributed.h"

#include <torch/version.h>

#include <exception>
#include <torch/csrc/distributed/c10d/PrefixStore.hpp>
#include <torch/csrc/distributed/c10d/ProcessGroupGloo.hpp>
#include <torch/csrc/distributed/c10d/TCPStore.hpp>
#ifdef USE_C10D_NCCL
#include <torch/csrc/distributed/c10d/ProcessGroupNCCL.hpp>
#endif
#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "training/first_line.h"

namespace holdfast {
namespace {

#if TORCH_VERSION_MAJOR >= 2
using Collectives = c10d::Backend;
#else
using Collectives = c10d::ProcessGroup;
#endif

class SingleProcess : public ProcessGroup {
 public:
  int64_t rank() const override { return 0; }
  int64_t world() const override { return 1; }
  absl::Status Sum(torch::Tensor&) override { return absl::OkStatus(); }
  absl::Status Broadcast(torch::Tensor&) override { return absl::OkStatus(); }
};

class C10dGroup : public ProcessGroup {
 public:
  // 'through_host': the collectives take tensors in the host's memory only.
  C10dGroup(const GroupOptions& options, bool through_host, c10::intrusive_ptr<Collectives> collectives)
      : options_(options), through_host_(through_host), collectives_(std::move(collectives)) {}

  int64_t rank() const override { return options_.rank; }
  int64_t world() const override { return options_.world; }

  absl::Status Sum(torch::Tensor& tensor) override {
    return Exchange([&](std::vector<at::Tensor>& tensors) { return collectives_->allreduce(tensors); }, tensor);
  }
  absl::Status Broadcast(torch::Tensor& tensor) override {
    return Exchange([&](std::vector<at::Tensor>& tensors) { return collectives_->broadcast(tensors); }, tensor);
  }

 private:
  template <typename Start>
  absl::Status Exchange(Start start, torch::Tensor& tensor) {
    try {
      // The collectives take numbers as they lie in memory; NCCL refuses what does not lie in a row.
      std::vector<at::Tensor> tensors = {(through_host_ ? tensor.cpu() : tensor).contiguous()};
      start(tensors)->wait();
      if (!tensors[0].is_same(tensor)) tensor.copy_(tensors[0]);
      return absl::OkStatus();
    } catch (const std::exception& e) {
      return absl::UnavailableError(absl::StrCat("rank ", options_.rank, " of ", options_.world,
                                                 " lost another process of the job: ", FirstLine(e)));
    }
  }

  const GroupOptions options_;
  const bool through_host_;
  const c10::intrusive_ptr<Collectives> collectives_;
};

c10::intrusive_ptr<c10d::Store> OpenStore(const GroupOptions& options, std::chrono::milliseconds timeout) {
  c10d::TCPStoreOptions store;
  store.port = static_cast<uint16_t>(options.port);
  store.isServer = options.rank == 0 && options.agent_prefix.empty();
  store.numWorkers = static_cast<size_t>(options.world);
  store.timeout = timeout;
#if TORCH_VERSION_MAJOR >= 2
  store.useLibUV = false;  // not every build has it
#endif
  auto opened = c10::make_intrusive<c10d::TCPStore>(options.address, store);
  if (options.agent_prefix.empty()) return opened;
  return c10::make_intrusive<c10d::PrefixStore>(options.agent_prefix, opened);
}

c10::intrusive_ptr<Collectives> OpenGloo(const GroupOptions& options) {
  const std::chrono::milliseconds timeout = absl::ToChronoMilliseconds(options.timeout);
  auto gloo = c10d::ProcessGroupGloo::Options::create(timeout);
  for (const std::string& interface : options.interfaces) {
    gloo->devices.push_back(c10d::ProcessGroupGloo::createDeviceForInterface(interface));
  }
  if (options.interfaces.empty()) gloo->devices.push_back(c10d::ProcessGroupGloo::createDefaultDevice());
  return c10::make_intrusive<c10d::ProcessGroupGloo>(OpenStore(options, timeout), static_cast<int>(options.rank),
                                                     static_cast<int>(options.world), gloo);
}

std::unique_ptr<ProcessGroup> OpenGroup(const GroupOptions& options, torch::DeviceType device) {
#ifdef USE_C10D_NCCL
  if (device == torch::kCUDA) {
    const std::chrono::milliseconds timeout = absl::ToChronoMilliseconds(options.timeout);
    auto nccl = c10d::ProcessGroupNCCL::Options::create();
    nccl->timeout = timeout;
    return std::make_unique<C10dGroup>(
        options, false,
        c10::make_intrusive<c10d::ProcessGroupNCCL>(OpenStore(options, timeout), static_cast<int>(options.rank),
                                                    static_cast<int>(options.world), nccl));
  }
#endif
  return std::make_unique<C10dGroup>(options, device != torch::kCPU, OpenGloo(options));
}

// The number in variable 'name', or 'fallback' without it.
absl::Status ReadNumber(const char* name, const char* text, int64_t fallback, int64_t& number) {
  number = fallback;
  if (text == nullptr || absl::SimpleAtoi(text, &number)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(name, " is no number: '", text, "'"));
}

absl::Status RankOutOfRange() { return absl::InvalidArgumentError("RANK must be in 0 .. WORLD_SIZE - 1"); }

}  // namespace

absl::Status GroupOptions::Validate() const {
  if (world < 1) return absl::InvalidArgumentError("WORLD_SIZE must be 1 or more");
  if (rank < 0 || rank >= world) return RankOutOfRange();
  if (local_rank >= world || local_rank > std::numeric_limits<c10::DeviceIndex>::max()) {
    return absl::InvalidArgumentError("LOCAL_RANK must be below WORLD_SIZE");
  }
  if (world == 1) return absl::OkStatus();
  if (address.empty()) return absl::InvalidArgumentError("MASTER_ADDR is needed when WORLD_SIZE is above 1");
  if (port < 1 || port > 65535) return absl::InvalidArgumentError("MASTER_PORT must be in 1 .. 65535");
  return absl::OkStatus();
}

absl::StatusOr<GroupOptions> GroupOptionsFromEnvironment(const std::function<const char*(const char*)>& getenv) {
  GroupOptions options;
  absl::Status world = ReadNumber("WORLD_SIZE", getenv("WORLD_SIZE"), 1, options.world);
  if (!world.ok()) return world;
  const absl::Status rank = ReadNumber("RANK", getenv("RANK"), 0, options.rank);
  if (options.world == 1) {
    // Others of its job would each train by themselves, in one directory.
    if (rank.ok() && options.rank > 0) return RankOutOfRange();
    return GroupOptions();
  }
  int64_t port = 0;
  for (const absl::Status& status : {rank, ReadNumber("LOCAL_RANK", getenv("LOCAL_RANK"), -1, options.local_rank),
                                     ReadNumber("MASTER_PORT", getenv("MASTER_PORT"), 0, port)}) {
    if (!status.ok()) return status;
  }
  options.port = static_cast<int>(std::min<int64_t>(std::max<int64_t>(port, 0), 65536));
  if (const char* address = getenv("MASTER_ADDR")) options.address = address;
  if (const char* names = getenv("GLOO_SOCKET_IFNAME")) {
    options.interfaces = absl::StrSplit(names, ',', absl::SkipEmpty());
  }
  const char *agent = getenv("TORCHELASTIC_USE_AGENT_STORE"), *restarts = getenv("TORCHELASTIC_RESTART_COUNT");
  if (agent != nullptr && absl::string_view(agent) == "True") {
    options.agent_prefix = absl::StrCat("/worker/attempt_", restarts != nullptr ? restarts : "0");
  }
  const absl::Status status = options.Validate();
  if (!status.ok()) return status;
  return options;
}

std::string DeviceOf(const std::string& told, const GroupOptions& options) {
  return told == "cuda" && options.local_rank >= 0 ? absl::StrCat(told, ":", options.local_rank) : told;
}

absl::StatusOr<std::unique_ptr<ProcessGroup>> ProcessGroup::Join(const GroupOptions& options,
                                                                 torch::DeviceType device) {
  if (const absl::Status status = options.Validate(); !status.ok()) return status;
  if (options.world == 1) return std::make_unique<SingleProcess>();
  try {
    return OpenGroup(options, device);
  } catch (const std::exception& e) {
    return absl::UnavailableError(absl::StrCat("rank ", options.rank, " of ", options.world, " could not join at ",
                                               options.address, ":", options.port, ": ", FirstLine(e)));
  }
}

}  // namespace holdfast
