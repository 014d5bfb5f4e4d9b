// SPDX-License-Identifier: Apache-2.0
// Plain values <-> protocol messages. FromProto judges the form of a message, which is what a plain value could not
// hold: enumerators that do not exist, numbers that do not fit, times out of range, lists too long to look at (counted
// before anything is made of their elements), frames without data. Whether the values make sense is judged once, by the
// engine, which sees those of callers in its own process too. What a client may get wrong is INVALID_ARGUMENT with
// field violations; what only a broken server sends is INTERNAL.
#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "api/types.h"
#include "holdfast/v1/point_tracking.pb.h"

namespace holdfast {

// What the client sends. A Frame's bytes are moved, never copied.
v1::SessionConfig ToProto(const SessionConfig& config);
v1::Frame ToProto(Frame frame);
v1::AddPoints AddPointsToProto(const std::vector<PointQuery>& points);
v1::RemovePoints RemovePointsToProto(const std::vector<PointId>& ids);

absl::StatusOr<SessionConfig> FromProto(const v1::SessionConfig& config);
absl::StatusOr<Frame> FromProto(v1::Frame&& frame);
absl::StatusOr<std::vector<PointQuery>> FromProto(const v1::AddPoints& add);
absl::StatusOr<std::vector<PointId>> FromProto(const v1::RemovePoints& remove);

// What the server answers.
v1::SessionAccepted ToProto(const SessionAccepted& accepted);
v1::Tracks ToProto(const TrackUpdate& update);
v1::Checkpoint ToProto(Checkpoint checkpoint);
v1::GoingAway GoingAwayToProto(absl::Duration time_left);
v1::SessionSummary ToProto(const SessionSummary& summary);
v1::GetServerInfoResponse ToProto(const TrackerInfo& info);

absl::StatusOr<SessionAccepted> FromProto(const v1::SessionAccepted& accepted);
absl::StatusOr<TrackUpdate> FromProto(const v1::Tracks& tracks);
absl::StatusOr<Checkpoint> FromProto(v1::Checkpoint&& checkpoint);
absl::Duration FromProto(const v1::GoingAway& going_away);
SessionSummary FromProto(const v1::SessionSummary& summary);
absl::StatusOr<TrackerInfo> FromProto(const v1::GetServerInfoResponse& info);

}  // namespace holdfast
