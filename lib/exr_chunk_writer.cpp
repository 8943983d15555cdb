// SPDX-License-Identifier: Apache-2.0
#include "exr_chunk_writer.h"

#include <ImfChannelList.h>
#include <ImfPartType.h>

#include <bit>
#include <cstring>
#include <span>

#include "exr_chunks.h"
#include "exr_zip.h"
#include "in_order.h"

namespace envconv {
namespace {

static_assert(std::endian::native == std::endian::little);  // as the file

// The blocks of a level, whose size in a file that we write is its image's.
BlockGrid grid_of(const Imf::Header& header, std::int64_t width, std::int64_t height) {
  if (!header.hasTileDescription()) return {width, height, width, chunk_lines(header.compression())};
  const Imf::TileDescription& tiles = header.tileDescription();
  return {width, height, tiles.xSize, tiles.ySize};
}

std::int64_t chunk_count(const Imf::Header& header) {
  const Imath::Box2i& window = header.dataWindow();
  const std::int64_t width = window.max.x - window.min.x + 1, height = window.max.y - window.min.y + 1;
  if (!header.hasTileDescription()) return grid_of(header, width, height).count();
  const Imf::TileDescription& tiles = header.tileDescription();
  std::int64_t count = 0;
  for (int level = 0; level < level_count(tiles, width, height); ++level) {
    count +=
        grid_of(header, reduced(width, level, tiles.roundingMode), reduced(height, level, tiles.roundingMode)).count();
  }
  return count;
}

bool has_long_names(const Imf::Header& header) {
  constexpr std::size_t kShort = 31;
  for (auto it = header.begin(); it != header.end(); ++it) {
    if (std::strlen(it.name()) > kShort || std::strlen(it.attribute().typeName()) > kShort) return true;
  }
  for (auto it = header.channels().begin(); it != header.channels().end(); ++it) {
    if (std::strlen(it.name()) > kShort) return true;
  }
  return false;
}

// What all chunks of a level have in common.
struct Level {
  const Image& image;
  Imf::PixelType type;
  std::vector<std::size_t> channels;  // of the image, in the file's order
  BlockGrid grid;
  int part;  // -1 in a file of one
  int number;
  bool tiled;
  int deflate_level;     // 0: not
  std::int64_t at_once;  // chunks that are packed one after another
};

// Packs chunks, with buffers that are kept.
class ChunkPacker {
 public:
  // Some chunks from that number on.
  void pack(const Level& level, std::int64_t first, ExrCounts& counts) {
    bytes_.clear();
    starts_.clear();
    const std::int64_t end = std::min(first + level.at_once, level.grid.count());
    for (std::int64_t number = first; number < end; ++number) {
      starts_.push_back(bytes_.size());
      const ChunkBlock block = level.grid.block(number);
      gather(level, block, counts);
      const std::span<const std::uint8_t> packed =
          level.deflate_level > 0 ? codec_.pack(chunk_, level.deflate_level) : std::span<const std::uint8_t>(chunk_);
      if (level.part >= 0) put(level.part);
      if (level.tiled) {
        put(block.column), put(block.row), put(level.number), put(level.number);
      } else {
        put(block.y);
      }
      put(static_cast<std::int64_t>(packed.size()));
      bytes_.insert(bytes_.end(), packed.begin(), packed.end());
    }
  }
  std::span<const std::uint8_t> bytes() const { return bytes_; }
  // Of chunks among the bytes.
  std::span<const std::size_t> starts() const { return starts_; }

 private:
  void put(std::int64_t value) {
    const auto number = static_cast<std::int32_t>(value);
    std::uint8_t four[4];
    std::memcpy(four, &number, sizeof four);
    bytes_.insert(bytes_.end(), four, four + 4);
  }

  // The chunk's pixels: lines, each all of a channel and then all of the next.
  void gather(const Level& level, const ChunkBlock& block, ExrCounts& counts) {
    const std::size_t element = size_of(level.type), step = level.channels.size();
    const auto width = static_cast<std::size_t>(block.width);
    chunk_.resize(block.texels() * step * element);
    values_.resize(width * step * element);
    std::uint8_t* to = chunk_.data();
    for (std::int64_t y = block.y; y < block.y + block.height; ++y) {
      // By its row: that is what unmaps pages of an image in scratch storage.
      const float* from = level.image.row(static_cast<int>(y)) + static_cast<std::size_t>(block.x) * step;
      convert_values(from, width * step, level.type, values_.data(), counts);
      const auto* values = level.type == Imf::FLOAT ? reinterpret_cast<const std::uint8_t*>(from) : values_.data();
      for (const std::size_t channel : level.channels) {
        const std::uint8_t* value = values + channel * element;
        if (element == 2) {
          for (std::size_t x = 0; x < width; ++x) std::memcpy(to + 2 * x, value + 2 * x * step, 2);
        } else {
          for (std::size_t x = 0; x < width; ++x) std::memcpy(to + 4 * x, value + 4 * x * step, 4);
        }
        to += width * element;
      }
    }
  }

  ZipCodec codec_;
  std::vector<std::uint8_t> values_, chunk_, bytes_;
  std::vector<std::size_t> starts_;
};

}  // namespace

ChunkWriter::ChunkWriter(OutputFile& file, std::vector<Imf::Header> headers, int level)
    : file_(file), headers_(std::move(headers)), level_(level) {
  const bool several = headers_.size() > 1;
  std::uint8_t head[8] = {0x76, 0x2f, 0x31, 0x01, 2};  // the magic number, the version, and flags
  if (several) head[5] |= 0x10;
  if (!several && headers_[0].hasTileDescription()) head[5] |= 0x02;
  for (const Imf::Header& header : headers_) {
    header.sanityCheck(header.hasTileDescription(), several);
    if (has_long_names(header)) head[5] |= 0x04;
  }
  file_.write(head, sizeof head);
  ExrOutput output(file_);
  std::size_t chunks = 0;
  for (Imf::Header& header : headers_) {
    const std::int64_t count = chunk_count(header);
    if (several) header.setChunkCount(static_cast<int>(count));
    header.writeTo(output);
    chunks += static_cast<std::size_t>(count);
  }
  if (several) file_.write("", 1);
  tables_ = file_.tell();
  offsets_.reserve(chunks);
  // Zeros say that a file was never finished.
  const std::vector<std::uint64_t> none(chunks);
  file_.write(none.data(), chunks * sizeof none[0]);
}

void ChunkWriter::write(std::size_t part, int level, const Image& image, const std::vector<std::string>& names,
                        Imf::PixelType type, ExrCounts& counts) {
  const Imf::Header& header = headers_[part];
  Level what{image, type, {}, grid_of(header, image.width(), image.height()), -1, level, header.hasTileDescription(),
             0,     1};
  for (auto it = header.channels().begin(); it != header.channels().end(); ++it) {
    what.channels.push_back(static_cast<std::size_t>(std::find(names.begin(), names.end(), it.name()) - names.begin()));
  }
  if (headers_.size() > 1) what.part = static_cast<int>(part);
  if (is_zip(header.compression())) what.deflate_level = level_;
  const std::int64_t chunk_values = what.grid.block_width * what.grid.block_height * image.channels();
  what.at_once = std::max<std::int64_t>(1, (std::int64_t{1} << 15) / chunk_values);

  const std::int64_t runs = (what.grid.count() + what.at_once - 1) / what.at_once;
  in_order<ChunkPacker>(
      runs, [&](ChunkPacker& packer, std::int64_t run) { packer.pack(what, run * what.at_once, counts); },
      [&](const ChunkPacker& packer, std::int64_t) {
        for (const std::size_t start : packer.starts()) offsets_.push_back(file_.tell() + start);
        file_.write(packer.bytes().data(), packer.bytes().size());
      });
}

void ChunkWriter::finish() {
  const std::uint64_t end = file_.tell();
  file_.seek(tables_);
  file_.write(offsets_.data(), offsets_.size() * sizeof offsets_[0]);
  file_.seek(end);
}

}  // namespace envconv
