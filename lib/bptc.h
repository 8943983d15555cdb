// SPDX-License-Identifier: Apache-2.0
// What BC6H and BC7 share: partitions of a block's texels, interpolation, bits.  Source: Khronos Data Format
// Specification, "BPTC compressed texture image formats".  Internal: not installed.
#pragma once

#include <array>
#include <cstdint>

namespace envconv::bptc {

/// Bit t of masks[p] is the region of texel t in partition p of two regions.  BC6H has the first 32.
inline constexpr std::array<std::uint16_t, 64> masks{
    0xCCCC, 0x8888, 0xEEEE, 0xECC8, 0xC880, 0xFEEC, 0xFEC8, 0xEC80, 0xC800, 0xFFEC, 0xFE80, 0xE800, 0xFFE8,
    0xFF00, 0xFFF0, 0xF000, 0xF710, 0x008E, 0x7100, 0x08CE, 0x008C, 0x7310, 0x3100, 0x8CCE, 0x088C, 0x3110,
    0x6666, 0x366C, 0x17E8, 0x0FF0, 0x718E, 0x399C, 0xAAAA, 0xF0F0, 0x5A5A, 0x33CC, 0x3C3C, 0x55AA, 0x9696,
    0xA55A, 0x73CE, 0x13C8, 0x324C, 0x3BDC, 0x6996, 0xC33C, 0x9966, 0x0660, 0x0272, 0x04E4, 0x4E40, 0x2720,
    0xC936, 0x936C, 0x39C6, 0x639C, 0x9336, 0x9CC6, 0x817E, 0xE718, 0xCCF0, 0x0FCC, 0x7744, 0xEE22};

/// The texel of region 1 whose index lacks its highest bit (that of region 0 is texel 0).
inline constexpr std::array<std::uint8_t, 64> second_anchor{
    15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 2,  8, 2, 2, 8,
    8,  15, 2,  8,  2,  2,  8,  8,  2,  2,  15, 15, 6,  8,  2,  8,  15, 15, 2, 8, 2, 2,
    2,  15, 15, 6,  6,  2,  6,  8,  15, 15, 2,  2,  15, 15, 15, 15, 15, 2,  2, 15};

/// Weights, in 64ths, of the second end point by index of 2, 3 and 4 bits.
inline constexpr std::array<std::uint8_t, 4> weights_of_4{0, 21, 43, 64};
inline constexpr std::array<std::uint8_t, 8> weights_of_8{0, 9, 18, 27, 37, 46, 55, 64};
inline constexpr std::array<std::uint8_t, 16> weights_of_16{0,  4,  9,  13, 17, 21, 26, 30,
                                                            34, 38, 43, 47, 51, 55, 60, 64};
inline constexpr int interpolate(int a, int b, int weight) { return (a * (64 - weight) + b * weight + 32) >> 6; }

/// The 128 bits of a block, taken or put lowest first.
class Bits {
 public:
  Bits() = default;
  explicit Bits(const std::uint8_t* bytes) {
    for (int i = 15; i >= 0; --i) word_[i / 8] = word_[i / 8] << 8 | bytes[i];
  }
  void store(std::uint8_t* bytes) const {
    for (int i = 0; i < 16; ++i) bytes[i] = static_cast<std::uint8_t>(word_[i / 8] >> 8 * (i % 8));
  }
  int take(int count) {
    int value = 0;
    for (int i = 0; i < count; ++i, ++at_) value |= static_cast<int>(word_[at_ >> 6] >> (at_ & 63) & 1) << i;
    return value;
  }
  void put(int value, int count) {
    for (int i = 0; i < count; ++i, ++at_) word_[at_ >> 6] |= static_cast<std::uint64_t>(value >> i & 1) << (at_ & 63);
  }

 private:
  std::uint64_t word_[2] = {0, 0};
  int at_ = 0;
};

}  // namespace envconv::bptc
