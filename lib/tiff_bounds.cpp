// SPDX-License-Identifier: Apache-2.0
#include "tiff_bounds.h"

#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstdint>

namespace envconv {
namespace {

constexpr int most_directories = 64;

class Reader {
 public:
  explicit Reader(int fd) : fd_(fd) {
    struct stat info {};
    if (::fstat(fd, &info) == 0 && info.st_size > 0) size_ = static_cast<std::uint64_t>(info.st_size);
  }

  bool cut_off() {
    std::array<unsigned char, 8> start{};
    if (!get(0, start.data(), start.size())) return true;
    little_ = start[0] == 'I';
    big_ = number(start.data() + 2, 2) == 43;
    std::uint64_t at = big_ ? field(8, 8) : number(start.data() + 4, 4);
    for (int i = 0; i < most_directories && at != 0 && !cut_off_; ++i) at = directory(at);
    return cut_off_;
  }

 private:
  // The offset of the next one.
  std::uint64_t directory(std::uint64_t at) {
    const unsigned word = big_ ? 8 : 4, entry_size = big_ ? 20 : 12, count_size = big_ ? 8 : 2;
    const std::uint64_t count = field(at, count_size);
    if (cut_off_ || count > 65535) return 0;
    at += count_size;
    for (std::uint64_t i = 0; i < count && !cut_off_; ++i, at += entry_size) {
      std::array<unsigned char, 20> entry{};
      if (!get(at, entry.data(), entry_size)) return 0;
      const std::uint64_t bytes = size_of_type(number(entry.data() + 2, 2)), values = number(entry.data() + 4, word);
      if (bytes == 0 || values > size_) {
        cut_off_ = cut_off_ || bytes > 0;
        return 0;
      }
      const std::uint64_t offset = number(entry.data() + 4 + word, word);
      if (bytes * values > word && (offset > size_ || bytes * values > size_ - offset)) cut_off_ = true;
    }
    return cut_off_ ? 0 : field(at, word);
  }

  // 0: no type that is known.
  static std::uint64_t size_of_type(std::uint64_t type) {
    constexpr std::array<std::uint8_t, 19> sizes{0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8};
    return type < sizes.size() ? sizes[type] : 0;
  }

  std::uint64_t number(const unsigned char* p, unsigned bytes) const {
    std::uint64_t value = 0;
    for (unsigned i = 0; i < bytes; ++i) value = value << 8 | p[little_ ? bytes - 1 - i : i];
    return value;
  }

  std::uint64_t field(std::uint64_t at, unsigned bytes) {
    std::array<unsigned char, 8> value{};
    return get(at, value.data(), bytes) ? number(value.data(), bytes) : 0;
  }

  bool get(std::uint64_t at, unsigned char* to, std::size_t bytes) {
    if (at > size_ || bytes > size_ - at ||
        ::pread(fd_, to, bytes, static_cast<off_t>(at)) != static_cast<ssize_t>(bytes)) {
      cut_off_ = true;
    }
    return !cut_off_;
  }

  const int fd_;
  std::uint64_t size_ = 0;
  bool little_ = true, big_ = false, cut_off_ = false;
};

}  // namespace

bool tiff_fields_cut_off(int fd) { return Reader(fd).cut_off(); }

}  // namespace envconv
