// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace holdfast {

// As many threads as this process may keep busy: the processors that it may run on, or fewer where one of its control
// groups, such as a container's, has a quota of processor time, rounded up. 'root': of the file system in which
// proc/self/cgroup and sys/fs/cgroup are read, of either version; what cannot be read limits nothing.
int PermittedThreads(const std::filesystem::path& root = "/");

// Threads that compute: as many as asked for, or all that are permitted for 0. LibTorch's own choice may be a single
// one.
inline int ThreadCount(int asked) { return asked > 0 ? asked : PermittedThreads(); }

}  // namespace holdfast
