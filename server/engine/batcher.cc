// SPDX-License-Identifier: Apache-2.0
#include "server/engine/batcher.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace holdfast {
namespace {

// The groups of a session's rows: those with the same plan stand side by side.
void AppendGroups(const RowBatch::Part& part, std::vector<WindowGroup>& groups) {
  for (size_t begin = 0; begin < part.rows.size();) {
    size_t end = begin + 1;
    while (end < part.rows.size() && part.rows[end].plan.first == part.rows[begin].plan.first &&
           part.rows[end].plan.last == part.rows[begin].plan.last) {
      ++end;
    }
    groups.push_back(part.session->tracks().Group(absl::MakeSpan(part.rows).subspan(begin, end - begin)));
    begin = end;
  }
}

}  // namespace

std::vector<int64_t> FairShares(const std::vector<int64_t>& wanted, int64_t capacity) {
  std::vector<int64_t> shares(wanted.size(), 0);
  std::vector<size_t> hungry(wanted.size());
  std::iota(hungry.begin(), hungry.end(), size_t{0});
  while (capacity > 0) {
    hungry.erase(std::remove_if(hungry.begin(), hungry.end(), [&](size_t i) { return shares[i] >= wanted[i]; }),
                 hungry.end());
    if (hungry.empty()) break;
    const int64_t each = std::max<int64_t>(capacity / static_cast<int64_t>(hungry.size()), 1);
    for (const size_t i : hungry) {
      const int64_t more = std::min({each, wanted[i] - shares[i], capacity});
      shares[i] += more;
      capacity -= more;
    }
  }
  return shares;
}

FrameBatch TakeFrameBatch(const std::vector<Session*>& in_turn, int64_t max_frames) {
  std::vector<Session*> sessions;
  std::vector<int64_t> wanted;
  for (Session* session : in_turn) {
    const int64_t ready = session->FramesReady();
    if (ready <= 0) continue;
    if (!sessions.empty() && sessions.front()->accepted().processing_size != session->accepted().processing_size) {
      continue;
    }
    sessions.push_back(session);
    wanted.push_back(ready);
  }
  FrameBatch batch;
  const std::vector<int64_t> shares = FairShares(wanted, max_frames);
  for (size_t i = 0; i < sessions.size(); ++i) {
    if (shares[i] == 0) continue;
    std::vector<DecodedFrame> frames = sessions[i]->TakeFrames(shares[i]);
    if (frames.empty()) continue;  // it was cancelled or suspended since it said how many are ready
    batch.parts.push_back({sessions[i], std::move(frames)});
  }
  return batch;
}

RowBatch MakeRowBatch(const std::vector<Session*>& in_turn, int64_t max_rows) {
  RowBatch batch;
  std::vector<int64_t> wanted;
  for (Session* session : in_turn) {
    if (!batch.parts.empty() && session->accepted().iterations != batch.iterations) continue;
    std::vector<DueRow> rows = session->DueRows();
    if (rows.empty()) continue;
    batch.iterations = session->accepted().iterations;
    wanted.push_back(static_cast<int64_t>(rows.size()));
    batch.parts.push_back({session, std::move(rows)});
  }
  const std::vector<int64_t> shares = FairShares(wanted, max_rows);
  for (size_t i = 0; i < shares.size(); ++i) {
    batch.parts[i].rows.resize(shares[i]);
    batch.rows += shares[i];
    batch.parts[i].session->AddStarts(batch.parts[i].rows);
    AppendGroups(batch.parts[i], batch.groups);
  }
  return batch;
}

}  // namespace holdfast
