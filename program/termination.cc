// SPDX-License-Identifier: Apache-2.0
#include "program/termination.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <csignal>
#include <utility>

namespace holdfast {

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

TerminationWatcher::TerminationWatcher(StopSignal& stop) : stop_(stop) {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGINT);
  sigaddset(&set, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
  signals_ = signalfd(-1, &set, SFD_CLOEXEC);
  over_ = eventfd(0, EFD_CLOEXEC);
  thread_ = std::thread([this] { Watch(); });
}

TerminationWatcher::~TerminationWatcher() {
  const uint64_t one = 1;
  const ssize_t written = write(over_, &one, sizeof(one));
  static_cast<void>(written);  // an eventfd takes one write
  thread_.join();
  close(signals_);
  close(over_);
}

void TerminationWatcher::Watch() {
  pollfd events[] = {{signals_, POLLIN, 0}, {over_, POLLIN, 0}};
  while (poll(events, 2, -1) >= 0 && (events[1].revents & POLLIN) == 0) {
    signalfd_siginfo info;
    if (read(signals_, &info, sizeof(info)) != sizeof(info)) continue;
    const int signal = static_cast<int>(info.ssi_signo);
    if (!stop_.Stop(signal)) _exit(SignalExitCode(signal));
  }
}

}  // namespace holdfast
