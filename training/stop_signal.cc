// SPDX-License-Identifier: Apache-2.0
#include "training/stop_signal.h"

#include <pthread.h>
#include <signal.h>
#include <unistd.h>

namespace holdfast {
namespace {

sigset_t StopSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  return signals;
}

}  // namespace

SignalFlag::SignalFlag() {
  const sigset_t signals = StopSignals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  thread_ = std::thread([this] { Watch(); });
}

SignalFlag::~SignalFlag() {
  closing_ = true;
  pthread_kill(thread_.native_handle(), SIGTERM);  // wakes it
  thread_.join();
}

void SignalFlag::Watch() {
  const sigset_t signals = StopSignals();
  int signal = 0;
  while (sigwait(&signals, &signal) == 0 && !closing_) {
    if (requested_.exchange(true)) _exit(128 + signal);
  }
}

}  // namespace holdfast
