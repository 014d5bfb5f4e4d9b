// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "absl/time/time.h"
#include "api/clock.h"
#include "model/point_model.h"
#include "training/data/rng.h"
#include "training/loss/clip_targets.h"
#include "training/loss/losses.h"
#include "training/loss/window_plan.h"
#include "training/report/training_report.h"

namespace holdfast {

struct ClipStepOptions {
  LossOptions loss;
  ClipWindowOptions window;
  int64_t iterations = 6;
};

struct ClipStepResult {
  LossValues loss;
  StepTimes times;  // encode, refine, backward
};

// Runs the network over one clip and adds the gradient of its loss to the parameters'. The clip is on the network's
// device. What is drawn (start, kind of window) is a function of 'rng' alone.
ClipStepResult AddClipGradient(PointModelImpl& network, const ClipTensors& clip, const ClipStepOptions& options,
                               Rng& rng, const Clock& clock);

}  // namespace holdfast
