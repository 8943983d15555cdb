// SPDX-License-Identifier: Apache-2.0
// Memory in whole pages.  Internal: not installed.
#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <utility>

namespace envconv {

/// Gives whole pages back to the system, of a file that is mapped as well as of this process alone: they are zeros from
/// now on.
inline void forget_pages(void* data, std::size_t size) {
  // Only pages of a file can be removed.
  if (::madvise(data, size, MADV_REMOVE) != 0) ::madvise(data, size, MADV_DONTNEED);
}

/// A mapping that is undone at the end of its life; no mapping when data() is null.
class MappedMemory {
 public:
  MappedMemory() = default;
  MappedMemory(void* data, std::size_t size) : data_(data), size_(size) {}
  MappedMemory(MappedMemory&& other) noexcept { swap(other); }
  MappedMemory& operator=(MappedMemory&& other) noexcept {
    swap(other);
    return *this;
  }
  ~MappedMemory() {
    if (data_ != nullptr) ::munmap(data_, size_);
  }

  /// Zeros of this process alone, or no mapping when there is no memory.
  static MappedMemory zeros(std::size_t size) {
    void* data = ::mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    return data == MAP_FAILED ? MappedMemory() : MappedMemory(data, size);
  }
  /// Bytes of a file, shared, from an offset of whole pages; or no mapping.
  static MappedMemory of_file(int fd, std::size_t offset, std::size_t size) {
    void* data = ::mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, fd, static_cast<off_t>(offset));
    return data == MAP_FAILED ? MappedMemory() : MappedMemory(data, size);
  }

  void* data() const { return data_; }
  std::size_t size() const { return size_; }
  /// Whoever calls this undoes the mapping.
  void* release() { return std::exchange(data_, nullptr); }

 private:
  void swap(MappedMemory& other) {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
  }
  void* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace envconv
