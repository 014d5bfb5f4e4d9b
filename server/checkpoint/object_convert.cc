// SPDX-License-Identifier: Apache-2.0
#include "server/checkpoint/object_convert.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "api/limits.h"

namespace holdfast {
namespace {

namespace v1 = checkpoint::v1;

constexpr int64_t kMaxObjectFrame = int64_t{1} << 60;  // far from where sums of frames would overflow
constexpr uint32_t kMaxContrary = 1 << 20;
constexpr absl::string_view kNoFault = "";

void PlaceToProto(float x, float y, v1::Position* out) {
  out->set_x(x);
  out->set_y(y);
}

bool HasFinite(const v1::Position& place) { return std::isfinite(place.x()) && std::isfinite(place.y()); }

template <typename Repeated>
bool AreFinite(const Repeated& values) {
  return std::all_of(values.begin(), values.end(), [](float value) { return std::isfinite(value); });
}

void MemberToProto(const ObjectMember& member, const ObjectJudgement::Standing& standing, int64_t object_queried,
                   v1::ObjectMember* out) {
  out->set_point_id(member.id);
  PlaceToProto(member.home.x, member.home.y, out->mutable_home());
  if (member.queried != object_queried) out->set_queried(member.queried);
  if (member.end != ObjectMember::kNever) out->set_end(member.end);
  out->set_left(standing.left);
  out->set_contrary(static_cast<uint32_t>(standing.contrary));
  out->set_final_before(member.final_before);
  for (const ObjectMember::Sample& sample : member.samples) {
    out->add_sample_x(sample.at.x);
    out->add_sample_y(sample.at.y);
    out->add_sample_visible(sample.visible);
  }
}

absl::string_view FaultOfMember(const v1::ObjectMember& member, const v1::Object& object) {
  const int count = member.sample_x_size();
  if (!HasFinite(member.home())) return "its place is not finite";
  if (member.sample_y_size() != count || member.sample_visible_size() != count) {
    return "the samples' values are not equally many";
  }
  if (!AreFinite(member.sample_x()) || !AreFinite(member.sample_y())) return "a sample's position is not finite";
  const auto is_frame = [](int64_t frame) { return frame >= 0 && frame <= kMaxObjectFrame; };
  if (!is_frame(member.final_before()) || (member.has_end() && !is_frame(member.end()))) {
    return "its last frames are out of range";
  }
  if (member.has_queried() && (member.queried() < object.query_frame() || member.queried() >= object.next())) {
    return "its first frame is out of range";
  }
  return member.contrary() > kMaxContrary ? "its contrary frames are too many" : kNoFault;
}

ObjectMember MemberFromProto(const v1::ObjectMember& member, int64_t object_queried) {
  ObjectMember out;
  out.id = member.point_id();
  out.home = {member.home().x(), member.home().y()};
  out.queried = member.has_queried() ? member.queried() : object_queried;
  if (member.has_end()) out.end = member.end();
  out.final_before = member.final_before();
  for (int i = 0; i < member.sample_x_size(); ++i) {
    out.samples.push_back({{member.sample_x(i), member.sample_y(i)}, member.sample_visible(i)});
  }
  return out;
}

ObjectShape ShapeFromProto(const v1::Object& object) {
  ObjectShape shape;
  shape.centre = {object.centre().x(), object.centre().y()};
  shape.size = object.size();
  for (int i = 0; i < object.outline_x_size(); ++i) shape.outline.push_back({object.outline_x(i), object.outline_y(i)});
  return shape;
}

}  // namespace

void ObjectToProto(const ObjectState& state, checkpoint::v1::Object* out) {
  out->set_id(state.id);
  out->set_query_frame(state.query_frame);
  const ObjectShape& shape = state.shape;
  PlaceToProto(shape.centre.x, shape.centre.y, out->mutable_centre());
  out->set_size(shape.size);
  out->set_reseeds(state.reseeds);
  for (const Pixel& corner : shape.outline) {
    out->add_outline_x(corner.x);
    out->add_outline_y(corner.y);
  }
  for (size_t i = 0; i < state.members.size(); ++i) {
    MemberToProto(state.members[i], state.judgement.standings[i], state.query_frame, out->add_members());
  }
  out->set_next(state.next);
  out->set_motion_a(state.judgement.motion.a);
  out->set_motion_b(state.judgement.motion.b);
  out->set_motion_tx(state.judgement.motion.tx);
  out->set_motion_ty(state.judgement.motion.ty);
}

absl::string_view FaultOfObject(const checkpoint::v1::Object& object) {
  if (object.id() > kMaxObjectId) return "its id is out of range";
  if (object.query_frame() < 0 || object.next() < object.query_frame() || object.next() > kMaxObjectFrame) {
    return "its frames are out of range";
  }
  if (!HasFinite(object.centre()) || !std::isfinite(object.size()) || !AreFinite(object.outline_x()) ||
      !AreFinite(object.outline_y())) {
    return "its shape is not finite";
  }
  if (object.outline_x_size() != object.outline_y_size() || object.outline_x_size() > kMaxOutlineCorners) {
    return "its shape has another number of values";
  }
  for (const double value : {object.motion_a(), object.motion_b(), object.motion_tx(), object.motion_ty()}) {
    if (!std::isfinite(value)) return "its motion is not finite";
  }
  if (object.members_size() < 1 || object.members_size() > kMaxObjectMembers) return "it has no points, or too many";
  for (const checkpoint::v1::ObjectMember& member : object.members()) {
    if (const absl::string_view fault = FaultOfMember(member, object); fault != kNoFault) return fault;
    if (!IsObjectPoint(member.point_id()) || ObjectOf(member.point_id()) != object.id()) {
      return "one of its points is none";
    }
  }
  return kNoFault;
}

ObjectState ObjectFromProto(const checkpoint::v1::Object& object) {
  ObjectState out;
  out.id = object.id();
  out.query_frame = object.query_frame();
  out.shape = ShapeFromProto(object);
  out.reseeds = object.reseeds();
  out.next = object.next();
  out.judgement.motion = {object.motion_a(), object.motion_b(), object.motion_tx(), object.motion_ty()};
  for (const checkpoint::v1::ObjectMember& member : object.members()) {
    out.members.push_back(MemberFromProto(member, out.query_frame));
    out.judgement.standings.push_back({member.left(), static_cast<int>(member.contrary())});
  }
  return out;
}

}  // namespace holdfast
