// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "model/point_model.h"

namespace holdfast {

// The network that runs while another one is optimized: itself in float32, or a copy in bfloat16 whose gradients are
// handed to the float32 master. Rounding the weights anew from the master at every step is what lets small updates add
// up. Not thread-safe.
class WorkingNetwork {
 public:
  WorkingNetwork(PointModel master, torch::ScalarType dtype);

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
