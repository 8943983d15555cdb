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
      size_ += unpacked_.size() - z_.avail_out;
      ended_ = told == Z_STREAM_END;
      if (told != Z_OK && told != Z_STREAM_END && told != Z_BUF_ERROR) return false;
    } while (z_.avail_in > 0 || z_.avail_out == 0);
    return true;
  }
  bool ended() const { return ended_; }
  std::uint64_t size() const { return size_; }  // bytes, unpacked

 private:
  z_stream z_{};
  std::uint64_t size_ = 0;
  std::vector<std::uint8_t> unpacked_;
  bool ended_ = false;
};

// Bytes that the pixels unpack to, of the content of an IHDR chunk: a byte for the filter and whole bytes of pixels for
// each row of each pass (sections 7.2 and 8).  0 where it makes no sense.
std::uint64_t size_of_pixels(std::span<const std::uint8_t, 13> header) {
  constexpr std::array<std::uint64_t, 7> channels{1, 0, 3, 1, 2, 0, 4};
  const std::uint64_t width = number(header.data()), height = number(header.data() + 4);
  const std::uint8_t depth = header[8], color = header[9], interlace = header[12];
  if (color >= channels.size() || depth > 16 || interlace > 1 || ((width | height) >> 31) != 0) return 0;
  const auto bytes = [&](std::uint64_t columns, std::uint64_t rows) {
    return columns == 0 ? 0 : rows * (1 + (columns * depth * channels[color] + 7) / 8);
  };
  if (interlace == 0) return bytes(width, height);
  struct Pass {
    unsigned x, y, dx, dy;
  };
  constexpr std::array<Pass, 7> passes{
      {{0, 0, 8, 8}, {4, 0, 8, 8}, {0, 4, 4, 8}, {2, 0, 4, 4}, {0, 2, 2, 4}, {1, 0, 2, 2}, {0, 1, 1, 2}}};
  std::uint64_t all = 0;
  for (const Pass& pass : passes)
    all += bytes((width + pass.dx - 1 - pass.x) / pass.dx, (height + pass.dy - 1 - pass.y) / pass.dy);
  return all;
}

}  // namespace

Result<Ok> check_png(int fd) {
  Stream pixels;
  std::array<std::uint8_t, 13> header{};
  ENVCONV_CHECK(read_at(fd, 16, header));
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
  if (pixels.size() != size_of_pixels(header)) return damaged_file("its pixels are not as many as its header says");
  return Ok{};
}

}  // namespace envconv
