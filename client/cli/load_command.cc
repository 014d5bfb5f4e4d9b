// SPDX-License-Identifier: Apache-2.0
#include "client/cli/load_command.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <deque>
#include <thread>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "api/clock.h"
#include "api/steady_event.h"
#include "client/cli/load_report.h"
#include "client/cli/point_source.h"
#include "client/cli/sending.h"
#include "client/cli/video.h"
#include "io/atomic_file.h"

namespace holdfast {
namespace {

constexpr int kMaxSessions = 1000;
constexpr absl::Duration kLongest = absl::Hours(24 * 365);
constexpr size_t kMostFrames = 240;  // kept in memory
constexpr size_t kMostBytes = size_t{256} << 20;

// Lets one client wait, and frees it when the run is stopped.
class Waiter {
 public:
  explicit Waiter(const Clock& clock) : clock_(clock) {}
  bool WaitUntil(SteadyTime until) {
    if (!stopped_) event_.WaitFor(Between(clock_.SteadyNow(), until));
    return !stopped_;
  }
  void Stop() {
    stopped_ = true;
    event_.Notify();
  }

 private:
  const Clock& clock_;
  std::atomic<bool> stopped_{false};
  SteadyEvent event_;
};

struct Film {
  ImageSize size;  // of the frames as they are sent
  std::shared_ptr<const std::vector<std::string>> frames;
};

absl::StatusOr<Film> ReadFilm(const LoadOptions& options) {
  auto source = FrameSource::Open(options.input);
  if (!source.ok()) return source.status();
  const FrameEncoder encoder((*source)->size(), options.max_side, options.jpeg_quality);
  auto frames = std::make_shared<std::vector<std::string>>();
  size_t bytes = 0;
  while (frames->size() < kMostFrames && bytes < kMostBytes) {
    const absl::StatusOr<cv::Mat> picture = (*source)->Next();
    if (!picture.ok()) return picture.status();
    if (picture->empty()) break;
    absl::StatusOr<std::string> encoded = encoder.Encode(*picture);
    if (!encoded.ok()) return encoded.status();
    bytes += encoded->size();
    frames->push_back(*std::move(encoded));
  }
  return Film{encoder.sent_size(), std::move(frames)};
}

SessionConfig ConfigOf(const LoadOptions& options, ImageSize size) {
  SessionConfig config;
  config.encoding = FrameEncoding::kJpeg;
  config.frame_size = size;
  config.processing_size = options.processing_size;
  config.hop_frames = options.hop.least;
  config.max_hop_frames = options.hop.most;
  config.emit = options.live ? Emit::kEveryFrame : Emit::kWindows;
  config.frames_per_second = options.promise_fps;
  config.label = "holdfast load";
  PointId id = 0;
  for (const cv::Point2f& point : GridPoints(options.points, size)) config.points.push_back({id++, point.x, point.y});
  return config;
}

// A thread for each.
std::vector<LoadResult> RunClients(const LoadOptions& options, const Film& film, const LoadEnvironment& environment,
                                   const Clock& clock) {
  const std::vector<LoadKind> kinds = KindsOf(options);
  std::vector<LoadResult> results(kinds.size());
  std::deque<Waiter> waiters;
  for (size_t i = 0; i < kinds.size(); ++i) waiters.emplace_back(clock);
  std::deque<LoadSession> clients;
  for (size_t i = 0; i < kinds.size(); ++i) {
    const LoadSession::Options client{kinds[i],
                                      ConfigOf(options, film.size),
                                      film.frames,
                                      options.fps,
                                      options.duration,
                                      i,
                                      options.ramp * static_cast<int64_t>(i) / static_cast<int64_t>(kinds.size())};
    const auto wait = [&waiter = waiters[i]](SteadyTime until) { return waiter.WaitUntil(until); };
    clients.emplace_back(client, environment.connect, clock, wait);
  }
  environment.stop.SetCallback([&waiters, &clients] {
    for (Waiter& waiter : waiters) waiter.Stop();
    for (LoadSession& client : clients) client.Stop();
  });
  std::vector<std::thread> threads;
  for (size_t i = 0; i < kinds.size(); ++i) {
    threads.emplace_back([&result = results[i], &client = clients[i]] { result = client.Run(); });
  }
  for (std::thread& thread : threads) thread.join();
  environment.stop.SetCallback(nullptr);
  return results;
}

absl::Status CheckShare(absl::string_view flag, double percent) {
  if (percent >= 0 && percent <= 100) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(flag, ": expected 0..100 per cent, got ", percent));
}

}  // namespace

absl::Status LoadOptions::Validate() const {
  if (sessions < 1 || sessions > kMaxSessions) {
    return absl::InvalidArgumentError(absl::StrCat("--sessions: expected 1..", kMaxSessions));
  }
  if (points < 1 || points > kMaxPointsInMessage) {
    return absl::InvalidArgumentError(absl::StrCat("--points: expected 1..", kMaxPointsInMessage));
  }
  if (!(fps >= 0) || std::isinf(fps)) return absl::InvalidArgumentError("--fps: expected 0 or more");
  if (duration <= absl::ZeroDuration() || duration > kLongest) {
    return absl::InvalidArgumentError(
        absl::StrCat("--seconds: expected more than 0 and at most ", absl::ToInt64Seconds(kLongest)));
  }
  if (ramp < absl::ZeroDuration() || ramp > duration) {
    return absl::InvalidArgumentError("--ramp: expected 0 to as many as --seconds");
  }
  const absl::Status sending = CheckSending(max_side, jpeg_quality, processing_size, promise_fps);
  if (!sending.ok()) return sending;
  if (!out.empty() && !absl::EndsWith(out, ".json")) {
    return absl::InvalidArgumentError(absl::StrCat("--out: load writes .json, got ", out));
  }
  absl::Status status = CheckShare("--slow", slow);
  status.Update(CheckShare("--cancel", cancel));
  status.Update(CheckShare("--bad", bad));
  if (status.ok() && slow + cancel + bad > 100) {
    status = absl::InvalidArgumentError("--slow, --cancel and --bad: expected at most 100 per cent in all");
  }
  return status;
}

std::vector<LoadKind> KindsOf(const LoadOptions& options) {
  std::vector<LoadKind> kinds;
  const auto add = [&](LoadKind kind, double percent) {
    const auto count = static_cast<size_t>(std::lround(options.sessions * percent / 100));
    const size_t room = static_cast<size_t>(options.sessions) - kinds.size();
    kinds.insert(kinds.end(), std::min(count, room), kind);
  };
  add(LoadKind::kSlow, options.slow);
  add(LoadKind::kCancel, options.cancel);
  add(LoadKind::kBad, options.bad);
  kinds.resize(static_cast<size_t>(options.sessions), LoadKind::kHealthy);
  return kinds;
}

absl::Status RunLoad(const LoadOptions& options, const LoadEnvironment& environment) {
  if (!options.out.empty()) {
    if (absl::Status status = CheckWritable(options.out); !status.ok()) return status;
  }
  const absl::StatusOr<Film> film = ReadFilm(options);
  if (!film.ok()) return film.status();
  const SystemClock clock;
  const SteadyTime begin = clock.SteadyNow();
  const std::vector<LoadResult> results = RunClients(options, *film, environment, clock);
  const absl::Duration took = clock.Since(begin);
  environment.out << DescribeLoad(results, took);
  if (!options.out.empty()) {
    if (absl::Status status = WriteFileAtomically(options.out, LoadAsJson(results, took)); !status.ok()) return status;
  }
  return CheckLoad(results);
}

}  // namespace holdfast
