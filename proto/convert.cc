// SPDX-License-Identifier: Apache-2.0
#include "proto/convert.h"

#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "api/errors.h"
#include "proto/convert_values.h"

namespace holdfast {
namespace {

using internal::EmitToProto;
using internal::SizeFromProto;
using internal::SizeToProto;

constexpr uint32_t kMaxSide = 1 << 16;  // pixels; keeps width x height x 3 far from overflow
constexpr uint32_t kMaxCount = 1 << 20;

v1::FrameEncoding EncodingToProto(FrameEncoding encoding) {
  switch (encoding) {
    case FrameEncoding::kJpeg:
      return v1::FRAME_ENCODING_JPEG;
    case FrameEncoding::kPng:
      return v1::FRAME_ENCODING_PNG;
    case FrameEncoding::kRgb24:
      return v1::FRAME_ENCODING_RGB24;
    case FrameEncoding::kBgr24:
      return v1::FRAME_ENCODING_BGR24;
    case FrameEncoding::kGray8:
      return v1::FRAME_ENCODING_GRAY8;
  }
  return v1::FRAME_ENCODING_UNSPECIFIED;
}

FrameEncoding EncodingFromProto(v1::FrameEncoding encoding, Violations& violations) {
  switch (encoding) {
    case v1::FRAME_ENCODING_JPEG:
      return FrameEncoding::kJpeg;
    case v1::FRAME_ENCODING_PNG:
      return FrameEncoding::kPng;
    case v1::FRAME_ENCODING_RGB24:
      return FrameEncoding::kRgb24;
    case v1::FRAME_ENCODING_BGR24:
      return FrameEncoding::kBgr24;
    case v1::FRAME_ENCODING_GRAY8:
      return FrameEncoding::kGray8;
    default:
      violations.Add("config.encoding",
                     absl::StrCat("is ", static_cast<int>(encoding), ", expected JPEG, PNG, RGB24, BGR24 or GRAY8"));
      return FrameEncoding::kJpeg;
  }
}

// A size of which both sides are within 1 .. kMaxSide; empty when it is not.
ImageSize CheckedSize(const v1::ImageSize& size, const std::string& field, Violations& violations) {
  const auto good = [](uint32_t side) { return side >= 1 && side <= kMaxSide; };
  if (good(size.width()) && good(size.height())) return SizeFromProto(size);
  violations.Add(
      field, absl::StrCat("is ", size.width(), "x", size.height(), ", expected sides of 1 to ", kMaxSide, " pixels"));
  return {};
}

Emit EmitFromProto(const v1::SessionConfig& config, Violations& violations) {
  if (config.emit() != v1::EMIT_WINDOWS && config.emit() != v1::EMIT_EVERY_FRAME) {
    violations.Add("config.emit",
                   absl::StrCat("is ", static_cast<int>(config.emit()), ", expected WINDOWS or EVERY_FRAME"));
  }
  return config.emit() == v1::EMIT_EVERY_FRAME ? Emit::kEveryFrame : Emit::kWindows;
}

int CountFromProto(uint32_t count, const std::string& field, Violations& violations) {
  if (count <= kMaxCount) return static_cast<int>(count);
  violations.Add(field, absl::StrCat("is ", count, ", too large"));
  return 0;
}

template <typename Points>
void PointsToProto(const std::vector<PointQuery>& points, Points* out) {
  out->Reserve(static_cast<int>(points.size()));
  for (const PointQuery& point : points) {
    v1::Point* added = out->Add();
    added->set_id(point.id);
    added->set_x(point.x);
    added->set_y(point.y);
  }
}

// 'field' is the path of the list, e.g. "config.points".
bool CountIsGood(int count, const std::string& field, Violations& violations) {
  if (count <= kMaxPointsInMessage) return true;
  violations.Add(field, absl::StrCat("has ", count, " elements, expected at most ", kMaxPointsInMessage));
  return false;
}

template <typename Points>
std::vector<PointQuery> PointsFromProto(const Points& points, const std::string& field, Violations& violations) {
  std::vector<PointQuery> result;
  if (!CountIsGood(points.size(), field, violations)) return result;
  result.reserve(points.size());
  for (const v1::Point& point : points) result.push_back({point.id(), point.x(), point.y()});
  return result;
}

std::optional<absl::Time> TimeFromProto(const v1::Frame& frame, Violations& violations) {
  if (!frame.has_capture_time()) return std::nullopt;
  std::optional<absl::Time> time = internal::TimeFromProto(frame.capture_time());
  if (!time) violations.Add("frame.capture_time", "is out of range");
  return time;
}

}  // namespace

v1::SessionConfig ToProto(const SessionConfig& config) {
  v1::SessionConfig out;
  out.set_encoding(EncodingToProto(config.encoding));
  if (!config.raw_size.empty()) SizeToProto(config.raw_size, out.mutable_raw_size());
  if (!config.frame_size.empty()) SizeToProto(config.frame_size, out.mutable_frame_size());
  if (!config.processing_size.empty()) SizeToProto(config.processing_size, out.mutable_processing_size());
  out.set_hop_frames(config.hop_frames);
  out.set_iterations(config.iterations);
  out.set_final_only(!config.send_provisional);
  PointsToProto(config.points, out.mutable_points());
  out.set_label(config.label);
  out.set_emit(EmitToProto(config.emit));
  if (config.motion_prior) out.set_motion_prior(*config.motion_prior);
  if (config.polish) out.set_polish(*config.polish);
  out.set_checkpoint_interval_frames(config.checkpoint_interval_frames);
  out.set_resume_token(config.resume_token);
  out.set_frames_per_second(static_cast<float>(config.frames_per_second));
  out.set_expected_points(config.expected_points);
  out.set_max_hop_frames(config.max_hop_frames);
  internal::ObjectsToProto(config.objects, out.mutable_objects());
  return out;
}

absl::StatusOr<SessionConfig> FromProto(const v1::SessionConfig& config) {
  Violations violations;
  SessionConfig out;
  out.encoding = EncodingFromProto(config.encoding(), violations);
  if (config.has_raw_size()) out.raw_size = CheckedSize(config.raw_size(), "config.raw_size", violations);
  if (config.has_frame_size()) out.frame_size = CheckedSize(config.frame_size(), "config.frame_size", violations);
  if (config.has_processing_size()) {
    out.processing_size = CheckedSize(config.processing_size(), "config.processing_size", violations);
  }
  out.hop_frames = CountFromProto(config.hop_frames(), "config.hop_frames", violations);
  out.iterations = CountFromProto(config.iterations(), "config.iterations", violations);
  out.send_provisional = !config.final_only();
  out.points = PointsFromProto(config.points(), "config.points", violations);
  out.emit = EmitFromProto(config, violations);
  if (config.has_motion_prior()) out.motion_prior = config.motion_prior();
  if (config.has_polish()) out.polish = config.polish();
  out.label = config.label();
  out.checkpoint_interval_frames =
      CountFromProto(config.checkpoint_interval_frames(), "config.checkpoint_interval_frames", violations);
  out.resume_token = config.resume_token();
  out.frames_per_second = config.frames_per_second();
  out.expected_points = CountFromProto(config.expected_points(), "config.expected_points", violations);
  out.max_hop_frames = CountFromProto(config.max_hop_frames(), "config.max_hop_frames", violations);
  out.objects = internal::ObjectsFromProto(config.objects(), "config.objects", violations);
  if (!violations.empty()) return violations.ToStatus();
  return out;
}

v1::Frame ToProto(Frame frame) {
  v1::Frame out;
  out.set_index(frame.index);
  *out.mutable_data() = std::move(frame.bytes);
  if (frame.capture_time) internal::TimeToProto(*frame.capture_time, out.mutable_capture_time());
  PointsToProto(frame.points, out.mutable_points());
  internal::ObjectsToProto(frame.objects, out.mutable_objects());
  return out;
}

absl::StatusOr<Frame> FromProto(v1::Frame&& frame) {
  Violations violations;
  Frame out;
  out.index = frame.index();
  out.capture_time = TimeFromProto(frame, violations);
  out.points = PointsFromProto(frame.points(), "frame.points", violations);
  out.objects = internal::ObjectsFromProto(frame.objects(), "frame.objects", violations);
  if (frame.data().empty()) violations.Add("frame.data", absl::StrCat("of frame ", frame.index(), " is empty"));
  if (!violations.empty()) return violations.ToStatus();
  out.bytes = std::move(*frame.mutable_data());
  return out;
}

v1::AddPoints AddPointsToProto(const std::vector<PointQuery>& points) {
  v1::AddPoints out;
  PointsToProto(points, out.mutable_points());
  return out;
}

absl::StatusOr<std::vector<PointQuery>> FromProto(const v1::AddPoints& add) {
  Violations violations;
  std::vector<PointQuery> points = PointsFromProto(add.points(), "add_points.points", violations);
  if (!violations.empty()) return violations.ToStatus();
  return points;
}

v1::RemovePoints RemovePointsToProto(const std::vector<PointId>& ids) {
  v1::RemovePoints out;
  out.mutable_ids()->Add(ids.begin(), ids.end());
  return out;
}

absl::StatusOr<std::vector<PointId>> FromProto(const v1::RemovePoints& remove) {
  Violations violations;
  if (!CountIsGood(remove.ids_size(), "remove_points.ids", violations)) return violations.ToStatus();
  return std::vector<PointId>(remove.ids().begin(), remove.ids().end());
}

}  // namespace holdfast
