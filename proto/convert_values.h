// SPDX-License-Identifier: Apache-2.0
// Values that stand in several kinds of messages; for the .cc files of this folder alone.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "api/errors.h"
#include "api/types.h"
#include "holdfast/v1/point_tracking.pb.h"

namespace holdfast::internal {

inline void SizeToProto(const ImageSize& size, v1::ImageSize* out) {
  out->set_width(size.width);
  out->set_height(size.height);
}

inline ImageSize SizeFromProto(const v1::ImageSize& size) {
  return {static_cast<int>(size.width()), static_cast<int>(size.height())};
}

inline v1::Emit EmitToProto(Emit emit) { return emit == Emit::kEveryFrame ? v1::EMIT_EVERY_FRAME : v1::EMIT_WINDOWS; }

// Empty: out of the range that google.protobuf.Timestamp has.
inline std::optional<absl::Time> TimeFromProto(const google::protobuf::Timestamp& time) {
  constexpr int64_t kMinSeconds = int64_t{-62135596800}, kMaxSeconds = int64_t{253402300799};  // years 1 and 9999
  const int64_t seconds = time.seconds();
  const int32_t nanos = time.nanos();
  if (seconds < kMinSeconds || seconds > kMaxSeconds || nanos < 0 || nanos > 999'999'999) return std::nullopt;
  return absl::FromUnixSeconds(seconds) + absl::Nanoseconds(nanos);
}

inline void TimeToProto(absl::Time time, google::protobuf::Timestamp* out) {
  const int64_t seconds = absl::ToUnixSeconds(time);  // rounds down, so that the rest is never negative
  out->set_seconds(seconds);
  out->set_nanos(static_cast<int32_t>(absl::ToInt64Nanoseconds(time - absl::FromUnixSeconds(seconds))));
}

inline absl::Duration DurationFromProto(const google::protobuf::Duration& duration) {
  return absl::Seconds(duration.seconds()) + absl::Nanoseconds(duration.nanos());
}

inline void DurationToProto(absl::Duration duration, google::protobuf::Duration* out) {
  out->set_seconds(absl::IDivDuration(duration, absl::Seconds(1), &duration));
  out->set_nanos(static_cast<int32_t>(absl::ToInt64Nanoseconds(duration)));
}

// Objects (convert_objects.cc). 'field' is the path of the list, e.g. "config.objects".
using ObjectMessages = google::protobuf::RepeatedPtrField<v1::Object>;
void ObjectsToProto(const std::vector<ObjectQuery>& objects, ObjectMessages* out);
std::vector<ObjectQuery> ObjectsFromProto(const ObjectMessages& objects, const std::string& field,
                                          Violations& violations);
void ObjectRunToProto(const ObjectRun& run, v1::ObjectRun* out);
absl::StatusOr<ObjectRun> ObjectRunFromProto(const v1::ObjectRun& run);

}  // namespace holdfast::internal
