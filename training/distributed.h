// SPDX-License-Identifier: Apache-2.0
// Data-parallel training: several processes that add up their gradients, by LibTorch's own c10d: NCCL between
// GPUs where it is built in, else Gloo, through the host's memory.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace holdfast {

struct GroupOptions {
  int64_t rank = 0;
  int64_t world = 1;                           // processes; 1: no network is touched
  std::string address;                         // host of rank 0
  int port = 0;                                // at which rank 0 listens
  absl::Duration timeout = absl::Minutes(30);  // for the others to join, and for each exchange
  int64_t local_rank = -1;                     // among the processes of this machine; negative: not told
  // Where torchrun's agent serves the job's store at the address and port, so that rank 0 does not: the start of the
  // keys of this try, as the store outlives a process that failed. Empty: rank 0 serves it.
  std::string agent_prefix;
  std::vector<std::string> interfaces;  // of the network, for Gloo; empty: that of the host's name

  absl::Status Validate() const;
};

// The variables RANK, WORLD_SIZE, MASTER_ADDR and MASTER_PORT, as torchrun and Kubernetes operators set them,
// LOCAL_RANK, TORCHELASTIC_USE_AGENT_STORE and TORCHELASTIC_RESTART_COUNT, as torchrun does, and GLOO_SOCKET_IFNAME, a
// list with commas. Without WORLD_SIZE there is a single process, and the others are not read: Kubernetes sets
// MASTER_PORT to an address where a service is called "master". 'getenv' is as std::getenv. INVALID_ARGUMENT names the
// variable.
absl::StatusOr<GroupOptions> GroupOptionsFromEnvironment(const std::function<const char*(const char*)>& getenv);

// The name of this process's device where all of a machine are told the same: "cuda" without a number is the GPU of its
// local rank.
std::string DeviceOf(const std::string& told, const GroupOptions& options);

// The processes of one job. Every process calls the same methods in the same order; one thread. A process that died
// makes them fail with UNAVAILABLE, after which the group is of no more use.
class ProcessGroup {
 public:
  // Blocks until all processes have joined or the time is up.
  static absl::StatusOr<std::unique_ptr<ProcessGroup>> Join(const GroupOptions& options, torch::DeviceType device);
  virtual ~ProcessGroup() = default;

  virtual int64_t rank() const = 0;
  virtual int64_t world() const = 0;
  // Replaces 'tensor' by the sum over all processes; the same bits everywhere.
  virtual absl::Status Sum(torch::Tensor& tensor) = 0;
  // Replaces 'tensor' by that of rank 0.
  virtual absl::Status Broadcast(torch::Tensor& tensor) = 0;
};

}  // namespace holdfast
