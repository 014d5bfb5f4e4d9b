// SPDX-License-Identifier: Apache-2.0
// Limits that no operator changes: a client, a server and their tests count on the same numbers.
#pragma once

#include <cstddef>
#include <cstdint>

#include "absl/time/time.h"

namespace holdfast {

// Frames are processed at sizes whose sides are multiples of this many pixels.
constexpr int kProcessingSizeStep = 32;

// Most points of a message, whatever a server's own limit is: longer lists are refused before they are looked at.
constexpr int kMaxPointsInMessage = 1 << 16;

constexpr uint32_t kMaxObjectId = 0x7FFFFFFF;
constexpr int kMaxObjects = 64;                 // of a session
constexpr int kMaxObjectPoints = 256;           // placed on an object
constexpr int kDefaultObjectPoints = 64;        // where nobody says how many
constexpr int kMaxPolygonCorners = 1024;        // of an object's polygon
constexpr int kMaxOutlineCorners = 32;          // of an object's outline
constexpr int64_t kMaxObjectBytes = 512 << 10;  // of all masks and polygons of a message
constexpr int64_t kMaxMaskPixels = 1 << 25;     // of all masks of a message

constexpr size_t kMaxLabelBytes = 128;  // of a session's label

// An error names this many violations and counts the rest: a request of a million mistakes is answered briefly.
constexpr size_t kMaxFieldViolations = 8;
constexpr size_t kMaxViolationText = 160;  // bytes of a field's path, and of a description, that an error quotes

// Most bytes of a checkpoint's token. Servers take messages a little larger than that, whatever frames they accept, and
// RemoteTracker takes ones four times as large.
constexpr int64_t kMaxTokenBytes = int64_t{16} << 20;

// Bytes a second that the thinnest line carries on which a session can go on elsewhere: its token goes up first.
constexpr int64_t kThinLineRate = 64 << 10;
inline absl::Duration UploadTime(int64_t bytes) { return absl::Seconds(bytes / kThinLineRate); }

// Most bytes of an encoded picture that are not the picture: comments, profiles, thumbnails.
constexpr int64_t kMaxMetadataBytes = int64_t{4} << 20;

}  // namespace holdfast
