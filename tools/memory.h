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

/// Bytes of address space that limits leave it (ulimit -v).
std::size_t available_address_space();

/// Bytes of this process that are in memory now, and the most there ever were.
std::size_t resident_memory();
std::size_t resident_peak();

/// Finds for jobs that overlap in time the most memory that the process held while each of them ran: exactly where that
/// was more than ever before, and else as samples tell.  Any thread may call it.
class MemoryMeter {
 public:
  void begin(int job);
  /// Looks how much there is now.
  void sample();
  /// Bytes, or 0 where the system does not tell.
  std::size_t end(int job);

 private:
  struct Running {
    std::size_t before, sampled;  // the process's peak when the job began; the most seen since
  };
  std::mutex mutex_;
  std::map<int, Running> running_;
};

}  // namespace envconv::tool
