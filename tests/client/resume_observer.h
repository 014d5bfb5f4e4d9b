// SPDX-License-Identifier: Apache-2.0
// For tests of sessions whose servers are lost.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "client/remote_tracker.h"
#include "proto/grpc_status.h"
#include "tests/client/scripted_service.h"
#include "tests/support/status_matchers.h"

namespace holdfast {

// What happened, in a word each, and how often each final sample of point 1 came.
class ResumeObserver final : public TrackObserver {
 public:
  void OnAccepted(const SessionAccepted&) override { events.push_back("accepted"); }
  void OnTracks(TrackUpdate update) override {
    EXPECT_GE(update.frames_received, frames_received);
    frames_received = update.frames_received;
    for (const PointRun& run : update.runs) {
      ASSERT_FALSE(run.x.empty());
      for (int64_t i = 0; i < run.final_count; ++i) ++finals[run.first_frame + i];
      EXPECT_EQ(run.x[0], run.first_frame);
    }
    if (on_tracks) on_tracks(frames_received);
  }
  void OnWarning(const absl::Status& status) override { events.push_back(std::string(status.message())); }
  void OnGoingAway(absl::Duration left) override { events.push_back(absl::StrCat("going ", FormatDuration(left))); }
  void OnReconnecting(const absl::Status& status) override {
    events.push_back("reconnecting");
    lost.push_back(status);
    if (on_reconnecting) on_reconnecting();
  }
  void OnResumed(const SessionAccepted& accepted) override {
    events.push_back(absl::StrCat("resumed ", accepted.first_frame));
    servers.push_back(accepted.server);
  }
  void OnDone(const absl::Status& status, const SessionSummary& value) override {
    events.push_back("done");
    done = status;
    summary = value;
  }

  std::function<void(int64_t)> on_tracks;
  std::function<void()> on_reconnecting;
  std::vector<std::string> events;
  std::vector<std::string> servers;  // resumed on
  std::map<int64_t, int> finals;     // by frame
  int64_t frames_received = 0;
  std::vector<absl::Status> lost;
  absl::Status done;
  SessionSummary summary;
};

inline RemoteTracker::Options At(std::vector<std::string> addresses) {
  RemoteTracker::Options options;
  options.addresses = std::move(addresses);
  options.backoff.first = absl::Milliseconds(1);
  options.backoff.longest = absl::Milliseconds(20);
  return options;
}

inline std::unique_ptr<TrackStream> Open(const RemoteTracker::Options& options, ResumeObserver& observer,
                                         const SessionConfig& config = {}) {
  auto tracker = RemoteTracker::Connect(options);
  EXPECT_THAT(tracker, IsOk());
  if (!tracker.ok()) return nullptr;
  auto stream = (*tracker)->Open(config, observer);
  EXPECT_THAT(stream, IsOk());
  return stream.ok() ? *std::move(stream) : nullptr;
}

inline absl::Status Push(TrackStream& stream, int64_t first, int64_t end, size_t bytes = 3) {
  absl::Status status;
  for (int64_t i = first; i < end && status.ok(); ++i) {
    Frame frame;
    frame.index = i;
    frame.bytes.assign(bytes, 'f');
    status = stream.PushFrame(std::move(frame));
  }
  return status;
}

// For sessions that end early, maybe while frames are pushed.
inline absl::Status PushAndFinish(TrackStream& stream, int64_t frames) {
  const absl::Status pushed = Push(stream, 0, frames);
  const absl::Status status = stream.Finish();
  EXPECT_TRUE(pushed.ok() || pushed == status) << pushed;
  return status;
}

inline void ExpectEachFrameFinalOnce(const ResumeObserver& observer, int64_t frames) {
  EXPECT_EQ(static_cast<int64_t>(observer.finals.size()), frames);
  for (const auto& [frame, times] : observer.finals) EXPECT_EQ(times, 1) << "frame " << frame;
}

// A server whose session is cut after so many frames of each call.
inline std::vector<ScriptedCall> CutAfter(const std::vector<int64_t>& frames) {
  std::vector<ScriptedCall> calls;
  for (const int64_t count : frames) {
    calls.emplace_back();
    calls.back().frames = count;
  }
  return calls;
}

inline ScriptedCall Refused(const absl::Status& status) {
  ScriptedCall call;
  call.refusal = ToGrpcStatus(status);
  return call;
}

}  // namespace holdfast
