// SPDX-License-Identifier: Apache-2.0
#include "server/signals.h"

#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <unistd.h>

namespace holdfast {
namespace {

sigset_t Termination() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  return signals;
}

}  // namespace

TerminationSignals::TerminationSignals() : stop_fd_(eventfd(0, EFD_CLOEXEC)) {
  const sigset_t signals = Termination();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  thread_ = std::thread([this] { Watch(); });
}

TerminationSignals::~TerminationSignals() {
  eventfd_write(stop_fd_, 1);
  thread_.join();
  close(stop_fd_);
}

void TerminationSignals::Watch() {
  const sigset_t signals = Termination();
  const int signal_fd = signalfd(-1, &signals, SFD_CLOEXEC);
  pollfd waiting[] = {{stop_fd_, POLLIN, 0}, {signal_fd, POLLIN, 0}};
  while (true) {
    if (poll(waiting, 2, -1) < 0) continue;
    if (waiting[0].revents != 0) break;
    signalfd_siginfo info;
    if (read(signal_fd, &info, sizeof(info)) != sizeof(info)) continue;
    if (first_.HasBeenNotified()) _exit(128 + static_cast<int>(info.ssi_signo));
    first_.Notify();
  }
  close(signal_fd);
}

}  // namespace holdfast
