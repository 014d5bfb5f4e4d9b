// SPDX-License-Identifier: Apache-2.0
// Objects, asked for and answered.
#include <cstdint>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/limits.h"
#include "proto/convert_values.h"

namespace holdfast::internal {
namespace {

constexpr int64_t kMaxObjectFrame = int64_t{1} << 60;  // far from where the end of a run would overflow

// Whether the list can be looked at: within what any session may have.
bool CanBeRead(const ObjectMessages& objects, const std::string& field, Violations& violations) {
  if (objects.size() > kMaxObjects) {
    violations.Add(field, absl::StrCat("has ", objects.size(), " elements, expected at most ", kMaxObjects));
    return false;
  }
  int64_t bytes = 0;
  for (const v1::Object& object : objects) {
    bytes += static_cast<int64_t>(object.mask_png().size()) + int64_t{4} * object.polygon().x_size() +
             int64_t{4} * object.polygon().y_size();
  }
  if (bytes <= kMaxObjectBytes) return true;
  violations.Add(field, absl::StrCat("has ", bytes, " bytes, expected at most ", kMaxObjectBytes));
  return false;
}

void PolygonFromProto(const v1::Polygon& polygon, const std::string& field, ObjectQuery& out, Violations& violations) {
  if (polygon.x_size() != polygon.y_size()) {
    violations.Add(absl::StrCat(field, ".y"),
                   absl::StrCat("has ", polygon.y_size(), " elements, expected as many as x: ", polygon.x_size()));
    return;
  }
  for (int i = 0; i < polygon.x_size(); ++i) out.polygon.push_back({polygon.x(i), polygon.y(i)});
}

ObjectQuery ObjectFromProto(const v1::Object& object, const std::string& field, Violations& violations) {
  ObjectQuery out;
  if (object.id() > kMaxObjectId) {
    violations.Add(absl::StrCat(field, ".id"), absl::StrCat(object.id(), " is not in 0 .. ", kMaxObjectId));
  }
  if (object.points() > static_cast<uint32_t>(kMaxObjectPoints)) {
    violations.Add(absl::StrCat(field, ".points"),
                   absl::StrCat("is ", object.points(), ", expected 0 .. ", kMaxObjectPoints));
  } else {
    out.points = static_cast<int>(object.points());
  }
  out.id = object.id();
  if (object.has_polygon()) PolygonFromProto(object.polygon(), absl::StrCat(field, ".polygon"), out, violations);
  out.mask_png = object.mask_png();
  out.reseed = !object.has_reseed() || object.reseed();
  return out;
}

}  // namespace

void ObjectsToProto(const std::vector<ObjectQuery>& objects, ObjectMessages* out) {
  for (const ObjectQuery& object : objects) {
    v1::Object* added = out->Add();
    added->set_id(object.id);
    added->set_points(static_cast<uint32_t>(object.points));
    if (!object.reseed) added->set_reseed(false);
    if (!object.mask_png.empty()) added->set_mask_png(object.mask_png);
    for (const Pixel& corner : object.polygon) {
      added->mutable_polygon()->add_x(corner.x);
      added->mutable_polygon()->add_y(corner.y);
    }
  }
}

std::vector<ObjectQuery> ObjectsFromProto(const ObjectMessages& objects, const std::string& field,
                                          Violations& violations) {
  std::vector<ObjectQuery> out;
  if (!CanBeRead(objects, field, violations)) return out;
  for (const v1::Object& object : objects) {
    out.push_back(ObjectFromProto(object, absl::StrCat(field, "[", out.size(), "]"), violations));
  }
  return out;
}

void ObjectRunToProto(const ObjectRun& run, v1::ObjectRun* out) {
  out->set_id(run.id);
  out->set_first_frame(run.first_frame);
  for (const ObjectSample& sample : run.samples) {
    v1::ObjectSample* added = out->add_samples();
    added->set_x(sample.centre.x);
    added->set_y(sample.centre.y);
    added->set_scale(sample.scale);
    added->set_rotation(sample.rotation);
    added->set_visible(sample.visible);
    for (const Pixel& corner : sample.outline) {
      added->add_outline_x(corner.x);
      added->add_outline_y(corner.y);
    }
    added->mutable_left()->Add(sample.left.begin(), sample.left.end());
    added->mutable_joined()->Add(sample.joined.begin(), sample.joined.end());
  }
  out->set_final_count(static_cast<uint32_t>(run.final_count));
}

absl::StatusOr<ObjectRun> ObjectRunFromProto(const v1::ObjectRun& run) {
  bool good = run.samples_size() > 0 && run.final_count() <= static_cast<uint32_t>(run.samples_size()) &&
              run.first_frame() >= 0 && run.first_frame() <= kMaxObjectFrame;
  ObjectRun out{run.id(), run.first_frame(), {}, run.final_count()};
  for (const v1::ObjectSample& sample : run.samples()) {
    good &= sample.outline_x_size() == sample.outline_y_size();
    if (!good) return absl::InternalError(absl::StrCat("the server sent a malformed run of object ", run.id()));
    ObjectSample& added = out.samples.emplace_back();
    added.centre = {sample.x(), sample.y()};
    added.scale = sample.scale();
    added.rotation = sample.rotation();
    added.visible = sample.visible();
    for (int i = 0; i < sample.outline_x_size(); ++i) {
      added.outline.push_back({sample.outline_x(i), sample.outline_y(i)});
    }
    added.left.assign(sample.left().begin(), sample.left().end());
    added.joined.assign(sample.joined().begin(), sample.joined().end());
  }
  if (!good) return absl::InternalError(absl::StrCat("the server sent a malformed run of object ", run.id()));
  return out;
}

}  // namespace holdfast::internal
