// SPDX-License-Identifier: Apache-2.0
#include "file_bytes.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace envconv {

Error damaged_file(const std::string& what) { return {ErrorCode::input, "truncated or damaged: " + what}; }

Result<Ok> read_at(int fd, std::uint64_t position, std::span<std::uint8_t> to) {
  while (!to.empty()) {
    const ssize_t n = ::pread(fd, to.data(), to.size(), static_cast<off_t>(position));
    if (n == 0) return damaged_file("unexpected end of file");
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return damaged_file(std::string("cannot be read: ") + std::strerror(errno));
    to = to.subspan(static_cast<std::size_t>(n));
    position += static_cast<std::uint64_t>(n);
  }
  return Ok{};
}

Result<std::uint64_t> size_of_file(int fd) {
  struct stat info {};
  if (::fstat(fd, &info) != 0) return Error{ErrorCode::input, std::string("cannot be read: ") + std::strerror(errno)};
  return static_cast<std::uint64_t>(std::max<off_t>(info.st_size, 0));
}

}  // namespace envconv
