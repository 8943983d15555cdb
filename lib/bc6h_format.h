// SPDX-License-Identifier: Apache-2.0
// The BC6H format: modes, bit layouts, partitions and the arithmetic between stored numbers and half bit patterns.
// Source of tables and formulas: Khronos Data Format Specification 1.3, chapter "BPTC Compressed Texture Image
// Formats".
#pragma once

#include <array>
#include <cstdint>

#include "bptc.h"

namespace envconv::bc6h {

inline constexpr int mode_count = 14;
inline constexpr int partition_count = 32;

/// One of the fourteen ways to spend a block's 128 bits.
struct Mode {
  std::uint8_t code;                      ///< the block's first bits
  std::uint8_t code_bits;                 ///< 2 or 5 of them
  std::uint8_t regions;                   ///< 1 or 2 pairs of end points
  std::uint8_t end_bits;                  ///< precision of the end points
  std::array<std::uint8_t, 3> rest_bits;  ///< bits stored of R, G, B of all end points but the first
  bool transformed;                       ///< the others are differences to the first
};
extern const std::array<Mode, mode_count> modes;

/// A block taken apart.
struct Block {
  int mode;       ///< index into modes
  int partition;  ///< 0 where the mode has one region
  /// Region r interpolates from ends[2 r] to ends[2 r + 1]: [end point][R, G, B], each end_bits wide, no longer
  /// differences.
  std::array<std::array<int, 3>, 4> ends;
  std::array<std::uint8_t, 16> index;  ///< by texel, row by row: 0 to 15 with one region, 0 to 7 with two
};

inline constexpr const auto& partition_masks = bptc::masks;  ///< the first partition_count of them
using bptc::interpolate;
using bptc::second_anchor;

/// Weights, in 64ths, of the second end point by index.
inline int weight(int regions, int index) {
  const auto i = static_cast<std::size_t>(index);
  return regions == 1 ? bptc::weights_of_16[i] : bptc::weights_of_8[i];
}

/// Stored end point to what is interpolated: 0 to 65535 unsigned.
inline int unquantize(int value, int bits) {
  if (bits >= 15 || value == 0) return value;
  if (value == (1 << bits) - 1) return 0xFFFF;
  return ((value << 16) + 0x8000) >> bits;
}
/// What is interpolated to an unsigned half's bit pattern, 0 to 0x7BFF (65504).
inline int to_half_bits(int value) { return value * 31 >> 6; }

/// Whether the mode can hold the end points: differences within rest_bits where it is transformed.
bool fits(const Block& block);

/// fits(block), end points within their bits, the anchors' indices without their highest bit.
void pack(const Block& block, std::uint8_t* bytes);
/// False for the reserved modes; the block is untouched then.  Signed end points are sign-extended.
bool unpack(const std::uint8_t* bytes, bool is_signed, Block& block);

/// The sixteen texels' half bit patterns, row by row.
std::array<std::array<std::uint16_t, 3>, 16> decode(const Block& block, bool is_signed);

}  // namespace envconv::bc6h
