// SPDX-License-Identifier: Apache-2.0
#include "png_damage.h"

#include <libdeflate.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <new>
#include <span>
#include <string_view>
#include <vector>

#include "file_bytes.h"

namespace envconv {
namespace {

constexpr std::size_t at_a_time = 65536;

std::uint32_t number(const std::uint8_t* p) {
  return std::uint32_t{p[0]} << 24 | std::uint32_t{p[1]} << 16 | std::uint32_t{p[2]} << 8 | p[3];
}

// A zlib stream that comes in pieces, unpacked for its checksum alone.
class Stream {
 public:
  Stream() : unpacked_(at_a_time) {
    if (inflateInit(&z_) != Z_OK) throw std::bad_alloc();
  }
  ~Stream() { inflateEnd(&z_); }
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;

  // False for a piece that cannot be.
  bool add(std::span<std::uint8_t> piece) {
    z_.next_in = piece.data();
    z_.avail_in = static_cast<uInt>(piece.size());
    do {
      if (ended_) return true;  // encoders may leave some bytes behind it
      z_.next_out = unpacked_.data();
      z_.avail_out = static_cast<uInt>(unpacked_.size());
      const int told = inflate(&z_, Z_NO_FLUSH);
      ended_ = told == Z_STREAM_END;
      if (told != Z_OK && told != Z_STREAM_END && told != Z_BUF_ERROR) return false;
    } while (z_.avail_in > 0 || z_.avail_out == 0);
    return true;
  }
  bool ended() const { return ended_; }

 private:
  z_stream z_{};
  std::vector<std::uint8_t> unpacked_;
  bool ended_ = false;
};

}  // namespace

Result<Ok> check_png(int fd) {
  Stream pixels;
  std::vector<std::uint8_t> bytes(at_a_time);
  for (std::uint64_t at = 8;;) {
    std::array<std::uint8_t, 8> head{};
    ENVCONV_CHECK(read_at(fd, at, head));
    const std::string_view type(reinterpret_cast<const char*>(head.data()) + 4, 4);
    const bool of_pixels = type == "IDAT";
    std::uint32_t left = number(head.data()), checksum = libdeflate_crc32(0, head.data() + 4, 4);
    for (at += 8; left > 0;) {
      const std::span<std::uint8_t> piece(bytes.data(), std::min<std::size_t>(left, bytes.size()));
      ENVCONV_CHECK(read_at(fd, at, piece));
      checksum = libdeflate_crc32(checksum, piece.data(), piece.size());
      if (of_pixels && !pixels.add(piece)) return damaged_file("its pixels do not unpack");
      at += piece.size();
      left -= static_cast<std::uint32_t>(piece.size());
    }
    std::array<std::uint8_t, 4> stored{};
    ENVCONV_CHECK(read_at(fd, at, stored));
    at += 4;
    if (number(stored.data()) != checksum) return damaged_file("a chunk does not match its checksum");
    if (type == "IEND") break;
  }
  if (!pixels.ended()) return damaged_file("its pixels end too early");
  return Ok{};
}

}  // namespace envconv
