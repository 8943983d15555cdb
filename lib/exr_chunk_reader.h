// SPDX-License-Identifier: Apache-2.0
// Pixels of OpenEXR files from their chunks (OpenEXR's file layout, "Offset tables" and "Chunks"), for the compressions
// that are unpacked here: none, RLE, ZIPS, ZIP and PIZ.  Internal: not installed.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "exr_chunks.h"
#include "exr_piz.h"
#include "exr_zip.h"
#include "io.h"
#include "result.h"

namespace envconv {

/// A channel as chunks have it.
struct ChunkChannel {
  PixelType type = PixelType::half;  ///< half, float32 or uint32
  int target = -1;                   ///< its place among the picture's channels, or -1: not wanted
};

/// The chunks of one level of a part.
struct ChunkGrid : BlockGrid {
  int fd = -1;
  std::uint64_t file_size = 0;
  bool multi_part = false;  ///< chunks begin with the number of their part
  int part = 0;
  bool tiled = false;
  Imf::Compression compression = Imf::NO_COMPRESSION;
  int level = 0;                       ///< of tiles
  std::int64_t top = 0;                ///< y of the data window, by which chunks of lines are named
  std::uint64_t table = 0;             ///< where the offsets of the level's chunks begin
  std::vector<ChunkChannel> channels;  ///< all of the file's, in its order

  /// Bytes of the largest chunk, unpacked; the largest number when it has more than 2^31 texels.
  std::uint64_t largest_chunk() const;
};

/// A picture inside of the level's data window, or a band of its rows.
struct ChunkTarget {
  float* pixels = nullptr;  ///< [height][width][channels]
  int width = 0, height = 0, channels = 0;
  std::int64_t x = 0, y = 0;  ///< its first texel, from the data window's
};

/// Where the offset tables of all parts begin: the end of the headers.  Error: input, where an attribute would reach
/// beyond the end of the file, for which OpenEXR would allocate memory before it found out, and where one is missing
/// that every header must have, in place of which OpenEXR would put its own.
Result<std::uint64_t> find_offset_tables(int fd, std::uint64_t file_size);

/// True when the file is of the kind whose chunks have part numbers.
bool is_multi_part(int fd);

/// True when the file says that some of its parts are deep.
bool holds_deep_data(int fd);

/// The chunks of all levels of a part, as far as is needed to tell whether they are there.
struct PartChunks {
  std::uint64_t count = 0;
  bool tiled = false;
  bool opaque = false;  ///< OpenEXR unpacks them, and takes those of no size for pixels
};

/// Error: input, unless all chunks of all parts are in the file, from the offset tables that begin at `tables`: the
/// pixels that are read may be whole where others of the file were cut off.
Result<Ok> check_chunks(int fd, std::uint64_t file_size, std::uint64_t tables, std::span<const PartChunks> parts);

/// What a thread that reads chunks keeps for the next ones.
struct ChunkBuffers {
  ZipCodec zip;
  PizCodec piz;
  std::vector<PizChannel> planes;
  std::vector<std::uint8_t> packed, bytes;
  std::vector<std::uint16_t> halves;
  std::vector<float> values;
};

/// Reads the chunks that the picture lies in, with a thread for each of `buffers`, of which there is one.  Error:
/// input, for a file that does not have the chunks where and as the table says, the same whatever the number of
/// threads.  May throw std::bad_alloc.
Result<Ok> read_chunks(const ChunkGrid& grid, const ChunkTarget& target, std::vector<ChunkBuffers>& buffers);

}  // namespace envconv
