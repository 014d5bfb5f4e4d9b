// SPDX-License-Identifier: Apache-2.0
// A tracking server with checkpoints whose calls go as a test has written them down, one after the other.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "tests/client/fake_service.h"

namespace holdfast {

inline v1::TrackResponse CheckpointAt(int64_t next_frame, bool resumable = true, size_t bytes = 0) {
  v1::TrackResponse response;
  const std::string token = absl::StrCat(next_frame);
  response.mutable_checkpoint()->set_token(std::string(bytes - std::min(bytes, token.size()), '0') + token);
  response.mutable_checkpoint()->set_next_frame(next_frame);
  response.mutable_checkpoint()->set_resumable(resumable);
  return response;
}

// How one call goes. Every frame is answered with a final sample of point 1 whose x is the frame's index.
struct ScriptedCall {
  grpc::Status refusal;         // instead of an acceptance
  int64_t frames = 1 << 30;     // read of this call; then it ends with 'end', or at the half-close if that comes first
  bool ends_at_finish = false;  // with 'end' at the half-close, instead of the summary
  grpc::Status end = grpc::Status(grpc::StatusCode::UNAVAILABLE, "cut");
  grpc::Status after_summary;
  bool last_checkpoint = false;           // before the end, as a drain does it
  bool resumable = true;                  // elsewhere
  bool outgrown = false;                  // all checkpoints are empty
  std::function<void(int64_t)> on_frame;  // before it is answered
};

// Checkpoints are taken every 'interval' frames and lie 'lag' frames behind; their token is the text of next_frame.
class ScriptedService {
 public:
  struct Options {
    int interval = 4;
    int replay_frames = 8;
    int lag = 2;
    size_t token_bytes = 0;  // at least
  };
  // Calls that come after the scripted ones go well.
  ScriptedService(const Options& options, std::vector<ScriptedCall> calls)
      : options_(options),
        calls_(std::move(calls)),
        service_([this](grpc::ServerContext&, FakeService::Stream& stream) { return Serve(stream); }) {}
  explicit ScriptedService(std::vector<ScriptedCall> calls) : ScriptedService(Options(), std::move(calls)) {}

  FakeService& service() { return service_; }
  std::string address() const { return service_.address(); }

  // What each call was sent: "config", "config <token>", "frame 3", "add 7", "remove 7", "end".
  std::vector<std::vector<std::string>> seen() const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return seen_;
  }
  std::vector<v1::SessionConfig> configs() const ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    return configs_;
  }

 private:
  grpc::Status Serve(FakeService::Stream& stream) ABSL_LOCKS_EXCLUDED(mutex_) {
    v1::TrackRequest request;
    if (!stream.Read(&request)) return grpc::Status::CANCELLED;
    const size_t index = Begin(request.config());
    const ScriptedCall call = index < calls_.size() ? calls_[index] : ScriptedCall();
    if (!call.refusal.ok()) return call.refusal;
    int64_t first = 0;
    const std::string& token = request.config().resume_token();
    EXPECT_TRUE(token.empty() || absl::SimpleAtoi(token, &first));
    stream.Write(Accept(first));
    int64_t newest = first - 1, frames = 0;
    while (frames < call.frames && stream.Read(&request)) {
      Note(index, request);
      if (!request.has_frame()) continue;
      ++frames;
      newest = request.frame().index();
      if (newest < first) continue;
      if (call.on_frame) call.on_frame(newest);
      Answer(stream, call, newest);
    }
    if (frames < call.frames) Append(index, "end");
    if (call.last_checkpoint) stream.Write(CheckpointAt(std::max<int64_t>(0, newest + 1 - options_.lag)));
    if (frames >= call.frames || call.ends_at_finish) return call.end;
    stream.Write(Summary(newest + 1));
    return call.after_summary;
  }

  v1::TrackResponse Accept(int64_t first_frame) const {
    v1::TrackResponse response = Accepted();
    response.mutable_accepted()->set_first_frame(first_frame);
    response.mutable_accepted()->set_checkpoint_interval_frames(options_.interval);
    response.mutable_accepted()->set_replay_frames(options_.replay_frames);
    response.mutable_accepted()->set_hop_frames(2);
    return response;
  }

  void Answer(FakeService::Stream& stream, const ScriptedCall& call, int64_t frame) const {
    stream.Write(Sample(1, frame, static_cast<float>(frame), 0));
    if (options_.replay_frames == 0 || (frame + 1) % options_.interval != 0) return;
    v1::TrackResponse checkpoint =
        CheckpointAt(std::max<int64_t>(0, frame + 1 - options_.lag), call.resumable, options_.token_bytes);
    if (call.outgrown) checkpoint.mutable_checkpoint()->clear_token();
    stream.Write(checkpoint);
  }

  size_t Begin(const v1::SessionConfig& config) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    configs_.push_back(config);
    const std::string& token = config.resume_token();
    seen_.push_back({token.empty() ? "config" : absl::StrCat("config ", token)});
    return seen_.size() - 1;
  }

  void Note(size_t call, const v1::TrackRequest& request) {
    if (request.has_frame()) Append(call, absl::StrCat("frame ", request.frame().index()));
    if (request.has_add_points()) Append(call, absl::StrCat("add ", request.add_points().points(0).id()));
    if (request.has_remove_points()) Append(call, absl::StrCat("remove ", request.remove_points().ids(0)));
  }

  void Append(size_t call, std::string text) ABSL_LOCKS_EXCLUDED(mutex_) {
    absl::MutexLock lock(&mutex_);
    seen_[call].push_back(std::move(text));
  }

  const Options options_;
  const std::vector<ScriptedCall> calls_;
  mutable absl::Mutex mutex_;
  std::vector<std::vector<std::string>> seen_ ABSL_GUARDED_BY(mutex_);
  std::vector<v1::SessionConfig> configs_ ABSL_GUARDED_BY(mutex_);
  FakeService service_;  // last: its calls use all of the above
};

}  // namespace holdfast
