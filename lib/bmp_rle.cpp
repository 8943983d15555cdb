// SPDX-License-Identifier: Apache-2.0
#include "bmp_rle.h"

#include <algorithm>
#include <cstddef>
#include <span>

#include "file_bytes.h"

namespace envconv {
namespace {

// BITMAPFILEHEADER, and BITMAPINFOHEADER, which longer headers begin with.
constexpr std::size_t kInfoAt = 14, kHeaderSize = 54;
enum : std::size_t { kSizeAt = 2, kOffsetAt = 10, kWidthAt = 18, kHeightAt = 22, kBitsAt = 28, kCompressionAt = 30 };
enum : std::size_t { kImageSizeAt = 34, kColorsAt = 46 };

std::uint32_t word(std::span<const std::uint8_t> bytes, std::size_t at) {
  std::uint32_t v = 0;
  for (std::size_t i = 4; i > 0; --i) v = v << 8 | bytes[at + i - 1];
  return v;
}

void set_word(std::span<std::uint8_t> bytes, std::size_t at, std::size_t v) {
  for (std::size_t i = 0; i < 4; ++i) bytes[at + i] = static_cast<std::uint8_t>(v >> (8 * i));
}

// Rows of `stride` bytes, the lowest first, as both ways of storing have them.
struct Indices {
  std::size_t width, height, stride, colors;
  std::span<std::uint8_t> pixels;
  std::size_t x = 0, y = 0;

  bool put(unsigned index) {
    if (x >= width || y >= height || index >= colors) return false;
    pixels[y * stride + x++] = static_cast<std::uint8_t>(index);
    return true;
  }
};

// False where the stream makes no sense or ends too early.
bool unpack(std::span<const std::uint8_t> from, bool nibbles, Indices& to) {
  const auto pixel = [&](std::size_t at, std::size_t i) -> unsigned {
    if (!nibbles) return from[at + i];
    return i % 2 == 0 ? from[at + i / 2] >> 4 : from[at + i / 2] & 15u;
  };
  for (std::size_t at = 0; from.size() - at >= 2;) {
    const std::size_t count = from[at], code = from[at + 1];
    at += 2;
    if (count > 0) {  // one or two indices, repeated
      for (std::size_t i = 0; i < count; ++i) {
        if (!to.put(pixel(at - 1, nibbles ? i % 2 : 0))) return false;
      }
    } else if (code == 0) {  // the line's end
      to.x = 0;
      if (++to.y > to.height) return false;
    } else if (code == 1) {  // the bitmap's end
      return true;
    } else if (code == 2) {  // a place right and above
      if (from.size() - at < 2) return false;
      to.x += from[at];
      to.y += from[at + 1];
      at += 2;
      if (to.x > to.width || to.y > to.height) return false;
    } else {  // indices, filled up to two bytes
      const std::size_t bytes = nibbles ? (code + 1) / 2 : code;
      if (from.size() - at < bytes) return false;
      for (std::size_t i = 0; i < code; ++i) {
        if (!to.put(pixel(at, i))) return false;
      }
      at += std::min((bytes + 1) / 2 * 2, from.size() - at);
    }
  }
  return false;  // cut off
}

}  // namespace

Result<std::vector<std::uint8_t>> unpack_bmp(int fd) {
  std::vector<std::uint8_t> out(kHeaderSize);
  ENVCONV_TRY(const std::uint64_t file_size, size_of_file(fd));
  if (file_size < kHeaderSize) return std::vector<std::uint8_t>{};
  ENVCONV_CHECK(read_at(fd, 0, out));
  const std::uint32_t info_size = word(out, kInfoAt), compression = word(out, kCompressionAt);
  if (info_size < kHeaderSize - kInfoAt || (compression != 1 && compression != 2)) return std::vector<std::uint8_t>{};
  const bool nibbles = compression == 2;
  const std::uint32_t bits = word(out, kBitsAt) & 0xFFFF;
  const std::uint32_t most_colors = nibbles ? 16 : 256;
  Indices to{word(out, kWidthAt), word(out, kHeightAt), 0, word(out, kColorsAt), {}};
  if (to.colors == 0) to.colors = most_colors;
  const std::uint64_t offset = word(out, kOffsetAt), palette_at = std::uint64_t{kInfoAt} + info_size;
  // A pair of bytes stands for 255 pixels at most; and the height is positive, as a number with a sign.
  const bool good = bits == (nibbles ? 4 : 8) && to.colors <= most_colors && palette_at + 4 * to.colors <= offset &&
                    offset <= file_size && to.width > 0 && to.height > 0 && to.height < 0x80000000 &&
                    to.width <= 256 * (file_size - offset) / to.height;
  if (!good) return Error{ErrorCode::input, "a bad BMP header"};
  std::vector<std::uint8_t> stream(file_size - offset);
  ENVCONV_CHECK(read_at(fd, offset, stream));
  to.stride = (to.width + 3) / 4 * 4;
  const std::size_t pixels_at = kHeaderSize + 4 * to.colors;
  out.resize(pixels_at + to.stride * to.height);
  const std::span<std::uint8_t> all = out;
  ENVCONV_CHECK(read_at(fd, palette_at, all.subspan(kHeaderSize, 4 * to.colors)));
  to.pixels = all.subspan(pixels_at);
  if (!unpack(stream, nibbles, to)) return Error{ErrorCode::input, "its run-length encoded pixels make no sense"};
  set_word(all, kSizeAt, out.size());
  set_word(all, kOffsetAt, pixels_at);
  set_word(all, kInfoAt, kHeaderSize - kInfoAt);
  out[kBitsAt] = 8;
  set_word(all, kCompressionAt, 0);
  set_word(all, kImageSizeAt, 0);
  set_word(all, kColorsAt, to.colors);
  return out;
}

}  // namespace envconv
