// SPDX-License-Identifier: Apache-2.0
#include "program/termination.h"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <csignal>
#include <optional>
#include <utility>

namespace holdfast {
namespace {

constexpr char kOver = 0;  // no signal's number

// Of a pipe for numbers of signals. Never closed: a handler may be at work on any thread.
int reading_end = -1;
std::atomic<int> writing_end{-1};
static_assert(std::atomic<int>::is_always_lock_free, "a handler may not lock");

// On whichever thread the system chooses, so that it may do little. A pipe that is full drops what comes: there are
// thousands in it, and the second one mostly ends the process.
void PassOn(int number) {
  const int error = errno;
  const char byte = static_cast<char>(number);
  const ssize_t written = write(writing_end, &byte, 1);
  static_cast<void>(written);
  errno = error;
}

void OpenPipe() {
  int ends[2];
  if (writing_end >= 0 || pipe2(ends, O_CLOEXEC) != 0) return;
  fcntl(ends[1], F_SETFL, O_NONBLOCK);
  reading_end = ends[0];
  writing_end = ends[1];
}

// Waits for the next number, and lets the signals through only while it does: one that comes a moment before waits
// outside, and ThreadSanitizer, which puts handlers off elsewhere, runs them there.
char NextNumber(const sigset_t& blocked) {
  pollfd end = {reading_end, POLLIN, 0};
  while (ppoll(&end, 1, nullptr, &blocked) < 0 && errno == EINTR) {
  }
  char number = kOver;
  return read(reading_end, &number, 1) == 1 ? number : kOver;
}

sigset_t TheSignals() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGINT);
  sigaddset(&set, SIGTERM);
  return set;
}

void Handle(int number) {
  struct sigaction action {};
  action.sa_handler = PassOn;
  action.sa_mask = TheSignals();
  action.sa_flags = SA_RESTART;
  sigaction(number, &action, nullptr);
}

const Clock& SystemsClock() {
  static const SystemClock clock;
  return clock;
}

}  // namespace

bool StopSignal::Stop(int signal) {
  int none = 0;
  if (!signal_.compare_exchange_strong(none, signal)) return false;  // not behind a callback that is at work
  absl::MutexLock lock(&mutex_);
  Tell();
  return static_cast<bool>(on_stop_);
}

void StopSignal::Tell() {
  if (signal_ != 0 && on_stop_ && !std::exchange(told_, true)) on_stop_();
}

void StopSignal::SetCallback(std::function<void()> on_stop) {
  absl::MutexLock lock(&mutex_);
  on_stop_ = std::move(on_stop);
  told_ = false;
  Tell();
}

TerminationWatcher::TerminationWatcher(StopSignal& stop) : TerminationWatcher(stop, SystemsClock()) {}

TerminationWatcher::TerminationWatcher(StopSignal& stop, const Clock& clock) : stop_(stop), clock_(clock) {
  const sigset_t set = TheSignals();
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
  OpenPipe();
  Handle(SIGINT);
  Handle(SIGTERM);
  thread_ = std::thread([this] { Watch(); });
}

TerminationWatcher::~TerminationWatcher() {
  PassOn(kOver);
  thread_.join();
}

void TerminationWatcher::Watch() {
  sigset_t blocked;
  pthread_sigmask(SIG_BLOCK, nullptr, &blocked);
  sigdelset(&blocked, SIGINT);
  sigdelset(&blocked, SIGTERM);
  std::optional<SteadyTime> taken;
  while (const char number = NextNumber(blocked)) {
    if (taken && clock_.Since(*taken) < kSameRequest) continue;
    if (!stop_.Stop(number)) _exit(SignalExitCode(number));
    taken = clock_.SteadyNow();
  }
}

}  // namespace holdfast
