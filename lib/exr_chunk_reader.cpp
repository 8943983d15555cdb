// SPDX-License-Identifier: Apache-2.0
#include "exr_chunk_reader.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "byte_cursor.h"
#include "decode_blocks.h"
#include "decoder.h"
#include "file_bytes.h"
#include "output_file.h"
#include "row_kernels.h"

namespace envconv {
namespace {

static_assert(std::endian::native == std::endian::little);  // as the file

std::int32_t int_at(const std::uint8_t* bytes) {
  std::int32_t value;
  std::memcpy(&value, bytes, sizeof value);
  return value;
}

constexpr std::uint64_t kFirstHeader = 8;  // after the magic number and the version

// What every header must have ("Header attributes"): OpenEXR puts its own for those that are missing.
constexpr std::array<std::string_view, 8> kRequired{"channels",           "compression",      "dataWindow",
                                                    "displayWindow",      "lineOrder",        "pixelAspectRatio",
                                                    "screenWindowCenter", "screenWindowWidth"};

// Of the value of "channels": names, and 16 bytes for each.  OpenEXR takes a name that comes twice for one channel.
Result<Ok> check_channels(ByteCursor cursor) {
  std::set<std::string> names;
  for (;;) {
    ENVCONV_TRY(std::string name, cursor.text());
    if (name.empty()) return Ok{};
    ENVCONV_CHECK(cursor.skip(16));
    const auto [place, is_new] = names.insert(std::move(name));
    if (!is_new) return damaged_file("it has channel " + printable(*place) + " twice");
  }
}

// After the last attribute, whose names are given.
Result<Ok> check_header(const std::vector<std::string>& names) {
  for (const std::string_view required : kRequired) {
    if (std::ranges::find(names, required) == names.end())
      return damaged_file("its header has no " + std::string(required));
  }
  return Ok{};
}

// In the second byte of the version.
bool has_flag(int fd, int flag) {
  std::uint8_t version[4] = {};
  return read_at(fd, 4, version).ok() && (version[1] & flag) != 0;
}

// Bytes before a chunk's pixels, of which the last four are their size.
std::size_t head_size(bool multi_part, bool tiled) { return (multi_part ? 4u : 0u) + (tiled ? 20u : 8u); }

std::uint64_t bytes_of_texel(const ChunkGrid& grid) {
  std::uint64_t bytes = 0;
  for (const ChunkChannel& channel : grid.channels) bytes += size_of(channel.type);
  return bytes;
}

// Reads chunks one at a time.  One thread's.
class ChunkReader {
 public:
  ChunkReader(const ChunkGrid& grid, const ChunkTarget& target, ChunkBuffers& buffers)
      : grid_(grid), target_(target), buffers_(buffers), texel_(bytes_of_texel(grid)) {}

  Result<Ok> read(std::int64_t number, std::uint64_t offset) {
    const ChunkBlock block = grid_.block(number);
    ENVCONV_TRY(const std::uint64_t size, read_head(block, offset));
    buffers_.bytes.resize(static_cast<std::size_t>(texel_) * block.texels());
    const std::uint64_t begin = offset + head_size(grid_.multi_part, grid_.tiled);
    // A chunk that would not get smaller is stored as it is.
    if (size == buffers_.bytes.size()) {
      ENVCONV_CHECK(read_at(grid_.fd, begin, buffers_.bytes));
    } else {
      if (size > buffers_.bytes.size() || grid_.compression == Imf::NO_COMPRESSION)
        return damaged_file("a chunk of another size than its pixels");
      buffers_.packed.resize(static_cast<std::size_t>(size));
      ENVCONV_CHECK(read_at(grid_.fd, begin, buffers_.packed));
      if (!unpack(block)) return damaged_file("a chunk that does not unpack to its size");
    }
    place(block);
    return Ok{};
  }

 private:
  // What is packed, to exactly all of a chunk's bytes.
  bool unpack(const ChunkBlock& block) {
    if (grid_.compression == Imf::RLE_COMPRESSION) return buffers_.zip.unpack_runs(buffers_.packed, buffers_.bytes);
    if (grid_.compression != Imf::PIZ_COMPRESSION) return buffers_.zip.unpack(buffers_.packed, buffers_.bytes);
    buffers_.planes.clear();
    for (const ChunkChannel& channel : grid_.channels)
      buffers_.planes.push_back({static_cast<std::size_t>(block.width), size_of(channel.type) / 2});
    return buffers_.piz.unpack(buffers_.packed, buffers_.planes, static_cast<std::size_t>(block.height),
                               buffers_.bytes);
  }

  // Bytes of pixels that the chunk at that offset claims, once it is the one that is meant.
  Result<std::uint64_t> read_head(const ChunkBlock& block, std::uint64_t offset) {
    std::uint8_t head[24];
    const std::size_t count = head_size(grid_.multi_part, grid_.tiled);
    if (offset < kFirstHeader || offset >= grid_.file_size) return damaged_file("a chunk outside of the file");
    ENVCONV_CHECK(read_at(grid_.fd, offset, std::span(head).first(count)));
    const std::uint8_t* at = head;
    const auto next = [&at] { return int_at(std::exchange(at, at + 4)); };
    bool right = !grid_.multi_part || next() == grid_.part;
    if (grid_.tiled) {
      right = next() == block.column && right;
      right = next() == block.row && right;
      right = next() == grid_.level && right;
      right = next() == grid_.level && right;
    } else {
      right = next() == grid_.top + block.y && right;
    }
    if (!right) return damaged_file("a chunk that is not where the offset table says");
    const std::int32_t size = next();
    if (size < 0) return damaged_file("a chunk of negative size");
    return static_cast<std::uint64_t>(size);
  }

  // Texels of the chunk that are the picture's.  A chunk is lines, each all of a channel and then all of the next.
  void place(const ChunkBlock& block) {
    const std::int64_t left = std::max(block.x, target_.x),
                       right = std::min(block.x + block.width, target_.x + target_.width);
    const std::int64_t top = std::max(block.y, target_.y),
                       bottom = std::min(block.y + block.height, target_.y + target_.height);
    if (left >= right) return;
    const auto count = static_cast<std::size_t>(right - left), step = static_cast<std::size_t>(target_.channels);
    buffers_.values.resize(count);
    for (std::int64_t y = top; y < bottom; ++y) {
      const std::uint8_t* line = buffers_.bytes.data() + static_cast<std::size_t>((y - block.y) * block.width) * texel_;
      float* row =
          target_.pixels + static_cast<std::size_t>((y - target_.y) * target_.width + (left - target_.x)) * step;
      for (const ChunkChannel& channel : grid_.channels) {
        const std::size_t element = size_of(channel.type);
        if (channel.target >= 0) {
          to_floats(line + static_cast<std::size_t>(left - block.x) * element, channel.type);
          float* to = row + channel.target;
          const float* values = buffers_.values.data();
          for (std::size_t i = 0; i < count; ++i) to[i * step] = values[i];
        }
        line += static_cast<std::size_t>(block.width) * element;
      }
    }
  }

  // To the buffer of values, all of it.  Chunks align nothing.
  void to_floats(const std::uint8_t* from, PixelType type) {
    const std::size_t count = buffers_.values.size();
    if (type == PixelType::float32) {
      std::memcpy(buffers_.values.data(), from, count * 4);
    } else if (type == PixelType::half) {
      buffers_.halves.resize(count);
      std::memcpy(buffers_.halves.data(), from, count * 2);
      halves_to_floats(buffers_.halves.data(), count, buffers_.values.data());
    } else {
      for (std::size_t i = 0; i < count; ++i) {
        std::uint32_t value;
        std::memcpy(&value, from + 4 * i, sizeof value);
        buffers_.values[i] = static_cast<float>(value);
      }
    }
  }

  const ChunkGrid& grid_;
  const ChunkTarget& target_;
  ChunkBuffers& buffers_;
  std::uint64_t texel_;
};

}  // namespace

std::uint64_t ChunkGrid::largest_chunk() const {
  const std::uint64_t texels = block(0).texels();
  if (texels > std::uint64_t{1} << 31) return std::numeric_limits<std::uint64_t>::max();
  return texels * bytes_of_texel(*this);
}

bool is_multi_part(int fd) { return has_flag(fd, 0x10); }

bool holds_deep_data(int fd) { return has_flag(fd, 0x08); }

Result<std::uint64_t> find_offset_tables(int fd, std::uint64_t file_size) {
  const bool several = is_multi_part(fd);
  ByteCursor cursor(fd, file_size, kFirstHeader);
  for (;;) {
    // A header: name, type, size and value of each attribute, and an empty name.
    std::vector<std::string> names;
    for (;;) {
      ENVCONV_TRY(std::string name, cursor.text());
      if (name.empty()) {
        if (names.empty() && several) return cursor.position();  // no header more
        ENVCONV_CHECK(check_header(names));
        if (!several) return cursor.position();
        break;
      }
      names.push_back(std::move(name));
      ENVCONV_CHECK(cursor.text());
      ENVCONV_TRY(const std::uint64_t size, cursor.little(4));
      if (size >> 31 != 0) return damaged_file("an attribute of negative size");
      if (names.back() == "channels") ENVCONV_CHECK(check_channels(cursor));
      ENVCONV_CHECK(cursor.skip(size));
    }
  }
}

Result<Ok> check_chunks(int fd, std::uint64_t file_size, std::uint64_t tables, std::span<const PartChunks> parts) {
  constexpr std::uint64_t most = 8192;  // offsets at a time
  std::vector<std::uint64_t> offsets;
  std::uint64_t last = 0;
  bool last_tiled = false;
  const bool several = is_multi_part(fd);
  const auto check_size = [&](std::uint64_t offset, bool tiled) -> Result<Ok> {
    std::uint8_t head[24];
    const std::size_t count = head_size(several, tiled);
    ENVCONV_CHECK(read_at(fd, offset, std::span(head).first(count)));
    const std::int32_t size = int_at(head + count - 4);
    if (size <= 0) return damaged_file("a chunk of no size");
    if (static_cast<std::uint64_t>(size) > file_size - offset - count) return damaged_file("unexpected end of file");
    return Ok{};
  };
  for (const PartChunks& part : parts) {
    for (std::uint64_t left = part.count; left > 0; left -= offsets.size()) {
      offsets.resize(static_cast<std::size_t>(std::min(left, most)));
      ENVCONV_CHECK(read_at(fd, tables, {reinterpret_cast<std::uint8_t*>(offsets.data()), offsets.size() * 8}));
      tables += offsets.size() * 8;
      for (const std::uint64_t offset : offsets) {
        if (offset == 0) return damaged_file("it was never finished");
        if (offset < kFirstHeader || offset >= file_size) return damaged_file("a chunk outside of the file");
        if (part.opaque) ENVCONV_CHECK(check_size(offset, part.tiled));
        if (offset > last) last = offset, last_tiled = part.tiled;
      }
    }
  }
  if (last == 0) return damaged_file("it has no pixels");
  // What comes after the one chunk would have been cut off first.
  return check_size(last, last_tiled);
}

Result<Ok> read_chunks(const ChunkGrid& grid, const ChunkTarget& target, std::vector<ChunkBuffers>& buffers) {
  const std::int64_t first_row = target.y / grid.block_height;
  const std::int64_t end_row = (target.y + target.height - 1) / grid.block_height + 1;
  const std::int64_t first = first_row * grid.columns(), end = end_row * grid.columns();
  std::vector<std::uint64_t> offsets(static_cast<std::size_t>(end - first));
  const std::uint64_t at = grid.table + static_cast<std::uint64_t>(first) * 8;
  if (at > grid.file_size || (grid.file_size - at) / 8 < offsets.size()) return damaged_file("unexpected end of file");
  ENVCONV_CHECK(read_at(grid.fd, at, {reinterpret_cast<std::uint8_t*>(offsets.data()), offsets.size() * 8}));
  return decode_blocks(first, end, static_cast<int>(buffers.size()), [&](int thread, std::int64_t number) {
    ChunkReader reader(grid, target, buffers[static_cast<std::size_t>(thread)]);
    return reader.read(number, offsets[static_cast<std::size_t>(number - first)]);
  });
}

}  // namespace envconv
