// SPDX-License-Identifier: Apache-2.0
#include "memory.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <sstream>
#include <string>

namespace envconv::tool {
namespace {

constexpr std::size_t unlimited = std::numeric_limits<std::size_t>::max();

// The number on the line of /proc that begins with a key, in bytes; `missing` without one.
std::size_t kilobytes(const char* file, const std::string& key, std::size_t missing) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (!line.starts_with(key)) continue;
    std::istringstream rest(line.substr(key.size()));
    rest.imbue(std::locale::classic());
    std::size_t number = 0;
    if (rest >> number) return number * 1024;
  }
  return missing;
}

// A control group's number; "max", or nothing, is no limit.
std::size_t number_in(const std::string& file) {
  std::ifstream in(file);
  in.imbue(std::locale::classic());
  std::size_t number = 0;
  return in >> number ? number : unlimited;
}

// What a group and all those around it leave.
std::size_t left_in_groups(const std::string& root, std::string group, const char* limit_file, const char* usage_file) {
  std::size_t left = unlimited;
  for (;;) {
    const std::string folder = root + (group == "/" ? "" : group) + "/";
    const std::size_t limit = number_in(folder + limit_file), usage = number_in(folder + usage_file);
    // The first version writes "no limit" as a number near 2^63.
    if (limit < unlimited / 4 && usage != unlimited) left = std::min(left, limit - std::min(limit, usage));
    if (group.empty() || group == "/") return left;
    group.resize(group.rfind('/'));
  }
}

std::size_t left_by_control_groups() {
  std::size_t left = unlimited;
  std::ifstream in("/proc/self/cgroup");
  for (std::string line; std::getline(in, line);) {  // "0::/a/b", or "7:cpu,memory:/a/b"
    const std::size_t one = line.find(':'), two = line.find(':', one == std::string::npos ? one : one + 1);
    if (two == std::string::npos) continue;
    const std::string kinds = "," + line.substr(one + 1, two - one - 1) + ",", group = line.substr(two + 1);
    if (kinds == ",,") {
      left = std::min(left, left_in_groups("/sys/fs/cgroup", group, "memory.max", "memory.current"));
    } else if (kinds.find(",memory,") != std::string::npos) {
      left = std::min(left,
                      left_in_groups("/sys/fs/cgroup/memory", group, "memory.limit_in_bytes", "memory.usage_in_bytes"));
    }
  }
  return left;
}

std::size_t left_by_limit(__rlimit_resource resource, const std::string& key) {
  rlimit limit{};
  if (getrlimit(resource, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return unlimited;
  return limit.rlim_cur - std::min<std::size_t>(limit.rlim_cur, kilobytes("/proc/self/status", key, 0));
}

}  // namespace

std::size_t available_address_space() { return left_by_limit(RLIMIT_AS, "VmSize:"); }

std::size_t available_memory() {
  const auto pages = static_cast<std::size_t>(sysconf(_SC_PHYS_PAGES));
  const std::size_t all = pages * static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  return std::min({kilobytes("/proc/meminfo", "MemAvailable:", all), left_by_control_groups(),
                   available_address_space(), left_by_limit(RLIMIT_DATA, "VmData:")});
}

namespace {
// Without /proc.  Never less than the truth: it may be the peak of the program that this one replaced.
std::size_t peak_of_usage() {
  rusage usage{};
  return getrusage(RUSAGE_SELF, &usage) == 0 ? static_cast<std::size_t>(usage.ru_maxrss) * 1024 : 0;
}
}  // namespace

std::size_t resident_memory() {
  const std::size_t now = kilobytes("/proc/self/status", "VmRSS:", 0);
  return now > 0 ? now : peak_of_usage();
}
std::size_t resident_peak() {
  const std::size_t peak = kilobytes("/proc/self/status", "VmHWM:", 0);
  return peak > 0 ? peak : peak_of_usage();
}

void MemoryMeter::begin(int job) {
  const std::lock_guard lock(mutex_);
  running_[job] = {resident_peak(), resident_memory()};
}

void MemoryMeter::sample() {
  const std::lock_guard lock(mutex_);
  const std::size_t now = resident_memory();
  for (auto& [job, running] : running_) running.sampled = std::max(running.sampled, now);
}

std::size_t MemoryMeter::end(int job) {
  sample();
  const std::lock_guard lock(mutex_);
  const Running running = running_[job];
  running_.erase(job);
  const std::size_t peak = resident_peak();
  return peak > running.before ? peak : running.sampled;
}

}  // namespace envconv::tool
