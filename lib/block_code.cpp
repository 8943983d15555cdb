// SPDX-License-Identifier: Apache-2.0
#include "block_code.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>

#include "bptc.h"

namespace envconv {
namespace {

// [texel][channel]
using Texels = std::array<std::array<std::uint8_t, 4>, 16>;
using SignedTexels = std::array<std::array<float, 2>, 16>;

std::uint64_t number(const std::uint8_t* bytes, int count) {
  std::uint64_t value = 0;
  for (int i = count; i-- > 0;) value = value << 8 | bytes[i];
  return value;
}

// --- BC1 to BC5 ----------------------------------------------------------------------------------------------------

constexpr int rounded(int numerator, int denominator) { return (numerator + denominator / 2) / denominator; }

struct Colour {
  int r, g, b;
};

Colour colour_of(std::uint64_t code) {
  const auto part = [&](int shift, int most) {
    return rounded(static_cast<int>(code >> shift & static_cast<unsigned>(most)) * 255, most);
  };
  return {part(11, 31), part(5, 63), part(0, 31)};
}

Colour between(const Colour& a, const Colour& b, int of_a, int of_b) {
  const auto mix = [&](int x, int y) { return rounded(of_a * x + of_b * y, of_a + of_b); };
  return {mix(a.r, b.r), mix(a.g, b.g), mix(a.b, b.b)};
}

// Two colours and two between them; or in BC1, where the first is not the larger one, one between them and black
// without alpha.
void decode_colours(const std::uint8_t* block, bool has_three, Texels& texels) {
  const std::uint64_t first = number(block, 2), second = number(block + 2, 2), indices = number(block + 4, 4);
  const bool three = has_three && first <= second;
  const Colour a = colour_of(first), b = colour_of(second);
  const Colour palette[4] = {a, b, three ? between(a, b, 1, 1) : between(a, b, 2, 1),
                             three ? Colour{0, 0, 0} : between(a, b, 1, 2)};
  for (std::size_t t = 0; t < 16; ++t) {
    const std::size_t index = indices >> 2 * t & 3;
    const Colour& c = palette[index];
    texels[t] = {static_cast<std::uint8_t>(c.r), static_cast<std::uint8_t>(c.g), static_cast<std::uint8_t>(c.b),
                 static_cast<std::uint8_t>(three && index == 3 ? 0 : 255)};
  }
}

// Two values and six between them; or, where the first is not the larger one, four and the range's ends.  Calls
// set(texel, numerator, denominator): the value is their ratio, of the codes of 8 bits.
template <class F>
void decode_ramp(const std::uint8_t* block, int first, int second, int lowest, int highest, F&& set) {
  const std::uint64_t indices = number(block + 2, 6);
  const int parts = first > second ? 7 : 5;
  for (std::size_t t = 0; t < 16; ++t) {
    const int index = static_cast<int>(indices >> 3 * t & 7);
    if (index == 0)
      set(t, first, 1);
    else if (index == 1)
      set(t, second, 1);
    else if (index <= parts)
      set(t, (parts + 1 - index) * first + (index - 1) * second, parts);
    else
      set(t, index == 6 ? lowest : highest, 1);
  }
}

void decode_ramp(const std::uint8_t* block, std::size_t channel, Texels& texels) {
  decode_ramp(block, block[0], block[1], 0, 255, [&](std::size_t t, int numerator, int denominator) {
    texels[t][channel] = static_cast<std::uint8_t>(rounded(numerator, denominator));
  });
}

void decode_signed_ramp(const std::uint8_t* block, std::size_t channel, SignedTexels& texels) {
  const auto end = [](std::uint8_t code) { return std::max<int>(std::bit_cast<std::int8_t>(code), -127); };
  decode_ramp(block, end(block[0]), end(block[1]), -127, 127, [&](std::size_t t, int numerator, int denominator) {
    texels[t][channel] = static_cast<float>(numerator) / static_cast<float>(127 * denominator);
  });
}

void decode_alpha_of_4_bits(const std::uint8_t* block, Texels& texels) {
  const std::uint64_t bits = number(block, 8);
  for (std::size_t t = 0; t < 16; ++t) texels[t][3] = static_cast<std::uint8_t>((bits >> 4 * t & 15) * 17);
}

// --- BC7 -----------------------------------------------------------------------------------------------------------

struct Mode {
  int regions, partition_bits, rotation_bits, selection_bits, colour_bits, alpha_bits;
  int shared_by;  // end points that have a lowest bit in common, or 0: there is no such bit
  int index_bits, second_index_bits;
};
constexpr std::array<Mode, 8> modes{{{3, 4, 0, 0, 4, 0, 1, 3, 0},
                                     {2, 6, 0, 0, 6, 0, 2, 3, 0},
                                     {3, 6, 0, 0, 5, 0, 0, 2, 0},
                                     {2, 6, 0, 0, 7, 0, 1, 2, 0},
                                     {1, 0, 2, 1, 5, 6, 0, 2, 3},
                                     {1, 0, 2, 0, 7, 8, 0, 2, 2},
                                     {1, 0, 0, 0, 7, 7, 1, 4, 0},
                                     {2, 6, 0, 0, 5, 5, 1, 2, 0}}};

// Two bits a texel: its region in each partition of three regions.
constexpr std::array<std::uint32_t, 64> three_regions{
    0xAA685050, 0x6A5A5040, 0x5A5A4200, 0x5450A0A8, 0xA5A50000, 0xA0A05050, 0x5555A0A0, 0x5A5A5050,
    0xAA550000, 0xAA555500, 0xAAAA5500, 0x90909090, 0x94949494, 0xA4A4A4A4, 0xA9A59450, 0x2A0A4250,
    0xA5945040, 0x0A425054, 0xA5A5A500, 0x55A0A0A0, 0xA8A85454, 0x6A6A4040, 0xA4A45000, 0x1A1A0500,
    0x0050A4A4, 0xAAA59090, 0x14696914, 0x69691400, 0xA08585A0, 0xAA821414, 0x50A4A450, 0x6A5A0200,
    0xA9A58000, 0x5090A0A8, 0xA8A09050, 0x24242424, 0x00AA5500, 0x24924924, 0x24499224, 0x50A50A50,
    0x500AA550, 0xAAAA4444, 0x66660000, 0xA5A0A5A0, 0x50A050A0, 0x69286928, 0x44AAAA44, 0x66666600,
    0xAA444444, 0x54A854A8, 0x95809580, 0x96969600, 0xA85454A8, 0x80959580, 0xAA141414, 0x96960000,
    0xAAAA1414, 0xA05050A0, 0xA0A5A5A0, 0x96000000, 0x40804080, 0xA9A8A9A8, 0xAAAAAA44, 0x2A4A5254};
// The texels of regions 1 and 2 whose indices lack their highest bit.
constexpr std::array<std::uint8_t, 64> second_of_three{
    3, 3,  15, 15, 8, 3,  15, 15, 8,  8, 6,  6, 6,  5,  3,  3,  3, 3,  8, 15, 3, 3, 6, 10, 5, 8,  8, 6,  8,  5,  15, 15,
    8, 15, 3,  5,  6, 10, 8,  15, 15, 3, 15, 5, 15, 15, 15, 15, 3, 15, 5, 5,  5, 8, 5, 10, 5, 10, 8, 13, 15, 12, 3,  3};
constexpr std::array<std::uint8_t, 64> third_of_three{15, 8, 8,  3,  15, 15, 3,  8,  15, 15, 15, 15, 15, 15, 15, 8,
                                                      15, 8, 15, 3,  15, 8,  15, 8,  3,  15, 6,  10, 15, 15, 10, 8,
                                                      15, 3, 15, 10, 10, 8,  9,  10, 6,  15, 8,  15, 3,  6,  6,  8,
                                                      15, 3, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 3,  15, 15, 8};

std::size_t region_of(const Mode& mode, std::size_t partition, std::size_t texel) {
  if (mode.regions == 1) return 0;
  return mode.regions == 2 ? bptc::masks[partition] >> texel & 1 : three_regions[partition] >> 2 * texel & 3;
}

bool is_anchor(const Mode& mode, std::size_t partition, std::size_t texel) {
  if (texel == 0) return true;
  if (mode.regions == 2) return texel == bptc::second_anchor[partition];
  return mode.regions == 3 && (texel == second_of_three[partition] || texel == third_of_three[partition]);
}

int weight(int bits, int index) {
  const auto i = static_cast<std::size_t>(index);
  return bits == 2 ? bptc::weights_of_4[i] : bits == 3 ? bptc::weights_of_8[i] : bptc::weights_of_16[i];
}

// [end point][channel], to 8 bits by repeating the highest ones.
using Ends = std::array<std::array<int, 4>, 6>;
Ends take_ends(const Mode& mode, bptc::Bits& bits) {
  Ends ends{};
  const auto count = static_cast<std::size_t>(2 * mode.regions);
  const auto bits_of = [&](std::size_t c) { return c < 3 ? mode.colour_bits : mode.alpha_bits; };
  for (std::size_t c = 0; c < 4; ++c)
    for (std::size_t e = 0; e < count; ++e) ends[e][c] = bits.take(bits_of(c));
  int lowest = 0;
  for (std::size_t e = 0; e < count; ++e) {
    if (mode.shared_by > 0 && e % static_cast<std::size_t>(mode.shared_by) == 0) lowest = bits.take(1);
    for (std::size_t c = 0; c < 4; ++c) {
      int& value = ends[e][c];
      const int width = bits_of(c) + (mode.shared_by > 0 ? 1 : 0);
      if (mode.shared_by > 0) value = value << 1 | lowest;
      value = bits_of(c) == 0 ? 255 : value << (8 - width) | value >> (2 * width - 8);
    }
  }
  return ends;
}

void decode_bc7(const std::uint8_t* block, Texels& texels) {
  texels = {};
  if (block[0] == 0) return;
  const int m = std::countr_zero(block[0]);
  const Mode& mode = modes[static_cast<std::size_t>(m)];
  bptc::Bits bits(block);
  bits.take(m + 1);
  const auto partition = static_cast<std::size_t>(bits.take(mode.partition_bits));
  const int rotation = bits.take(mode.rotation_bits), selection = bits.take(mode.selection_bits);
  const Ends ends = take_ends(mode, bits);
  std::array<int, 16> of_colour, of_alpha;  // weights
  for (std::size_t t = 0; t < 16; ++t)
    of_colour[t] = weight(mode.index_bits, bits.take(mode.index_bits - is_anchor(mode, partition, t)));
  of_alpha = of_colour;
  if (mode.second_index_bits > 0)
    for (std::size_t t = 0; t < 16; ++t)
      of_alpha[t] = weight(mode.second_index_bits, bits.take(mode.second_index_bits - (t == 0)));
  if (selection) std::swap(of_colour, of_alpha);
  for (std::size_t t = 0; t < 16; ++t) {
    const std::size_t e = 2 * region_of(mode, partition, t);
    for (std::size_t c = 0; c < 4; ++c)
      texels[t][c] =
          static_cast<std::uint8_t>(bptc::interpolate(ends[e][c], ends[e + 1][c], (c < 3 ? of_colour : of_alpha)[t]));
    if (rotation > 0) std::swap(texels[t][3], texels[t][static_cast<std::size_t>(rotation - 1)]);
  }
}

// -------------------------------------------------------------------------------------------------------------------

void decode_block(const std::uint8_t* block, BlockCode code, Texels& texels) {
  switch (code) {
    case BlockCode::bc1: return decode_colours(block, true, texels);
    case BlockCode::bc2: decode_colours(block + 8, false, texels); return decode_alpha_of_4_bits(block, texels);
    case BlockCode::bc3: decode_colours(block + 8, false, texels); return decode_ramp(block, 3, texels);
    case BlockCode::bc5: decode_ramp(block + 8, 1, texels); [[fallthrough]];
    case BlockCode::bc4: return decode_ramp(block, 0, texels);
    case BlockCode::bc7: return decode_bc7(block, texels);
    case BlockCode::none: break;
  }
}

void decode_block(const std::uint8_t* block, BlockCode code, SignedTexels& texels) {
  decode_signed_ramp(block, 0, texels);
  if (code == BlockCode::bc5) decode_signed_ramp(block + 8, 1, texels);
}

template <class T, class Block>
void decode_all(const std::uint8_t* blocks, BlockCode code, int width, int height, int channels, T* to) {
  const int size = code == BlockCode::bc1 || code == BlockCode::bc4 ? 8 : 16;
  Block texels{};
  for (int top = 0; top < height; top += 4)
    for (int left = 0; left < width; left += 4, blocks += size) {
      decode_block(blocks, code, texels);
      for (int y = top; y < std::min(top + 4, height); ++y)
        for (int x = left; x < std::min(left + 4, width); ++x) {
          const auto& texel = texels[static_cast<std::size_t>(4 * (y - top) + x - left)];
          std::copy_n(texel.begin(), channels,
                      to + (static_cast<std::ptrdiff_t>(y) * width + x) * static_cast<std::ptrdiff_t>(channels));
        }
    }
}

}  // namespace

const char* name_of(BlockCode code) {
  static constexpr const char* names[] = {"", "bc1", "bc2", "bc3", "bc4", "bc5", "bc7"};
  return names[static_cast<std::size_t>(code)];
}

void decode_blocks(const std::uint8_t* blocks, BlockCode code, bool is_signed, int width, int height, int channels,
                   void* elements) {
  if (is_signed)
    decode_all<float, SignedTexels>(blocks, code, width, height, channels, static_cast<float*>(elements));
  else
    decode_all<std::uint8_t, Texels>(blocks, code, width, height, channels, static_cast<std::uint8_t*>(elements));
}

}  // namespace envconv
