// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "api/errors.h"
#include "api/types.h"
#include "server/engine/motion/flow.h"
#include "server/engine/objects/object_shape.h"

namespace holdfast {

// How many points are asked for.
int PointsOf(const ObjectQuery& object);
int64_t PointsOf(const std::vector<ObjectQuery>& objects);

// What is wrong with the objects of one message, fields named as "<list>[3].mask_png". Inflates nothing. 'frame' may be
// unknown: then the sizes of masks are not held against it.
Violations CheckObjects(absl::string_view list, const std::vector<ObjectQuery>& objects,
                        std::optional<ImageSize> frame);

Violations CheckObject(absl::string_view field, const ObjectQuery& object, std::optional<ImageSize> frame);

struct PlacedObject {
  ObjectShape shape;
  std::vector<PointQuery> points;  // with the ids that they have
};

// Reads the object's mask, of the size 'frame', or fills its polygon, and places its points on it. 'gray' is the frame
// in grey, of any size. INVALID_ARGUMENT names 'field', e.g. "config.objects[0]", and says what is wrong: a broken
// mask, or one that has room for less than three points. REQUIRES: CheckObjects found nothing wrong.
absl::StatusOr<PlacedObject> PlaceObject(const ObjectQuery& object, absl::string_view field, ImageSize frame,
                                         const GrayImage& gray);

}  // namespace holdfast
