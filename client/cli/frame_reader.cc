// SPDX-License-Identifier: Apache-2.0
#include "client/cli/frame_reader.h"

#include <deque>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "api/steady_event.h"

namespace holdfast {
namespace {

constexpr size_t kFramesAhead = 2;
constexpr absl::Duration kPatience = absl::Milliseconds(500);

bool IsLast(const absl::StatusOr<cv::Mat>& frame) { return !frame.ok() || frame->empty(); }

}  // namespace

struct FrameReader::Shared {
  bool HasRoom() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) { return stopped || frames.size() < kFramesAhead; }
  bool HasFrame() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) { return stopped || !frames.empty(); }

  std::unique_ptr<FrameSource> source;  // of the reading thread
  absl::Mutex mutex;
  std::deque<absl::StatusOr<cv::Mat>> frames ABSL_GUARDED_BY(mutex);
  bool stopped ABSL_GUARDED_BY(mutex) = false;
  SteadyEvent done;  // nothing is read any more
};

FrameReader::FrameReader(std::unique_ptr<FrameSource> source) : shared_(std::make_shared<Shared>()) {
  shared_->source = std::move(source);
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

absl::StatusOr<cv::Mat> FrameReader::Next() {
  absl::MutexLock lock(&shared_->mutex);
  shared_->mutex.Await(absl::Condition(shared_.get(), &Shared::HasFrame));
  if (shared_->stopped) return absl::CancelledError("reading was stopped");
  absl::StatusOr<cv::Mat> frame = shared_->frames.front();
  if (!IsLast(frame)) shared_->frames.pop_front();  // the end stays the end
  return frame;
}

void FrameReader::ReadToTheEnd(Shared& shared) {
  for (bool more = true; more;) {
    absl::StatusOr<cv::Mat> frame = shared.source->Next();
    more = !IsLast(frame);
    absl::MutexLock lock(&shared.mutex);
    shared.mutex.Await(absl::Condition(&shared, &Shared::HasRoom));
    more = more && !shared.stopped;
    shared.frames.push_back(std::move(frame));
  }
  shared.done.Notify();
}

}  // namespace holdfast
