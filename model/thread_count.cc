// SPDX-License-Identifier: Apache-2.0
#include "model/thread_count.h"

#include <sched.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

namespace holdfast {
namespace {

namespace fs = std::filesystem;

constexpr double kUnlimited = 1 << 20;  // more processors than there are

// Nothing of what cannot be read, as a directory, of which an iterator of the stream's buffer would throw.
std::string ContentOf(const fs::path& file) {
  std::ostringstream content;
  content << std::ifstream(file).rdbuf();
  return content.str();
}

// Processor time in a period, both in microseconds. Not numbers, as in "max", or below 1: no quota.
double Processors(const std::string& quota_and_period) {
  double quota = 0, period = 0;
  std::istringstream words(quota_and_period);
  if (!(words >> quota >> period) || quota < 1 || period < 1) return kUnlimited;
  return quota / period;
}

double QuotaOf(const fs::path& group) {
  const std::string second = ContentOf(group / "cpu.max");
  if (!second.empty()) return Processors(second);
  return Processors(ContentOf(group / "cpu.cfs_quota_us") + " " + ContentOf(group / "cpu.cfs_period_us"));
}

// A group has no more than the groups above it. In a container the path may be the host's, and the groups of its first
// components not be there.
double LeastQuota(const fs::path& hierarchy, const std::string& path) {
  double least = QuotaOf(hierarchy);
  for (fs::path group = fs::path(path).relative_path(); !group.empty(); group = group.parent_path()) {
    least = std::min(least, QuotaOf(hierarchy / group));
  }
  return least;
}

double ControlGroupQuota(const fs::path& root) {
  const fs::path mounted = root / "sys/fs/cgroup";
  double least = kUnlimited;
  for (const absl::string_view line : absl::StrSplit(ContentOf(root / "proc/self/cgroup"), '\n')) {
    // The hierarchy's number, its controllers (none: those of version 2), and the process's group there.
    const std::vector<std::string> fields = absl::StrSplit(line, absl::MaxSplits(':', 2));
    if (fields.size() != 3) continue;
    const std::vector<absl::string_view> controllers = absl::StrSplit(fields[1], ',');
    if (fields[1].empty()) {
      least = std::min(least, LeastQuota(mounted, fields[2]));
    } else if (std::find(controllers.begin(), controllers.end(), "cpu") != controllers.end()) {
      for (const std::string& name : {std::string("cpu"), fields[1]}) {
        least = std::min(least, LeastQuota(mounted / name, fields[2]));
      }
    }
  }
  return least;
}

int Affinity() {
  cpu_set_t set;
  if (sched_getaffinity(0, sizeof(set), &set) == 0) return CPU_COUNT(&set);
  return static_cast<int>(std::thread::hardware_concurrency());
}

}  // namespace

int PermittedThreads(const fs::path& root) {
  return std::max(1, std::min(Affinity(), static_cast<int>(std::ceil(ControlGroupQuota(root)))));
}

}  // namespace holdfast
