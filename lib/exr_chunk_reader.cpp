// SPDX-License-Identifier: Apache-2.0
#include "exr_chunk_reader.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstring>
#include <limits>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>

#include "byte_cursor.h"
#include "decoder.h"
#include "exr_piz.h"
#include "exr_zip.h"
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
  ChunkReader(const ChunkGrid& grid, const ChunkTarget& target)
      : grid_(grid), target_(target), texel_(bytes_of_texel(grid)) {}

  Result<Ok> read(std::int64_t number, std::uint64_t offset) {
    const ChunkBlock block = grid_.block(number);
    ENVCONV_TRY(const std::uint64_t size, read_head(block, offset));
    bytes_.resize(static_cast<std::size_t>(texel_) * block.texels());
    const std::uint64_t begin = offset + head_size(grid_.multi_part, grid_.tiled);
    // A chunk that would not get smaller is stored as it is.
    if (size == bytes_.size()) {
      ENVCONV_CHECK(read_at(grid_.fd, begin, bytes_));
    } else {
      if (size > bytes_.size() || grid_.compression == Imf::NO_COMPRESSION)
        return damaged_file("a chunk of another size than its pixels");
      packed_.resize(static_cast<std::size_t>(size));
      ENVCONV_CHECK(read_at(grid_.fd, begin, packed_));
      if (!unpack(block)) return damaged_file("a chunk that does not unpack to its size");
    }
    place(block);
    return Ok{};
  }

 private:
  // packed_ to exactly all of bytes_.
  bool unpack(const ChunkBlock& block) {
    if (grid_.compression == Imf::RLE_COMPRESSION) return zip_.unpack_runs(packed_, bytes_);
    if (grid_.compression != Imf::PIZ_COMPRESSION) return zip_.unpack(packed_, bytes_);
    planes_.clear();
    for (const ChunkChannel& channel : grid_.channels)
      planes_.push_back({static_cast<std::size_t>(block.width), size_of(channel.type) / 2});
    return piz_.unpack(packed_, planes_, static_cast<std::size_t>(block.height), bytes_);
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
    values_.resize(count);
    for (std::int64_t y = top; y < bottom; ++y) {
      const std::uint8_t* line = bytes_.data() + static_cast<std::size_t>((y - block.y) * block.width) * texel_;
      float* row =
          target_.pixels + static_cast<std::size_t>((y - target_.y) * target_.width + (left - target_.x)) * step;
      for (const ChunkChannel& channel : grid_.channels) {
        const std::size_t element = size_of(channel.type);
        if (channel.target >= 0) {
          to_floats(line + static_cast<std::size_t>(left - block.x) * element, channel.type);
          float* to = row + channel.target;
          for (std::size_t i = 0; i < count; ++i) to[i * step] = values_[i];
        }
        line += static_cast<std::size_t>(block.width) * element;
      }
    }
  }

  // To values_, all of it.  Chunks align nothing.
  void to_floats(const std::uint8_t* from, PixelType type) {
    const std::size_t count = values_.size();
    if (type == PixelType::float32) {
      std::memcpy(values_.data(), from, count * 4);
    } else if (type == PixelType::half) {
      halves_.resize(count);
      std::memcpy(halves_.data(), from, count * 2);
      halves_to_floats(halves_.data(), count, values_.data());
    } else {
      for (std::size_t i = 0; i < count; ++i) {
        std::uint32_t value;
        std::memcpy(&value, from + 4 * i, sizeof value);
        values_[i] = static_cast<float>(value);
      }
    }
  }

  const ChunkGrid& grid_;
  const ChunkTarget& target_;
  std::uint64_t texel_;
  ZipCodec zip_;
  PizCodec piz_;
  std::vector<PizChannel> planes_;
  std::vector<std::uint8_t> packed_, bytes_;
  std::vector<std::uint16_t> halves_;
  std::vector<float> values_;
};

// What threads share.
class Queue {
 public:
  Queue(std::int64_t first, std::int64_t end) : next_(first), end_(end) {}

  std::optional<std::int64_t> take() {
    const std::int64_t number = next_++;
    return number < end_ ? std::optional(number) : std::nullopt;
  }
  // Nothing more is taken.  Of several errors the one of the first chunk is told: those before it were taken earlier.
  void fail(std::int64_t number, Error error) {
    const std::lock_guard lock(mutex_);
    next_ = end_;
    if (number >= failed_) return;
    failed_ = number;
    error_ = std::move(error);
  }
  Result<Ok> result() const { return error_ ? Result<Ok>(*error_) : Result<Ok>(Ok{}); }

 private:
  std::atomic<std::int64_t> next_;
  std::int64_t end_;
  std::mutex mutex_;
  std::int64_t failed_ = std::numeric_limits<std::int64_t>::max();
  std::optional<Error> error_;
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

Result<Ok> read_chunks(const ChunkGrid& grid, const ChunkTarget& target, int threads) {
  const std::int64_t first_row = target.y / grid.block_height;
  const std::int64_t end_row = (target.y + target.height - 1) / grid.block_height + 1;
  const std::int64_t first = first_row * grid.columns(), end = end_row * grid.columns();
  std::vector<std::uint64_t> offsets(static_cast<std::size_t>(end - first));
  const std::uint64_t at = grid.table + static_cast<std::uint64_t>(first) * 8;
  if (at > grid.file_size || (grid.file_size - at) / 8 < offsets.size()) return damaged_file("unexpected end of file");
  ENVCONV_CHECK(read_at(grid.fd, at, {reinterpret_cast<std::uint8_t*>(offsets.data()), offsets.size() * 8}));
  Queue queue(first, end);
  const auto work = [&] {
    std::int64_t number = first;
    try {
      ChunkReader reader(grid, target);
      while (const auto taken = queue.take()) {
        number = *taken;
        const auto done = reader.read(number, offsets[static_cast<std::size_t>(number - first)]);
        if (!done) queue.fail(number, done.error());
      }
    } catch (const std::bad_alloc&) {
      queue.fail(number, {ErrorCode::limit, "not enough memory to decode it"});
    }
  };
  std::vector<std::jthread> others;
  try {
    const std::int64_t wanted = std::min<std::int64_t>(threads, end - first) - 1;
    for (std::int64_t i = 0; i < wanted; ++i) others.emplace_back(work);
  } catch (const std::system_error&) {
    // Fewer do as well.
  }
  work();
  others.clear();
  return queue.result();
}

}  // namespace envconv
