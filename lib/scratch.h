// SPDX-License-Identifier: Apache-2.0
// Pixels in files, for images that are larger than the memory that they may take.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "result.h"

namespace envconv {

/// Storage for large images on a disk.  Give it to ReadOptions, and to an Image; what is made from an image (levels,
/// packed and unpacked images, copies) lives where that one does.  Any thread may use it; it outlives its images.
///
/// Such an image is a file without a name, mapped into memory, so that all code works on it as on any other, and a
/// process that is killed leaves nothing behind.  Pages that were touched count as the process's own memory.  A thread
/// looks every millisecond how much that is, and above a limit unmaps the pages of all images: their content is then
/// the system's to keep in its cache or on the disk.  The bound is soft: what is touched until the next look comes on
/// top of it.
class Scratch {
 public:
  /// Smaller images are kept in memory all the same.
  static constexpr std::size_t least_bytes = std::size_t{1} << 20;

  /// Files are made in `folder`; a file system that lies in memory itself (lies_in_memory()) would gain nothing.
  /// Pages are unmapped when the process holds more than `resident` bytes.
  Scratch(std::string folder, std::size_t resident);
  ~Scratch();
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;

  /// So many bytes, zero, on a page's boundary; all of their room on the disk is theirs at once.  Throws std::bad_alloc
  /// when there is none: failure() tells the reason.
  void* allocate(std::size_t bytes);
  void release(void* memory) noexcept;

  /// Looks now.  For loops that touch pages faster than the thread can follow; takes about a microsecond.
  void relieve();
  /// The same once in a while: about so many bytes will be touched next.
  void touched(std::size_t bytes) {
    if (touched_.fetch_add(bytes, std::memory_order_relaxed) + bytes >= look_every) relieve();
  }

  /// How often pages were unmapped: what a thread has touched is mapped still while this has not changed.
  std::uint64_t unmappings() const { return unmappings_.load(std::memory_order_relaxed); }

  /// The first thing that went wrong, ErrorCode::output, or nothing.
  std::optional<Error> failure() const;

  /// True for folders of file systems without a disk (tmpfs, ramfs).
  static bool lies_in_memory(const std::string& folder);

 private:
  static constexpr std::size_t look_every = std::size_t{1} << 20;  // bytes

  void watch();
  std::size_t resident() const;
  void unmap_pages();

  const std::string folder_;
  const std::size_t limit_;
  int statm_ = -1;                       // /proc/self/statm, or -1
  std::atomic<std::size_t> threshold_;   // bytes above which pages are unmapped
  std::atomic<std::size_t> touched_{0};  // bytes since the last look, by those who tell
  std::atomic<std::uint64_t> unmappings_{0};
  mutable std::mutex mutex_;  // of all below
  std::map<void*, std::size_t> mappings_;
  std::optional<Error> failure_;
  bool stopping_ = false;
  std::condition_variable stop_;
  std::thread watcher_;
};

}  // namespace envconv
