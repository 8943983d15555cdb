// SPDX-License-Identifier: Apache-2.0
#include "png_damage.h"

#include <libdeflate.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <new>
#include <optional>
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

// The content of an IHDR chunk.
struct Header {
  std::uint64_t width, height;
  unsigned depth, color, interlace;

  explicit Header(std::span<const std::uint8_t, 13> chunk)
      : width(number(chunk.data())),
        height(number(chunk.data() + 4)),
        depth(chunk[8]),
        color(chunk[9]),
        interlace(chunk[12]) {}
  bool makes_sense() const {
    return color < channels.size() && channels[color] > 0 && std::has_single_bit(depth) && depth <= 16 &&
           interlace <= 1 && width > 0 && height > 0 && ((width | height) >> 31) == 0;
  }
  // Of pixels, without the filter's.
  std::uint64_t bytes_of_row(std::uint64_t columns) const { return (columns * depth * channels[color] + 7) / 8; }

  static constexpr unsigned indexed = 3;
  static constexpr std::array<std::uint64_t, 7> channels{1, 0, 3, 1, 2, 0, 4};
};

// Rows that are stored one after the other.
struct Pass {
  std::uint64_t columns, rows;
};

// Those with pixels (section 8).
std::vector<Pass> passes_of(const Header& header) {
  if (header.interlace == 0) return {{header.width, header.height}};
  struct Grid {
    unsigned x, y, dx, dy;
  };
  constexpr std::array<Grid, 7> grids{
      {{0, 0, 8, 8}, {4, 0, 8, 8}, {0, 4, 4, 8}, {2, 0, 4, 4}, {0, 2, 2, 4}, {1, 0, 2, 2}, {0, 1, 1, 2}}};
  std::vector<Pass> passes;
  for (const Grid& grid : grids) {
    const Pass pass{(header.width + grid.dx - 1 - grid.x) / grid.dx, (header.height + grid.dy - 1 - grid.y) / grid.dy};
    if (pass.columns > 0 && pass.rows > 0) passes.push_back(pass);
  }
  return passes;
}

// Bytes that the pixels unpack to: a byte for the filter and whole bytes of pixels for each row (section 7.2).
std::uint64_t size_of_pixels(const Header& header) {
  std::uint64_t all = 0;
  for (const Pass& pass : passes_of(header)) all += pass.rows * (1 + header.bytes_of_row(pass.columns));
  return all;
}

// Rows of indices, as they are unpacked, against a palette.
class Indices {
 public:
  Indices(const Header& header, std::size_t colors) : header_(header), colors_(colors), passes_(passes_of(header)) {
    start_pass();
  }

  // False once an index is beyond the palette, or a filter is none.
  bool add(std::span<const std::uint8_t> bytes) {
    while (!bytes.empty() && pass_ < passes_.size()) {
      const std::size_t count = std::min(bytes.size(), row_.size() - filled_);
      std::copy_n(bytes.begin(), count, row_.begin() + static_cast<std::ptrdiff_t>(filled_));
      bytes = bytes.subspan(count);
      filled_ += count;
      if (filled_ < row_.size()) break;
      if (!unfilter() || !all_are_colors()) return false;
      above_.swap(row_);
      filled_ = 0;
      if (++y_ == passes_[pass_].rows && ++pass_ < passes_.size()) start_pass();
    }
    return true;
  }

 private:
  void start_pass() {
    y_ = 0;
    row_.assign(1 + header_.bytes_of_row(passes_[pass_].columns), 0);
    above_ = row_;
  }

  // In place; a pixel is at most a byte (section 9.2).
  bool unfilter() {
    const int filter = row_[0];
    row_[0] = above_[0] = 0;
    for (std::size_t i = 1; i < row_.size(); ++i) {
      const int left = row_[i - 1], up = above_[i], corner = above_[i - 1];
      int guess = 0;
      switch (filter) {
        case 0: return true;
        case 1: guess = left; break;
        case 2: guess = up; break;
        case 3: guess = (left + up) / 2; break;
        case 4: {
          const int by_left = std::abs(up - corner), by_up = std::abs(left - corner),
                    by_corner = std::abs(left + up - 2 * corner);
          guess = by_left <= by_up && by_left <= by_corner ? left : by_up <= by_corner ? up : corner;
          break;
        }
        default: return false;
      }
      row_[i] = static_cast<std::uint8_t>(row_[i] + guess);
    }
    return true;
  }

  bool all_are_colors() const {
    const unsigned depth = header_.depth, in_byte = 8 / depth, most = (1u << depth) - 1;
    for (std::uint64_t x = 0; x < passes_[pass_].columns; ++x) {
      const unsigned shift = (in_byte - 1 - static_cast<unsigned>(x % in_byte)) * depth;
      if ((row_[1 + x / in_byte] >> shift & most) >= colors_) return false;
    }
    return true;
  }

  Header header_;
  std::size_t colors_;
  std::vector<Pass> passes_;
  std::size_t pass_ = 0, filled_ = 0;
  std::uint64_t y_ = 0;
  std::vector<std::uint8_t> row_, above_;
};

// A zlib stream that comes in pieces, unpacked for its checksum, and for its indices where there may be wrong ones.
class Stream {
 public:
  Stream() : unpacked_(at_a_time) {
    if (inflateInit(&z_) != Z_OK) throw std::bad_alloc();
  }
  ~Stream() { inflateEnd(&z_); }
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;

  void check_indices(const Header& header, std::size_t colors) { indices_.emplace(header, colors); }

  // False for a piece that cannot be.
  bool add(std::span<std::uint8_t> piece) {
    z_.next_in = piece.data();
    z_.avail_in = static_cast<uInt>(piece.size());
    do {
      if (ended_) return true;  // encoders may leave some bytes behind it
      z_.next_out = unpacked_.data();
      z_.avail_out = static_cast<uInt>(unpacked_.size());
      const int told = inflate(&z_, Z_NO_FLUSH);
      const std::size_t made = unpacked_.size() - z_.avail_out;
      size_ += made;
      ended_ = told == Z_STREAM_END;
      if (told != Z_OK && told != Z_STREAM_END && told != Z_BUF_ERROR) return false;
      if (indices_ && indices_right_) indices_right_ = indices_->add({unpacked_.data(), made});
    } while (z_.avail_in > 0 || z_.avail_out == 0);
    return true;
  }
  bool ended() const { return ended_; }
  bool indices_right() const { return indices_right_; }
  std::uint64_t size() const { return size_; }  // bytes, unpacked

 private:
  z_stream z_{};
  std::uint64_t size_ = 0;
  std::vector<std::uint8_t> unpacked_;
  std::optional<Indices> indices_;
  bool ended_ = false, indices_right_ = true;
};

}  // namespace

Result<Ok> check_png(int fd) {
  Stream pixels;
  std::array<std::uint8_t, 13> first{};
  ENVCONV_CHECK(read_at(fd, 16, first));
  const Header header(first);
  if (!header.makes_sense()) return damaged_file("its header makes no sense");
  std::vector<std::uint8_t> bytes(at_a_time);
  for (std::uint64_t at = 8;;) {
    std::array<std::uint8_t, 8> head{};
    ENVCONV_CHECK(read_at(fd, at, head));
    const std::string_view type(reinterpret_cast<const char*>(head.data()) + 4, 4);
    const bool of_pixels = type == "IDAT";
    std::uint32_t left = number(head.data());
    if (type == "PLTE" && header.color == Header::indexed && header.depth <= 8 && left / 3 < 1u << header.depth)
      pixels.check_indices(header, left / 3);
    std::uint32_t checksum = libdeflate_crc32(0, head.data() + 4, 4);
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
  if (!pixels.indices_right()) return damaged_file("its pixels have colours that its palette lacks");
  if (pixels.size() != size_of_pixels(header)) return damaged_file("its pixels are not as many as its header says");
  return Ok{};
}

}  // namespace envconv
