// SPDX-License-Identifier: Apache-2.0
// How much memory there is, and how much is used.
#pragma once

#include <cstddef>
#include <map>
#include <mutex>

namespace envconv::tool {

/// Bytes that this process may still take: the least of what the machine has to spare (MemAvailable), what the control
/// groups around the process leave (memory.max of version 2, limit_in_bytes of version 1), and what limits on its
/// address space and data leave (ulimit -v, -d).
std::size_t available_memory();

/// Bytes of this process that are in memory now, and the most there were since the process began or the mark was reset.
std::size_t resident_memory();
std::size_t resident_peak();

/// Finds for jobs that overlap in time the most memory that the process held while each of them ran.  Linux's one
/// high-water mark is reset whenever a job begins or ends, and passed on to all that run.  Any thread may call it.
class MemoryMeter {
 public:
  void begin(int job);
  /// Bytes, or 0 where the system does not tell.
  std::size_t end(int job);
  /// The most of all.
  std::size_t peak();

 private:
  void take_mark();
  std::mutex mutex_;
  std::map<int, std::size_t> running_;
  std::size_t peak_ = 0;
};

}  // namespace envconv::tool
