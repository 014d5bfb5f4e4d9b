// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "training/data/loader.h"
#include "training/recipe.h"

namespace holdfast {

// Where a training's clips come from.
class ClipSource {
 public:
  virtual ~ClipSource() = default;
  // Batches of this process with clips as 'phase' wants them, from draw 'first_draw' on. The loader borrows from the
  // source: at most one is alive, and it dies first.
  virtual absl::StatusOr<std::unique_ptr<Loader>> Open(const Phase& phase, int64_t first_draw) = 0;
};

}  // namespace holdfast
