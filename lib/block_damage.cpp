// SPDX-License-Identifier: Apache-2.0
#include "block_damage.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "byte_cursor.h"

namespace envconv {
namespace {

// --- GIF

// Pieces of up to 255 bytes, each after its size, and an empty one.
Result<Ok> skip_pieces(ByteCursor& cursor) {
  for (;;) {
    ENVCONV_TRY(const std::uint8_t size, cursor.byte());
    if (size == 0) return Ok{};
    ENVCONV_CHECK(cursor.skip(size));
  }
}

// What a byte of flags says of the colours that follow.
std::uint64_t bytes_of_colors(std::uint8_t flags) { return (flags & 0x80) != 0 ? 3u << ((flags & 7) + 1) : 0; }

// --- Targa

struct Targa {
  std::uint64_t pixels_at, pixels, bytes_of_pixel;
  bool runs;
};

Result<Targa> read_targa_header(ByteCursor& cursor) {
  std::array<std::uint8_t, 18> h{};
  for (std::uint8_t& b : h) {
    ENVCONV_TRY(b, cursor.byte());
  }
  const auto word = [&](std::size_t at) { return h[at] + 256u * h[at + 1]; };
  const std::uint64_t colors = h[1] == 1 ? std::uint64_t{word(5)} * ((h[7] + 7u) / 8) : 0;
  return Targa{18 + h[0] + colors, std::uint64_t{word(12)} * word(14), (h[16] + 7u) / 8, h[2] >= 8};
}

Result<Ok> skip_runs(ByteCursor& cursor, const Targa& targa) {
  for (std::uint64_t left = targa.pixels; left > 0;) {
    ENVCONV_TRY(const std::uint8_t code, cursor.byte());
    const std::uint64_t count = (code & 127u) + 1;
    if (count > left) return damaged_file("its run-length encoded pixels are more than its header says");
    ENVCONV_CHECK(cursor.skip((code & 128) != 0 ? targa.bytes_of_pixel : count * targa.bytes_of_pixel));
    left -= count;
  }
  return Ok{};
}

// --- SGI

// Values of `bytes` bytes each, as run-length codes that a zero ends.
Result<Ok> check_sgi_row(ByteCursor cursor, int bytes, std::uint64_t width) {
  for (std::uint64_t left = width;;) {
    ENVCONV_TRY(const std::uint64_t code, cursor.big(bytes));
    const std::uint64_t count = code & 127;
    if (count == 0 && left == 0) return Ok{};
    if (count == 0 || count > left) return damaged_file("a row that does not unpack to the width");
    ENVCONV_CHECK(cursor.skip(static_cast<std::uint64_t>(bytes) * ((code & 128) != 0 ? count : 1)));
    left -= count;
  }
}

// --- JPEG 2000

constexpr std::uint64_t kStart = 0xFF4F, kTilePart = 0xFF90, kEnd = 0xFFD9;
constexpr std::uint64_t kLastBare = 0xFF3F;  // of the markers without content, which stand nowhere here

// To the codestream of a JP2 file; where it ends.
Result<std::uint64_t> skip_boxes(ByteCursor& cursor, std::uint64_t file_size) {
  constexpr std::uint64_t codestream = 0x6A703263;  // jp2c
  for (;;) {
    const std::uint64_t start = cursor.position();
    ENVCONV_TRY(std::uint64_t size, cursor.big(4));
    ENVCONV_TRY(const std::uint64_t type, cursor.big(4));
    if (size == 1) {
      ENVCONV_TRY(size, cursor.big(8));
    }
    if (size == 0) size = file_size - start;  // the last one
    const std::uint64_t head = cursor.position() - start;
    if (size < head || size > file_size - start) return damaged_file("a box that ends behind the file");
    if (type == codestream) return start + size;
    ENVCONV_CHECK(cursor.skip(size - head));
  }
}

}  // namespace

Result<Ok> check_gif(int fd) {
  constexpr std::uint64_t flags_at = 10;
  constexpr std::uint8_t extension = 0x21, image = 0x2C, trailer = 0x3B;
  ENVCONV_TRY(const std::uint64_t size, size_of_file(fd));
  ByteCursor cursor(fd, size, flags_at);
  ENVCONV_TRY(const std::uint8_t screen, cursor.byte());
  ENVCONV_CHECK(cursor.skip(2 + bytes_of_colors(screen)));
  for (;;) {
    ENVCONV_TRY(const std::uint8_t block, cursor.byte());
    if (block == trailer) return Ok{};
    if (block == image) {
      ENVCONV_CHECK(cursor.skip(8));  // place and size
      ENVCONV_TRY(const std::uint8_t flags, cursor.byte());
      ENVCONV_CHECK(cursor.skip(bytes_of_colors(flags)));
    } else if (block != extension) {
      return damaged_file("a block of unknown kind");
    }
    ENVCONV_CHECK(cursor.skip(1));  // the least bits of a code, or what the extension is
    ENVCONV_CHECK(skip_pieces(cursor));
  }
}

Result<Ok> check_targa(int fd) {
  constexpr std::string_view mark{"TRUEVISION-XFILE.\0", 18};
  ENVCONV_TRY(const std::uint64_t size, size_of_file(fd));
  ByteCursor cursor(fd, size, 0);
  ENVCONV_TRY(const Targa targa, read_targa_header(cursor));
  ENVCONV_CHECK(cursor.skip(targa.pixels_at - cursor.position()));
  if (targa.runs) {
    ENVCONV_CHECK(skip_runs(cursor, targa));
  } else {
    ENVCONV_CHECK(cursor.skip(targa.pixels * targa.bytes_of_pixel));
  }
  if (cursor.left() == 0) return Ok{};
  if (cursor.left() >= mark.size()) {
    std::array<std::uint8_t, mark.size()> last{};
    ENVCONV_CHECK(read_at(fd, size - last.size(), last));
    if (std::ranges::equal(last, mark, {}, {}, [](char c) { return static_cast<std::uint8_t>(c); })) return Ok{};
  }
  return damaged_file("it goes on behind its last row, and has no footer");
}

Result<Ok> check_bmp(int fd) {
  constexpr std::uint64_t file_header = 14, core = 12, info = 40, with_profile = 124;
  enum Compression : std::uint64_t { kNone, kRuns8, kRuns4, kMasks, kAlphaMasks = 6 };
  ENVCONV_TRY(const std::uint64_t size, size_of_file(fd));
  ByteCursor cursor(fd, size, 10);
  ENVCONV_TRY(const std::uint64_t pixels_at, cursor.little(4));
  ENVCONV_TRY(const std::uint64_t header, cursor.little(4));
  if (header < info) {  // OS/2's
    return header == core ? Result<Ok>(Ok{}) : Result<Ok>(damaged_file("a header of unknown kind"));
  }
  ENVCONV_TRY(const std::uint64_t width, cursor.little(4));
  ENVCONV_TRY(const std::uint64_t height, cursor.little(4));
  ENVCONV_CHECK(cursor.skip(2));
  ENVCONV_TRY(const std::uint64_t bits, cursor.little(2));
  ENVCONV_TRY(const std::uint64_t compression, cursor.little(4));
  ENVCONV_CHECK(cursor.skip(12));
  ENVCONV_TRY(const std::uint64_t colors, cursor.little(4));
  const bool masks = compression == kMasks || compression == kAlphaMasks;
  if (compression == kRuns8 || compression == kRuns4) return Ok{};  // unpacked and checked elsewhere
  if (compression != kNone && !masks) return damaged_file("of unknown compression " + std::to_string(compression));
  const std::uint64_t palette = bits <= 8 ? 4 * (colors == 0 ? 1u << bits : std::min<std::uint64_t>(colors, 256)) : 0;
  const std::uint64_t behind = masks && header == info ? 12 : 0;
  if (pixels_at < file_header + header + behind + palette) return damaged_file("its pixels lie in its header");
  // A negative height has the rows from the top.
  const std::uint64_t rows = height >> 31 != 0 ? (std::uint64_t{1} << 32) - height : height;
  const std::uint64_t row = (width * bits + 31) / 32 * 4;
  if (pixels_at > size || row == 0 || (size - pixels_at) / row < rows) return damaged_file("unexpected end of file");
  if (header < with_profile && (size - pixels_at) / row > rows) return damaged_file("it goes on behind its last row");
  return Ok{};
}

Result<Ok> check_sgi(int fd) {
  constexpr std::uint64_t header = 512;
  ENVCONV_TRY(const std::uint64_t size, size_of_file(fd));
  ByteCursor cursor(fd, size, 2);
  ENVCONV_TRY(const std::uint8_t storage, cursor.byte());
  ENVCONV_TRY(const int bytes, cursor.byte());
  ENVCONV_TRY(const std::uint64_t dimension, cursor.big(2));
  ENVCONV_TRY(const std::uint64_t width, cursor.big(2));
  ENVCONV_TRY(const std::uint64_t height, cursor.big(2));
  ENVCONV_TRY(const std::uint64_t channels, cursor.big(2));
  if (storage > 1 || bytes < 1 || bytes > 2 || dimension < 1 || dimension > 3)
    return damaged_file("its header makes no sense");
  const std::uint64_t rows = (dimension > 1 ? height : 1) * (dimension > 2 ? channels : 1);
  ENVCONV_CHECK(cursor.skip(header - cursor.position()));
  if (storage == 0) {
    ENVCONV_CHECK(cursor.skip(rows * width * static_cast<std::uint64_t>(bytes)));
    return Ok{};
  }
  // Where all rows begin, and then how long they are.
  ByteCursor lengths(fd, size, std::min(size, header + 4 * rows));
  for (std::uint64_t row = 0; row < rows; ++row) {
    ENVCONV_TRY(const std::uint64_t start, cursor.big(4));
    ENVCONV_TRY(const std::uint64_t length, lengths.big(4));
    if (start < header + 8 * rows || start > size || length > size - start)
      return damaged_file("a row outside of the file");
    ENVCONV_CHECK(check_sgi_row(ByteCursor(fd, start + length, start), bytes, width));
  }
  return Ok{};
}

Result<Ok> check_jpeg2000(int fd) {
  ENVCONV_TRY(const std::uint64_t size, size_of_file(fd));
  ByteCursor cursor(fd, size, 0);
  ENVCONV_TRY(const std::uint64_t first, ByteCursor(fd, size, 0).big(2));
  std::uint64_t end = size;
  if (first != kStart) {
    ENVCONV_TRY(end, skip_boxes(cursor, size));
  }
  ENVCONV_TRY(std::uint64_t marker, cursor.big(2));
  if (marker != kStart) return damaged_file("it has no codestream");
  for (;;) {
    const std::uint64_t start = cursor.position();
    ENVCONV_TRY(marker, cursor.big(2));
    if (cursor.position() > end) return damaged_file("its codestream breaks off");
    if (marker == kEnd) return Ok{};
    if (marker <= kLastBare) return damaged_file("no marker where one must be");
    ENVCONV_TRY(const std::uint64_t length, cursor.big(2));
    if (length < 2) return damaged_file("a marker of no length");
    if (marker != kTilePart) {
      ENVCONV_CHECK(cursor.skip(length - 2));
      continue;
    }
    ENVCONV_CHECK(cursor.skip(2));  // which tile
    ENVCONV_TRY(std::uint64_t part, cursor.big(4));
    if (part == 0) part = end - std::min(end, start + 2);  // up to the end's marker
    if (part < 14 || part > end - start) return damaged_file("a tile-part that ends behind the codestream");
    ENVCONV_CHECK(cursor.skip(start + part - cursor.position()));
  }
}

}  // namespace envconv
