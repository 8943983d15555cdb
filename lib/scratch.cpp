// SPDX-License-Identifier: Apache-2.0
#include "scratch.h"

#include <fcntl.h>
#include <linux/magic.h>
#include <sys/mman.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cstring>
#include <new>
#include <system_error>
#include <utility>

#include "output_file.h"

namespace envconv {
namespace {

// Unmapping pages that are needed again at once would gain nothing: so much must have come anew.
constexpr std::size_t least_gain = std::size_t{4} << 20;

constexpr std::chrono::milliseconds interval(1);
// Without /proc nobody tells how much there is: pages are then unmapped every so often.
constexpr std::chrono::milliseconds blind_interval(20);

std::string megabytes(std::size_t bytes) { return std::to_string((bytes + 999999) / 1000000) + " MB"; }

}  // namespace

Scratch::Scratch(std::string folder, std::size_t resident)
    : folder_(std::move(folder)),
      limit_(resident),
      statm_(::open("/proc/self/statm", O_RDONLY | O_CLOEXEC)),
      threshold_(resident) {}

Scratch::~Scratch() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  stop_.notify_all();
  if (watcher_.joinable()) watcher_.join();
  if (statm_ >= 0) ::close(statm_);
}

bool Scratch::lies_in_memory(const std::string& folder) {
  struct statfs info {};
  if (::statfs(folder.c_str(), &info) != 0) return false;
  return info.f_type == TMPFS_MAGIC || static_cast<unsigned long>(info.f_type) == RAMFS_MAGIC;
}

void* Scratch::allocate(std::size_t bytes) {
  const auto fail = [&](int code) {
    const std::lock_guard lock(mutex_);
    if (!failure_) {
      failure_ = Error{ErrorCode::output,
                       std::string(std::strerror(code)) + " for " + megabytes(bytes) + " of scratch storage in " +
                           printable(folder_) + " (more --memory needs none)",
                       code};
    }
    throw std::bad_alloc();
  };
  const int fd = open_nameless(folder_);
  if (fd < 0) fail(errno);
  // Room is taken now: a disk that fills up under a mapping ends the process.
  int code;
  do {
    code = ::posix_fallocate(fd, 0, static_cast<off_t>(bytes));
  } while (code == EINTR);
  void* memory = MAP_FAILED;
  if (code == 0) {
    memory = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (memory == MAP_FAILED) code = errno;
  }
  ::close(fd);
  if (memory == MAP_FAILED) fail(code);
#ifdef MADV_NOHUGEPAGE
  // A read here and there would map two megabytes each time: faster than anybody can unmap them.
  ::madvise(memory, bytes, MADV_NOHUGEPAGE);
#endif
  const std::lock_guard lock(mutex_);
  mappings_.emplace(memory, bytes);
  if (!watcher_.joinable()) {
    try {
      watcher_ = std::thread([this] { watch(); });
    } catch (const std::system_error&) {
      // Those that call relieve() do what they can.
    }
  }
  return memory;
}

void Scratch::release(void* memory) noexcept {
  std::size_t bytes;
  {
    const std::lock_guard lock(mutex_);
    const auto found = mappings_.find(memory);
    if (found == mappings_.end()) return;
    bytes = found->second;
    mappings_.erase(found);
  }
  // Takes its time: the file goes with it.
  ::munmap(memory, bytes);
}

std::optional<Error> Scratch::failure() const {
  const std::lock_guard lock(mutex_);
  return failure_;
}

// Bytes of the process in memory; 0 where the system does not tell.
std::size_t Scratch::resident() const {
  char text[128];
  const ssize_t size = statm_ < 0 ? -1 : ::pread(statm_, text, sizeof text, 0);
  if (size <= 0) return 0;
  const char *const begin = text, *const end = text + size;
  const char* const second = std::find(begin, end, ' ');
  std::size_t pages = 0;
  if (second == end || std::from_chars(second + 1, end, pages).ec != std::errc()) return 0;
  return pages * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

// With the mutex held.  Other threads may be reading and writing: they find their pages again.
void Scratch::unmap_pages() {
  unmappings_.fetch_add(1, std::memory_order_relaxed);
  for (const auto& [memory, bytes] : mappings_) ::madvise(memory, bytes, MADV_DONTNEED);
}

void Scratch::relieve() {
  touched_.store(0, std::memory_order_relaxed);
  std::size_t now = resident();
  if (now == 0 || now < threshold_) return;
  const std::lock_guard lock(mutex_);
  // Whoever had the mutex before may have done it.
  if (resident() < threshold_) return;
  unmap_pages();
  threshold_ = std::max(limit_, resident() + least_gain);
}

void Scratch::watch() {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    const bool blind = resident() == 0;
    stop_.wait_for(lock, blind ? blind_interval : interval);
    if (stopping_) break;
    if (blind) {
      unmap_pages();
      continue;
    }
    lock.unlock();
    relieve();
    lock.lock();
  }
}

}  // namespace envconv
