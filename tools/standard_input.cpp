// SPDX-License-Identifier: Apache-2.0
#include "standard_input.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstring>
#include <vector>

#include "memory.h"

namespace envconv::tool {
namespace {

Error unreadable(int code) {
  return {ErrorCode::input, "-: standard input cannot be read: " + std::string(std::strerror(code))};
}

// A file can be opened again at its beginning; from elsewhere only what is left of it counts.
bool is_whole_file() {
  struct stat status;
  return fstat(STDIN_FILENO, &status) == 0 && S_ISREG(status.st_mode) && lseek(STDIN_FILENO, 0, SEEK_CUR) == 0;
}

// Of a file in memory, or of standard input itself; -1 and why.
struct Kept {
  int fd = is_whole_file() ? STDIN_FILENO : memfd_create("standard input", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  int error = errno;
};

const Kept& kept() {
  static const Kept once;
  return once;
}

int descriptor() { return kept().fd; }

Result<Ok> write_all(const std::byte* from, std::size_t count) {
  while (count > 0) {
    const ssize_t n = write(descriptor(), from, count);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return Error{ErrorCode::limit, "-: not enough memory for what standard input holds"};
    from += n;
    count -= static_cast<std::size_t>(n);
  }
  return Ok{};
}

Result<Ok> copy() {
  if (descriptor() < 0) return unreadable(kept().error);
  if (isatty(STDIN_FILENO) != 0)
    return Error{ErrorCode::input, "-: standard input is a terminal (a file is expected there)"};
  if (descriptor() != STDIN_FILENO) {
    const std::size_t most = available_memory() / 4 * 3;
    std::vector<std::byte> piece(std::size_t{1} << 20);
    std::size_t size = 0;
    for (;;) {
      const ssize_t n = read(STDIN_FILENO, piece.data(), piece.size());
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return unreadable(errno);
      if (n == 0) break;
      size += static_cast<std::size_t>(n);
      if (size > most)
        return Error{ErrorCode::limit, "-: standard input holds more than the " + std::to_string(most >> 20) +
                                           " MB that there is memory for (name a file)"};
      ENVCONV_CHECK(write_all(piece.data(), static_cast<std::size_t>(n)));
    }
    fcntl(descriptor(), F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL);
  }
  if (access(standard_input_path().c_str(), R_OK) != 0)
    return Error{ErrorCode::input, "-: standard input can be read only where /proc is mounted (name a file)"};
  return Ok{};
}

}  // namespace

std::string standard_input_path() { return "/proc/self/fd/" + std::to_string(descriptor()); }

Result<Ok> keep_standard_input() {
  static const Result<Ok> done = copy();
  return done;
}

std::string with_standard_input_named(std::string message) {
  const std::string path = standard_input_path();
  if (message.starts_with(path + ":")) message.replace(0, path.size(), standard_input);
  return message;
}

}  // namespace envconv::tool
