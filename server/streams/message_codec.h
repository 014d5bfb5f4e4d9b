// SPDX-License-Identifier: Apache-2.0
// Messages of a Track stream <-> bytes. A message's size on the wire says little about what it takes when it is parsed:
// a point of two bytes becomes an object of fifty. So requests are measured before they are parsed.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "holdfast/v1/point_tracking.pb.h"

namespace holdfast {

// Empties 'bytes'. RESOURCE_EXHAUSTED, at once: more bytes beside a frame's data, objects within their limits, or the
// token of a session that is resumed, than 'max_points' points need.
// INVALID_ARGUMENT: no message.
absl::Status ParseRequest(grpc::ByteBuffer& bytes, int max_points, v1::TrackRequest& request);
// The same for bytes that came otherwise.
absl::StatusOr<v1::TrackRequest> ParseRequest(absl::string_view bytes, int max_points);

grpc::ByteBuffer SerializeResponse(const v1::TrackResponse& response);

}  // namespace holdfast
