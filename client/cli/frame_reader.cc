// SPDX-License-Identifier: Apache-2.0
#include "client/cli/frame_reader.h"

#include <algorithm>
#include <deque>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "api/clock.h"
#include "api/steady_event.h"

namespace holdfast {
namespace {

constexpr size_t kFramesAhead = 2;
constexpr absl::Duration kPatience = absl::Milliseconds(500);

bool IsLast(const absl::StatusOr<InputFrame>& frame) { return !frame.ok() || frame->picture.empty(); }

}  // namespace

struct FrameReader::Shared {
  Shared(std::unique_ptr<FrameSource> frames_of, Options with)
      : source(std::move(frames_of)), options(std::move(with)) {}

  bool HasRoom() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) { return stopped || frames.size() < kFramesAhead; }
  bool HasFrame() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) { return stopped || !frames.empty(); }
  void MakeRoom() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
  absl::StatusOr<InputFrame> Read();

  const std::unique_ptr<FrameSource> source;  // of the reading thread
  const Options options;
  int64_t next = options.choice.first();  // of the reading thread; a frame's number
  mutable absl::Mutex mutex;
  std::deque<absl::StatusOr<InputFrame>> frames ABSL_GUARDED_BY(mutex);
  int64_t dropped ABSL_GUARDED_BY(mutex) = 0;
  bool stopped ABSL_GUARDED_BY(mutex) = false;
  SteadyEvent done;  // nothing is read any more
};

// Of the frames that were read only the last can be the end, and that has come when there is no more to make room for.
void FrameReader::Shared::MakeRoom() {
  if (!options.drop || HasRoom()) return;
  const auto oldest = std::find_if(frames.begin(), frames.end(),
                                   [this](const auto& f) { return !options.choice.IsQueried(f->number); });
  if (oldest == frames.end()) return;
  frames.erase(oldest);
  ++dropped;
}

absl::StatusOr<InputFrame> FrameReader::Shared::Read() {
  for (; !options.choice.Wants(next); ++next) {
    const absl::StatusOr<bool> passed = source->Skip();
    if (!passed.ok()) return passed.status();
    if (!*passed) return InputFrame{next, {}, {}, source->doubt()};
  }
  absl::StatusOr<cv::Mat> picture = source->Next();
  if (!picture.ok()) return picture.status();
  InputFrame frame{next++, *std::move(picture), {}, source->doubt()};
  if (source->live()) frame.capture_time = SystemClock().WallNow();
  return frame;
}

FrameReader::FrameReader(std::unique_ptr<FrameSource> source, Options options)
    : shared_(std::make_shared<Shared>(std::move(source), std::move(options))) {
  thread_ = std::thread([shared = shared_] { ReadToTheEnd(*shared); });
}

FrameReader::~FrameReader() {
  Stop();
  if (shared_->done.WaitFor(kPatience)) {
    thread_.join();
  } else {
    thread_.detach();
  }
}

void FrameReader::Stop() {
  absl::MutexLock lock(&shared_->mutex);
  shared_->stopped = true;
}

int64_t FrameReader::dropped() const {
  absl::MutexLock lock(&shared_->mutex);
  return shared_->dropped;
}

absl::StatusOr<InputFrame> FrameReader::Next() {
  absl::MutexLock lock(&shared_->mutex);
  shared_->mutex.Await(absl::Condition(shared_.get(), &Shared::HasFrame));
  if (shared_->stopped) return absl::CancelledError("reading was stopped");
  absl::StatusOr<InputFrame> frame = shared_->frames.front();
  if (!IsLast(frame)) shared_->frames.pop_front();  // the end stays the end
  return frame;
}

void FrameReader::ReadToTheEnd(Shared& shared) {
  for (bool more = true; more;) {
    absl::StatusOr<InputFrame> frame = shared.Read();
    more = !IsLast(frame);
    absl::MutexLock lock(&shared.mutex);
    if (more) shared.MakeRoom();
    shared.mutex.Await(absl::Condition(&shared, &Shared::HasRoom));
    more = more && !shared.stopped;
    shared.frames.push_back(std::move(frame));
  }
  shared.done.Notify();
}

}  // namespace holdfast
