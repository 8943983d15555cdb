// SPDX-License-Identifier: Apache-2.0
// What reading and writing OpenEXR share.  Internal: not installed.
#pragma once

#include <ImfCompression.h>
#include <ImfTileDescription.h>

#include <algorithm>
#include <bit>
#include <cctype>
#include <cstdint>
#include <exception>
#include <string>

namespace envconv {

/// What OpenEXR calls a stream in its messages.
inline constexpr char kStreamName[] = "the file";

// OpenEXR's messages begin with what it was doing, to which file, and end with the reason.
inline std::string exr_reason(const std::exception& error) {
  std::string text = error.what();
  const std::string name = std::string("\"") + kStreamName + "\". ";
  const std::size_t at = text.rfind(name);
  if (at != std::string::npos) text = text.substr(at + name.size());
  while (!text.empty() && (text.back() == '.' || text.back() == '\n' || text.back() == ' ')) text.pop_back();
  if (!text.empty()) text[0] = static_cast<char>(std::tolower(static_cast<unsigned char>(text[0])));
  return text;
}

/// Compressions by their names on the command line.
struct CompressionName {
  const char* name;
  Imf::Compression value;
};
inline constexpr CompressionName kCompressions[] = {
    {"none", Imf::NO_COMPRESSION},   {"rle", Imf::RLE_COMPRESSION},   {"zip", Imf::ZIP_COMPRESSION},
    {"zips", Imf::ZIPS_COMPRESSION}, {"piz", Imf::PIZ_COMPRESSION},   {"pxr24", Imf::PXR24_COMPRESSION},
    {"b44", Imf::B44_COMPRESSION},   {"b44a", Imf::B44A_COMPRESSION}, {"dwaa", Imf::DWAA_COMPRESSION},
    {"dwab", Imf::DWAB_COMPRESSION},
};

/// Levels of a tiled part, of its data window's size.
inline int level_count(const Imf::TileDescription& tiles, std::int64_t width, std::int64_t height) {
  if (tiles.mode == Imf::ONE_LEVEL) return 1;
  const auto size = static_cast<std::uint64_t>(std::max(width, height));
  const int down = static_cast<int>(std::bit_width(size)) - 1;
  return 1 + down + (tiles.roundingMode == Imf::ROUND_UP && !std::has_single_bit(size) ? 1 : 0);
}

/// A side of a level, of level 0's.
inline std::int64_t reduced(std::int64_t n, int level, Imf::LevelRoundingMode rounding) {
  const std::int64_t up = rounding == Imf::ROUND_UP ? (std::int64_t{1} << level) - 1 : 0;
  return std::max<std::int64_t>(1, (n + up) >> level);
}

}  // namespace envconv
