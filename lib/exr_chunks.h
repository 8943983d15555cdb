// SPDX-License-Identifier: Apache-2.0
// How OpenEXR cuts a level into chunks (OpenEXR's file layout, "Chunks").  Internal: not installed.
#pragma once

#include <ImfCompression.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace envconv {

/// What a chunk holds, in texels from the corner of the level's data window.
struct ChunkBlock {
  std::int64_t column, row, x, y, width, height;
  std::size_t texels() const { return static_cast<std::size_t>(width * height); }
};

/// A level's blocks: tiles, or lines as wide as it is, row by row from the top, as in the offset table.
struct BlockGrid {
  std::int64_t width = 0, height = 0;
  std::int64_t block_width = 0, block_height = 0;  ///< at least 1; a last block has what is left

  std::int64_t columns() const { return (width + block_width - 1) / block_width; }
  std::int64_t rows() const { return (height + block_height - 1) / block_height; }
  std::int64_t count() const { return columns() * rows(); }
  ChunkBlock block(std::int64_t number) const {
    const std::int64_t column = number % columns(), row = number / columns();
    const std::int64_t x = column * block_width, y = row * block_height;
    return {column, row, x, y, std::min(block_width, width - x), std::min(block_height, height - y)};
  }
};

/// Deflated.
inline bool is_zip(Imf::Compression compression) {
  return compression == Imf::ZIP_COMPRESSION || compression == Imf::ZIPS_COMPRESSION;
}
/// The compressions whose chunks are made here, and not by OpenEXR.
inline bool chunks_are_ours(Imf::Compression compression) {
  return is_zip(compression) || compression == Imf::NO_COMPRESSION;
}
/// Those whose chunks are unpacked here: OpenEXR's decoders of RLE and PIZ do not see that pixels are missing.
inline bool chunks_are_unpacked_here(Imf::Compression compression) {
  return chunks_are_ours(compression) || compression == Imf::RLE_COMPRESSION || compression == Imf::PIZ_COMPRESSION;
}
/// Lines of a chunk.
inline std::int64_t chunk_lines(Imf::Compression compression) {
  switch (compression) {
    case Imf::ZIP_COMPRESSION:
    case Imf::PXR24_COMPRESSION: return 16;
    case Imf::PIZ_COMPRESSION:
    case Imf::B44_COMPRESSION:
    case Imf::B44A_COMPRESSION:
    case Imf::DWAA_COMPRESSION: return 32;
    case Imf::DWAB_COMPRESSION: return 256;
    default: return 1;
  }
}

}  // namespace envconv
