// SPDX-License-Identifier: Apache-2.0
#include "proto/convert.h"

#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "absl/container/flat_hash_set.h"
#include "absl/strings/str_cat.h"
#include "proto/errors.h"

namespace holdfast {
namespace {

constexpr uint32_t kMaxSide = 1 << 16;  // pixels; keeps width x height x 3 far from overflow
constexpr uint32_t kMaxCount = 1 << 20;
constexpr size_t kMaxLabelBytes = 128;
constexpr size_t kMaxViolations = 8;  // a message of a million wrong points is answered briefly
constexpr int kSizeMultiple = 32;
constexpr int64_t kMaxSeconds = int64_t{253402300799};  // year 9999, the last of google.protobuf.Timestamp

using Violations = std::vector<FieldViolation>;

void Add(Violations& violations, std::string field, std::string description) {
  if (violations.size() < kMaxViolations) violations.push_back({std::move(field), std::move(description)});
}

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
      Add(violations, "config.encoding",
          absl::StrCat("is ", static_cast<int>(encoding), ", expected JPEG, PNG, RGB24, BGR24 or GRAY8"));
      return FrameEncoding::kJpeg;
  }
}

void SizeToProto(const ImageSize& size, v1::ImageSize* out) {
  out->set_width(size.width);
  out->set_height(size.height);
}

ImageSize SizeFromProto(const v1::ImageSize& size) {
  return {static_cast<int>(size.width()), static_cast<int>(size.height())};
}

// A size in which both sides are within 1 .. kMaxSide and divisible by 'multiple'; empty when it is not.
ImageSize CheckedSize(const v1::ImageSize& size, const std::string& field, int multiple, Violations& violations) {
  const auto good = [multiple](uint32_t side) { return side >= 1 && side <= kMaxSide && side % multiple == 0; };
  if (good(size.width()) && good(size.height())) return SizeFromProto(size);
  Add(violations, field,
      absl::StrCat("is ", size.width(), "x", size.height(), ", expected multiples of ", multiple, " up to ", kMaxSide));
  return {};
}

ImageSize RawSizeFromProto(const v1::SessionConfig& config, FrameEncoding encoding, Violations& violations) {
  if (IsRaw(encoding)) return CheckedSize(config.raw_size(), "config.raw_size", 1, violations);
  if (config.has_raw_size()) Add(violations, "config.raw_size", "is set, expected absent: the encoding is not raw");
  return {};
}

int CountFromProto(uint32_t count, const std::string& field, Violations& violations) {
  if (count <= kMaxCount) return static_cast<int>(count);
  Add(violations, field, absl::StrCat("is ", count, ", too large"));
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

void CheckCoordinate(float value, const std::string& field, Violations& violations) {
  if (std::isfinite(value) && value >= 0) return;
  Add(violations, field, absl::StrCat("is ", value, ", expected a position inside the frame"));
}

// 'field' is the path of the list, e.g. "config.points".
template <typename Points>
std::vector<PointQuery> PointsFromProto(const Points& points, const std::string& field, Violations& violations) {
  std::vector<PointQuery> result;
  result.reserve(points.size());
  absl::flat_hash_set<PointId> seen;
  for (const v1::Point& point : points) {
    const std::string path = absl::StrCat(field, "[", result.size(), "]");
    CheckCoordinate(point.x(), path + ".x", violations);
    CheckCoordinate(point.y(), path + ".y", violations);
    if (!seen.insert(point.id()).second) {
      Add(violations, path + ".id", absl::StrCat("is ", point.id(), " once more in the same message"));
    }
    result.push_back({point.id(), point.x(), point.y()});
  }
  return result;
}

std::optional<absl::Time> TimeFromProto(const v1::Frame& frame, Violations& violations) {
  if (!frame.has_capture_time()) return std::nullopt;
  const int64_t seconds = frame.capture_time().seconds();
  const int32_t nanos = frame.capture_time().nanos();
  if (seconds < -kMaxSeconds || seconds > kMaxSeconds || nanos < 0 || nanos > 999'999'999) {
    Add(violations, "frame.capture_time", "is out of range");
    return std::nullopt;
  }
  return absl::FromUnixSeconds(seconds) + absl::Nanoseconds(nanos);
}

void TimeToProto(absl::Time time, google::protobuf::Timestamp* out) {
  const int64_t seconds = absl::ToUnixSeconds(time);  // rounds down, so that the rest is never negative
  out->set_seconds(seconds);
  out->set_nanos(static_cast<int32_t>(absl::ToInt64Nanoseconds(time - absl::FromUnixSeconds(seconds))));
}

void LimitsToProto(const SessionLimits& limits, v1::SessionLimits* out) {
  out->set_max_points(limits.max_points);
  out->set_max_frame_bytes(limits.max_frame_bytes);
  out->set_max_frame_pixels(limits.max_frame_pixels);
  out->set_max_frames(limits.max_frames);
}

SessionLimits LimitsFromProto(const v1::SessionLimits& limits) {
  return {static_cast<int>(limits.max_points()), static_cast<int64_t>(limits.max_frame_bytes()),
          static_cast<int64_t>(limits.max_frame_pixels()), static_cast<int64_t>(limits.max_frames())};
}

void RunToProto(const PointRun& run, v1::PointRun* out) {
  out->set_id(run.id);
  out->set_first_frame(run.first_frame);
  out->mutable_x()->Add(run.x.begin(), run.x.end());
  out->mutable_y()->Add(run.y.begin(), run.y.end());
  out->mutable_visible()->Add(run.visible.begin(), run.visible.end());
  out->mutable_confidence()->Add(run.confidence.begin(), run.confidence.end());
  out->set_final_count(static_cast<uint32_t>(run.final_count));
}

absl::StatusOr<PointRun> RunFromProto(const v1::PointRun& run) {
  const int length = run.x_size();
  if (run.y_size() != length || run.visible_size() != length || run.confidence_size() != length ||
      run.final_count() > static_cast<uint32_t>(length) || run.first_frame() < 0) {
    return absl::InternalError(absl::StrCat("the server sent a malformed run of point ", run.id()));
  }
  return PointRun{run.id(),
                  run.first_frame(),
                  {run.x().begin(), run.x().end()},
                  {run.y().begin(), run.y().end()},
                  {run.visible().begin(), run.visible().end()},
                  {run.confidence().begin(), run.confidence().end()},
                  run.final_count()};
}

}  // namespace

v1::SessionConfig ToProto(const SessionConfig& config) {
  v1::SessionConfig out;
  out.set_encoding(EncodingToProto(config.encoding));
  if (!config.raw_size.empty()) SizeToProto(config.raw_size, out.mutable_raw_size());
  if (!config.processing_size.empty()) SizeToProto(config.processing_size, out.mutable_processing_size());
  out.set_hop_frames(config.hop_frames);
  out.set_iterations(config.iterations);
  out.set_final_only(!config.send_provisional);
  PointsToProto(config.points, out.mutable_points());
  out.set_label(config.label);
  return out;
}

absl::StatusOr<SessionConfig> FromProto(const v1::SessionConfig& config) {
  Violations violations;
  SessionConfig out;
  out.encoding = EncodingFromProto(config.encoding(), violations);
  out.raw_size = RawSizeFromProto(config, out.encoding, violations);
  if (config.has_processing_size()) {
    out.processing_size = CheckedSize(config.processing_size(), "config.processing_size", kSizeMultiple, violations);
  }
  out.hop_frames = CountFromProto(config.hop_frames(), "config.hop_frames", violations);
  out.iterations = CountFromProto(config.iterations(), "config.iterations", violations);
  out.send_provisional = !config.final_only();
  out.points = PointsFromProto(config.points(), "config.points", violations);
  out.label = config.label();
  if (out.label.size() > kMaxLabelBytes) {
    Add(violations, "config.label",
        absl::StrCat("has ", out.label.size(), " bytes, expected at most ", kMaxLabelBytes));
  }
  if (!violations.empty()) return InvalidFieldsError(std::move(violations));
  return out;
}

v1::Frame ToProto(Frame frame) {
  v1::Frame out;
  out.set_index(frame.index);
  *out.mutable_data() = std::move(frame.bytes);
  if (frame.capture_time) TimeToProto(*frame.capture_time, out.mutable_capture_time());
  PointsToProto(frame.points, out.mutable_points());
  return out;
}

absl::StatusOr<Frame> FromProto(v1::Frame&& frame) {
  Violations violations;
  Frame out;
  out.index = frame.index();
  out.capture_time = TimeFromProto(frame, violations);
  out.points = PointsFromProto(frame.points(), "frame.points", violations);
  if (frame.data().empty()) Add(violations, "frame.data", absl::StrCat("of frame ", frame.index(), " is empty"));
  if (!violations.empty()) return InvalidFieldsError(std::move(violations));
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
  if (!violations.empty()) return InvalidFieldsError(std::move(violations));
  return points;
}

v1::RemovePoints RemovePointsToProto(const std::vector<PointId>& ids) {
  v1::RemovePoints out;
  out.mutable_ids()->Add(ids.begin(), ids.end());
  return out;
}

std::vector<PointId> FromProto(const v1::RemovePoints& remove) { return {remove.ids().begin(), remove.ids().end()}; }

v1::SessionAccepted ToProto(const SessionAccepted& accepted) {
  v1::SessionAccepted out;
  out.set_session_id(accepted.session_id);
  SizeToProto(accepted.processing_size, out.mutable_processing_size());
  out.set_hop_frames(accepted.hop_frames);
  out.set_iterations(accepted.iterations);
  out.set_window_frames(accepted.window_frames);
  LimitsToProto(accepted.limits, out.mutable_limits());
  return out;
}

absl::StatusOr<SessionAccepted> FromProto(const v1::SessionAccepted& accepted) {
  if (accepted.window_frames() < 2 || accepted.window_frames() > kMaxCount || accepted.hop_frames() < 1 ||
      accepted.hop_frames() >= accepted.window_frames()) {
    return absl::InternalError("the server sent a malformed SessionAccepted");
  }
  SessionAccepted out;
  out.session_id = accepted.session_id();
  out.processing_size = SizeFromProto(accepted.processing_size());
  out.hop_frames = static_cast<int>(accepted.hop_frames());
  out.iterations = static_cast<int>(accepted.iterations());
  out.window_frames = static_cast<int>(accepted.window_frames());
  out.limits = LimitsFromProto(accepted.limits());
  return out;
}

v1::Tracks ToProto(const TrackUpdate& update) {
  v1::Tracks out;
  out.mutable_runs()->Reserve(static_cast<int>(update.runs.size()));
  for (const PointRun& run : update.runs) RunToProto(run, out.add_runs());
  out.set_frames_received(update.frames_received);
  out.set_frames_processed(update.frames_processed);
  return out;
}

absl::StatusOr<TrackUpdate> FromProto(const v1::Tracks& tracks) {
  TrackUpdate out;
  out.runs.reserve(tracks.runs_size());
  for (const v1::PointRun& run : tracks.runs()) {
    absl::StatusOr<PointRun> converted = RunFromProto(run);
    if (!converted.ok()) return converted.status();
    out.runs.push_back(*std::move(converted));
  }
  out.frames_received = tracks.frames_received();
  out.frames_processed = tracks.frames_processed();
  return out;
}

v1::SessionSummary ToProto(const SessionSummary& summary) {
  v1::SessionSummary out;
  out.set_frames(summary.frames);
  out.set_points(summary.points);
  out.set_final_samples(summary.final_samples);
  return out;
}

SessionSummary FromProto(const v1::SessionSummary& summary) {
  return {summary.frames(), summary.points(), summary.final_samples()};
}

v1::GetServerInfoResponse ToProto(const TrackerInfo& info) {
  v1::GetServerInfoResponse out;
  out.set_model_name(info.model_name);
  out.set_preset(info.preset);
  out.set_weights_sha256(info.weights_sha256);
  out.set_precision(info.precision);
  out.set_device(info.device);
  out.set_build(info.build);
  SizeToProto(info.default_processing_size, out.mutable_default_processing_size());
  out.set_window_frames(info.window_frames);
  out.set_default_hop_frames(info.default_hop_frames);
  out.set_default_iterations(info.default_iterations);
  out.set_max_sessions(info.max_sessions);
  LimitsToProto(info.limits, out.mutable_limits());
  return out;
}

absl::StatusOr<TrackerInfo> FromProto(const v1::GetServerInfoResponse& info) {
  TrackerInfo out;
  out.model_name = info.model_name();
  out.preset = info.preset();
  out.weights_sha256 = info.weights_sha256();
  out.precision = info.precision();
  out.device = info.device();
  out.build = info.build();
  out.default_processing_size = SizeFromProto(info.default_processing_size());
  out.window_frames = static_cast<int>(info.window_frames());
  out.default_hop_frames = static_cast<int>(info.default_hop_frames());
  out.default_iterations = static_cast<int>(info.default_iterations());
  out.max_sessions = static_cast<int>(info.max_sessions());
  out.limits = LimitsFromProto(info.limits());
  if (out.window_frames < 2) return absl::InternalError("the server sent a malformed GetServerInfoResponse");
  return out;
}

}  // namespace holdfast
