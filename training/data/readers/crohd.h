// SPDX-License-Identifier: Apache-2.0
// Reader of CroHD (Head Tracking 21, MOT format).
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "training/data/dataset.h"

namespace holdfast {

struct CrohdOptions {
  std::string root;            // of the data set, or any folder below that has the sequences
  int64_t clip_frames = 1000;  // sequences are cut into clips that start every half of it
  int64_t min_frames = 128;    // shorter rests are left out
  int64_t points = 0;          // tracks of a clip at most, evenly picked; 0: all
  double min_path_px = 150;    // heads that move less in a clip, by their valid positions, are left out
  ImageSize size;              // frames and labels are scaled to it when read; empty: as they are (1080 x 1920)
};

// <root>/[HT21/]train/HT21-*/{gt/gt.txt, img1/%06d.jpg}. A track is the centre of a head's box; it is valid where there
// is a row for it and 32 pixels from the border, and visible where the row says so. Tracks must be visible in the
// first two frames of their clip.
class Crohd {
 public:
  // NOT_FOUND without sequences. A sequence with damaged labels or frames is an error of Get() that names the file.
  static absl::StatusOr<std::unique_ptr<Dataset>> Create(const CrohdOptions& options);
};

}  // namespace holdfast
