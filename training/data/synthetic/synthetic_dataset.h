// SPDX-License-Identifier: Apache-2.0
// Made-up clips with exact tracks, visibility and object ids: layered scenes of a background, in some of them deep, and
// of objects, some with limbs, that move, turn, scale and bend under a moving camera. Needs no download.
#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "training/data/dataset.h"
#include "training/data/synthetic/picture_library.h"
#include "training/data/synthetic/synthetic_options.h"

namespace holdfast {

// Thread-safe. Every pixel has a label: 1 is the background, 2 and up are objects, their limbs and the nearer
// layers of a deep scene, from back to front.
// About half of the points start on objects, all are visible in the first frame; labels are valid up to 64 pixels
// outside the frame. A picture that cannot be read is DATA_LOSS.
// Get() does not use 'rng': shuffling is pointless, and a validation set is just another seed.
class SyntheticDataset : public Dataset {
 public:
  // Fails if 'pictures' is given and holds no picture.
  static absl::StatusOr<std::unique_ptr<SyntheticDataset>> Create(const SyntheticOptions& options);

  size_t size() const override { return options_.count; }
  absl::StatusOr<Sample> Get(size_t index, Rng& rng) const override;

 private:
  SyntheticDataset(const SyntheticOptions& options, std::unique_ptr<PictureLibrary> library);

  const SyntheticOptions options_;
  const std::unique_ptr<PictureLibrary> library_;  // null: procedural only
  const cv::Mat grain_;                            // what sensor noise is cut from
};

}  // namespace holdfast
