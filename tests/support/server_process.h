// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <spawn.h>
#include <sys/inotify.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/support/temp_dir.h"

namespace holdfast {

// A holdfast-server that can be killed. Ready when the constructor returns, at a port that the system chose unless a
// flag says otherwise.
class ServerProcess {
 public:
  ServerProcess(const std::string& program, std::vector<std::string> flags) {
    const std::string port_file = dir_.File("ports"), log = dir_.File("log");
    const int watch = inotify_init1(IN_CLOEXEC);
    EXPECT_GE(inotify_add_watch(watch, dir_.path().c_str(), IN_MOVED_TO | IN_CLOSE_WRITE), 0);
    std::vector<std::string> arguments = {program, "--listen=127.0.0.1:0", "--metrics_listen=127.0.0.1:0",
                                          absl::StrCat("--port_file=", port_file)};
    for (std::string& flag : flags) arguments.push_back(std::move(flag));
    Spawn(arguments, log);
    while (!ReadPort(port_file)) {
      if (!AwaitNews(watch)) {
        ADD_FAILURE() << "the server ended: " << ReadFile(log);
        break;
      }
    }
    close(watch);
  }
  ~ServerProcess() {
    Send(SIGKILL);
    Wait();
  }
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  int port() const { return port_; }
  std::string address() const { return absl::StrCat("127.0.0.1:", port_); }
  void Send(int signal) const {
    if (pid_ > 0) kill(pid_, signal);
  }
  // Its exit status; -1 after a signal.
  int Wait() {
    if (pid_ <= 0) return -1;
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

 private:
  void Spawn(const std::vector<std::string>& arguments, const std::string& log) {
    std::vector<char*> argv;
    argv.reserve(arguments.size() + 1);
    for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
    argv.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    EXPECT_EQ(posix_spawn(&pid_, argv[0], &actions, nullptr, argv.data(), environ), 0);
    posix_spawn_file_actions_destroy(&actions);
  }

  // False: the process has ended.
  bool AwaitNews(int watch) const {
    const int process = static_cast<int>(syscall(SYS_pidfd_open, pid_, 0));
    pollfd waiting[] = {{watch, POLLIN, 0}, {process, POLLIN, 0}};
    poll(waiting, 2, -1);
    close(process);
    if (waiting[0].revents == 0) return false;
    char events[4096];
    return read(watch, events, sizeof(events)) > 0;
  }

  bool ReadPort(const std::string& file) {
    constexpr char kName[] = "grpc=";
    const std::string text = ReadFile(file);
    const size_t at = text.find(kName);
    if (at == std::string::npos) return false;
    port_ = std::stoi(text.substr(at + sizeof(kName) - 1));
    return true;
  }

  static std::string ReadFile(const std::string& path) {
    std::stringstream text;
    text << std::ifstream(path).rdbuf();
    return text.str();
  }

  const TempDir dir_;
  pid_t pid_ = 0;
  int port_ = 0;
};

}  // namespace holdfast
