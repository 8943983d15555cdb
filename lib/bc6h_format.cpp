// SPDX-License-Identifier: Apache-2.0
#include "bc6h_format.h"

#include <cstring>
#include <string_view>

#include "assertion.h"

namespace envconv::bc6h {

const std::array<Mode, mode_count> modes{{
    {0, 2, 2, 10, {5, 5, 5}, true},
    {1, 2, 2, 7, {6, 6, 6}, true},
    {2, 5, 2, 11, {5, 4, 4}, true},
    {6, 5, 2, 11, {4, 5, 4}, true},
    {10, 5, 2, 11, {4, 4, 5}, true},
    {14, 5, 2, 9, {5, 5, 5}, true},
    {18, 5, 2, 8, {6, 5, 5}, true},
    {22, 5, 2, 8, {5, 6, 5}, true},
    {26, 5, 2, 8, {5, 5, 6}, true},
    {30, 5, 2, 6, {6, 6, 6}, false},
    {3, 5, 1, 10, {10, 10, 10}, false},
    {7, 5, 1, 11, {9, 9, 9}, true},
    {11, 5, 1, 12, {8, 8, 8}, true},
    {15, 5, 1, 16, {4, 4, 4}, true},
}};

namespace {

// Where the bits between a mode's code and its partition go, as the specification writes it: the end point's channel
// and number, then its bits, [high:low] stored lowest first and [low:high] highest first.
constexpr std::array<std::string_view, mode_count> layouts{
    "g2[4] b2[4] b3[4] r0[9:0] g0[9:0] b0[9:0] r1[4:0] g3[4] g2[3:0] g1[4:0] b3[0] g3[3:0] b1[4:0] b3[1] b2[3:0] "
    "r2[4:0] "
    "b3[2] r3[4:0] b3[3]",
    "g2[5] g3[4] g3[5] r0[6:0] b3[0] b3[1] b2[4] g0[6:0] b2[5] b3[2] g2[4] b0[6:0] b3[3] b3[5] b3[4] r1[5:0] g2[3:0] "
    "g1[5:0] g3[3:0] b1[5:0] b2[3:0] r2[5:0] r3[5:0]",
    "r0[9:0] g0[9:0] b0[9:0] r1[4:0] r0[10] g2[3:0] g1[3:0] g0[10] b3[0] g3[3:0] b1[3:0] b0[10] b3[1] b2[3:0] r2[4:0] "
    "b3[2] r3[4:0] b3[3]",
    "r0[9:0] g0[9:0] b0[9:0] r1[3:0] r0[10] g3[4] g2[3:0] g1[4:0] g0[10] g3[3:0] b1[3:0] b0[10] b3[1] b2[3:0] r2[3:0] "
    "b3[0] b3[2] r3[3:0] g2[4] b3[3]",
    "r0[9:0] g0[9:0] b0[9:0] r1[3:0] r0[10] b2[4] g2[3:0] g1[3:0] g0[10] b3[0] g3[3:0] b1[4:0] b0[10] b2[3:0] r2[3:0] "
    "b3[1] b3[2] r3[3:0] b3[4] b3[3]",
    "r0[8:0] b2[4] g0[8:0] g2[4] b0[8:0] b3[4] r1[4:0] g3[4] g2[3:0] g1[4:0] b3[0] g3[3:0] b1[4:0] b3[1] b2[3:0] "
    "r2[4:0] "
    "b3[2] r3[4:0] b3[3]",
    "r0[7:0] g3[4] b2[4] g0[7:0] b3[2] g2[4] b0[7:0] b3[3] b3[4] r1[5:0] g2[3:0] g1[4:0] b3[0] g3[3:0] b1[4:0] b3[1] "
    "b2[3:0] r2[5:0] r3[5:0]",
    "r0[7:0] b3[0] b2[4] g0[7:0] g2[5] g2[4] b0[7:0] g3[5] b3[4] r1[4:0] g3[4] g2[3:0] g1[5:0] g3[3:0] b1[4:0] b3[1] "
    "b2[3:0] r2[4:0] b3[2] r3[4:0] b3[3]",
    "r0[7:0] b3[1] b2[4] g0[7:0] b2[5] g2[4] b0[7:0] b3[5] b3[4] r1[4:0] g3[4] g2[3:0] g1[4:0] b3[0] g3[3:0] b1[5:0] "
    "b2[3:0] r2[4:0] b3[2] r3[4:0] b3[3]",
    "r0[5:0] g3[4] b3[0] b3[1] b2[4] g0[5:0] g2[5] b2[5] b3[2] g2[4] b0[5:0] g3[5] b3[3] b3[5] b3[4] r1[5:0] g2[3:0] "
    "g1[5:0] g3[3:0] b1[5:0] b2[3:0] r2[5:0] r3[5:0]",
    "r0[9:0] g0[9:0] b0[9:0] r1[9:0] g1[9:0] b1[9:0]",
    "r0[9:0] g0[9:0] b0[9:0] r1[8:0] r0[10] g1[8:0] g0[10] b1[8:0] b0[10]",
    "r0[9:0] g0[9:0] b0[9:0] r1[7:0] r0[10:11] g1[7:0] g0[10:11] b1[7:0] b0[10:11]",
    "r0[9:0] g0[9:0] b0[9:0] r1[3:0] r0[10:15] g1[3:0] g0[10:15] b1[3:0] b0[10:15]",
};

// What one bit of the block belongs to.
struct Place {
  std::uint8_t end, channel, bit;
};
struct Places {
  std::array<Place, 77> places{};
  int count = 0;
};

constexpr Places parse(std::string_view text) {
  Places out;
  std::size_t at = 0;
  const auto number = [&] {
    int value = 0;
    for (; text[at] >= '0' && text[at] <= '9'; ++at) value = 10 * value + (text[at] - '0');
    return value;
  };
  while (at < text.size()) {
    const char channel = text[at++];
    const int end = number();
    ++at;  // [
    const int last = number();
    int first = last;
    if (text[at] == ':') {
      ++at;
      first = number();
    }
    at += 2;  // ] and the space
    const int step = first <= last ? 1 : -1;
    for (int bit = first;; bit += step) {
      out.places[static_cast<std::size_t>(out.count++)] = {static_cast<std::uint8_t>(end),
                                                           static_cast<std::uint8_t>(channel == 'r'   ? 0
                                                                                     : channel == 'g' ? 1
                                                                                                      : 2),
                                                           static_cast<std::uint8_t>(bit)};
      if (bit == last) break;
    }
  }
  return out;
}

constexpr std::array<Places, mode_count> parse_all() {
  std::array<Places, mode_count> out;
  for (std::size_t m = 0; m < mode_count; ++m) out[m] = parse(layouts[m]);
  return out;
}
constexpr std::array<Places, mode_count> places = parse_all();

int extend_sign(int value, int bits) {
  const int sign = 1 << (bits - 1);
  return ((value & (2 * sign - 1)) ^ sign) - sign;
}

int index_bits(const Block& block, int regions, int texel) {
  const bool anchor = texel == 0 || (regions == 2 && texel == second_anchor[static_cast<std::size_t>(block.partition)]);
  return (regions == 1 ? 4 : 3) - anchor;
}

int mode_of_code(int code) {
  for (std::size_t m = 0; m < mode_count; ++m)
    if (modes[m].code == code) return static_cast<int>(m);
  return -1;
}

// End points of a transformed mode as they are stored: differences, modulo the precision.
int stored(const Block& block, const Mode& mode, std::size_t end, std::size_t channel) {
  if (!mode.transformed || end == 0) return block.ends[end][channel];
  return extend_sign(block.ends[end][channel] - block.ends[0][channel], mode.end_bits);
}

int unquantize_signed(int value, int bits) {
  if (bits >= 16 || value == 0) return value;
  const int magnitude = value < 0 ? -value : value;
  const int full = magnitude >= (1 << (bits - 1)) - 1 ? 0x7FFF : ((magnitude << 15) + 0x4000) >> (bits - 1);
  return value < 0 ? -full : full;
}

int to_signed_half_bits(int value) { return value < 0 ? 0x8000 | (-value * 31 >> 5) : value * 31 >> 5; }

}  // namespace

bool fits(const Block& block) {
  const Mode& mode = modes[static_cast<std::size_t>(block.mode)];
  if (!mode.transformed) return true;
  for (std::size_t e = 1; e < 2u * mode.regions; ++e)
    for (std::size_t c = 0; c < 3; ++c) {
      const int difference = stored(block, mode, e, c);
      if (difference != extend_sign(difference, mode.rest_bits[c])) return false;
    }
  return true;
}

void pack(const Block& block, std::uint8_t* bytes) {
  ENVCONV_ASSERT(fits(block));
  const Mode& mode = modes[static_cast<std::size_t>(block.mode)];
  bptc::Bits bits;
  bits.put(mode.code, mode.code_bits);
  const Places& layout = places[static_cast<std::size_t>(block.mode)];
  for (std::size_t i = 0; i < static_cast<std::size_t>(layout.count); ++i) {
    const Place p = layout.places[i];
    bits.put(stored(block, mode, p.end, p.channel) >> p.bit, 1);
  }
  if (mode.regions == 2) bits.put(block.partition, 5);
  for (int t = 0; t < 16; ++t) {
    const int index = block.index[static_cast<std::size_t>(t)], count = index_bits(block, mode.regions, t);
    ENVCONV_ASSERT(index < 1 << count);
    bits.put(index, count);
  }
  bits.store(bytes);
}

bool unpack(const std::uint8_t* bytes, bool is_signed, Block& block) {
  bptc::Bits bits(bytes);
  int code = bits.take(2);
  if (code >= 2) code |= bits.take(3) << 2;
  const int m = mode_of_code(code);
  if (m < 0) return false;
  const Mode& mode = modes[static_cast<std::size_t>(m)];
  block = {};
  block.mode = m;
  const Places& layout = places[static_cast<std::size_t>(m)];
  for (std::size_t i = 0; i < static_cast<std::size_t>(layout.count); ++i) {
    const Place p = layout.places[i];
    block.ends[p.end][p.channel] |= bits.take(1) << p.bit;
  }
  for (std::size_t e = 0; e < 2u * mode.regions; ++e)
    for (std::size_t c = 0; c < 3; ++c) {
      int& value = block.ends[e][c];
      if (mode.transformed && e > 0)
        value = (block.ends[0][c] + extend_sign(value, mode.rest_bits[c])) & ((1 << mode.end_bits) - 1);
    }
  if (is_signed)
    for (auto& end : block.ends)
      for (int& value : end) value = extend_sign(value, mode.end_bits);
  if (mode.regions == 2) block.partition = bits.take(5);
  for (int t = 0; t < 16; ++t)
    block.index[static_cast<std::size_t>(t)] = static_cast<std::uint8_t>(bits.take(index_bits(block, mode.regions, t)));
  return true;
}

std::array<std::array<std::uint16_t, 3>, 16> decode(const Block& block, bool is_signed) {
  const Mode& mode = modes[static_cast<std::size_t>(block.mode)];
  const int mask = mode.regions == 2 ? partition_masks[static_cast<std::size_t>(block.partition)] : 0;
  std::array<std::array<std::uint16_t, 3>, 16> out;
  for (std::size_t t = 0; t < 16; ++t) {
    const std::size_t region = static_cast<std::size_t>(mask >> t & 1);
    const int w = weight(mode.regions, block.index[t]);
    for (std::size_t c = 0; c < 3; ++c) {
      const int a = block.ends[2 * region][c], b = block.ends[2 * region + 1][c];
      out[t][c] = static_cast<std::uint16_t>(
          is_signed ? to_signed_half_bits(
                          interpolate(unquantize_signed(a, mode.end_bits), unquantize_signed(b, mode.end_bits), w))
                    : to_half_bits(interpolate(unquantize(a, mode.end_bits), unquantize(b, mode.end_bits), w)));
    }
  }
  return out;
}

}  // namespace envconv::bc6h
