// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "model/point_model.h"

namespace holdfast {

// The network that runs while another one is optimized: itself in float32, or a copy in bfloat16 whose gradients are
// handed to the float32 master. Rounding the weights anew from the master at every step is what lets small updates add
// up. Several that are copies may run beside each other, each on one thread at a time.
class WorkingNetwork {
 public:
  // 'copy': of its own in float32 too.
  WorkingNetwork(PointModel master, torch::ScalarType dtype, bool copy = false);

  PointModelImpl& network() { return *working_; }
  // Takes over the master's weights as they are now.
  void Refresh();
  // Adds the gradients of the last backward pass to the master's, in float32.
  void CollectGradients();

 private:
  PointModel master_;
  PointModel working_;  // the master itself in float32
  bool is_copy_;
};

}  // namespace holdfast
