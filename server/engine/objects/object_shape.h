// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "api/types.h"
#include "server/engine/motion/flow.h"
#include "server/engine/objects/object_state.h"

namespace holdfast {

// REQUIRES: 'mask', of the frame's size, has pixels that are not zero.
ObjectShape ShapeOf(const GrayImage& mask);

}  // namespace holdfast
