// SPDX-License-Identifier: Apache-2.0
// How a batch is shared and put together. No threads.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "server/engine/session.h"
#include "server/engine/tracker_model.h"
#include "server/engine/tracks/track_set.h"

namespace holdfast {

// Divides 'capacity' among who wants how much: everybody gets an equal share or what they want, whichever is less, and
// what is left goes round again. Odd units go to the first ones.
std::vector<int64_t> FairShares(const std::vector<int64_t>& wanted, int64_t capacity);

// Frames of sessions of one processing size.
struct FrameBatch {
  struct Part {
    Session* session = nullptr;
    std::vector<DecodedFrame> frames;
  };
  std::vector<Part> parts;
};
// The first session that has frames decides the size; at most 'max_frames'. Takes them from the sessions.
FrameBatch TakeFrameBatch(const std::vector<Session*>& in_turn, int64_t max_frames);

// Rows of sessions with equal iterations, grouped by the frames they share.
struct RowBatch {
  struct Part {
    Session* session = nullptr;
    std::vector<DueRow> rows;
  };
  std::vector<Part> parts;
  std::vector<WindowGroup> groups;  // of all parts in order; borrow from the tracks
  int iterations = 0;
  int64_t rows = 0;
};
// The first session that has rows decides the iterations; at most 'max_rows'.
RowBatch MakeRowBatch(const std::vector<Session*>& in_turn, int64_t max_rows);

}  // namespace holdfast
