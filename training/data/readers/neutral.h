// SPDX-License-Identifier: Apache-2.0
// The neutral folder format: clips of one's own, converted data sets (training/tools/convert_tapvid.py) and what
// holdfast-synth writes.
//
//   <clip>/frames/%05d.jpg (or .png), from 0
//   <clip>/masks/%05d.png, 8 or 16 bits: object ids, 0 unlabelled; optional, then one for each frame
//   <clip>/tracks.json {width, height, fps, points: [{name, object, frames: [], xy: [[x, y]], visible: []}]}
//
// 'frames' are the indices of the frames where the point is annotated (valid), increasing, with one entry of 'xy'
// (pixels) and 'visible' (true / false or 1 / 0) each; 'xy' is null where the point is hidden and nobody knows where,
// of which only who judges visibility takes notice. 'object' (the point's id in the masks) and 'fps' are optional.
//
// A clip of which a picture is missing is DATA_LOSS that names the file: one before others, and, where the whole clip
// is read, one that has labels.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "training/data/dataset.h"

namespace holdfast {

struct NeutralOptions {
  std::string root;        // one clip, or a folder of clips
  int64_t frames = 0;      // 0: whole clips; else each Get() takes a stretch of so many, the place drawn from 'rng'
  int64_t max_frames = 0;  // of a whole clip; 0: all of them
  int64_t points = 0;      // tracks of a clip at most, evenly picked; 0: all
};

class Neutral {
 public:
  // NOT_FOUND without clips.
  static absl::StatusOr<std::unique_ptr<Dataset>> Create(const NeutralOptions& options);
};

// Writes a clip as <directory>/{frames, masks, tracks.json}; directories are made, and a
// clip that was there is replaced, its further pictures too.
absl::Status WriteNeutral(const Sample& sample, const std::string& directory);

}  // namespace holdfast
