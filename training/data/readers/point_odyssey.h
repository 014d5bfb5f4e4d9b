// SPDX-License-Identifier: Apache-2.0
// Reader of PointOdyssey (v1.2 and the older layout).
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "training/data/dataset.h"

namespace holdfast {

struct PointOdysseyOptions {
  std::string root;  // has train/, val/, test/
  std::string split = "train";
  int64_t frames = 24;                          // of a clip; 0: whole sequences by the rules of evaluation, see below
  int64_t max_frames = 0;                       // of a whole sequence; 0: all of them
  std::vector<int64_t> strides = {1, 2, 3, 4};  // frames of the source between two of a clip
  int64_t start_step = 4;                       // clips begin at every so many frames of the source
  int64_t points = 0;                           // tracks kept of a clip at most, spread out; 0: all that keep the rules
  bool masks = true;                            // where the sequence has them
};

// <root>/<split>/<sequence>/{rgbs/rgb_%05d.jpg, masks/mask_%05d.png, anno.npz or annotations.npz}.
// Clips keep the training rules of track_selection.h, and holes of the masks are filled (image_files.h). Whole
// sequences (frames = 0; for the evaluator) keep its evaluation rules: tracks that are visible in the first frame and
// in 8 at least, labels valid a pixel inside the frame only, nothing dropped for how it moves; 'points' are then evenly
// picked. A sequence whose files are damaged, missing or hostile is an error of Get() that names the file.
class PointOdyssey {
 public:
  // NOT_FOUND if the split has no sequence with annotations.
  static absl::StatusOr<std::unique_ptr<Dataset>> Create(const PointOdysseyOptions& options);
};

}  // namespace holdfast
