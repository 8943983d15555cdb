// SPDX-License-Identifier: Apache-2.0
// BC6H: the format bit by bit, and an encoder that is near to what the format can do.  Other people's decoders are in
// bc6h_oracle_test.cpp.
#include "bc6h.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

// As in lane-inl.h: the targets that the search was compiled for.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV | HWY_SSSE3 | HWY_AVX3_DL)
#include <hwy/highway.h>

#include "bc6h_exhaustive.h"
#include "bc6h_format.h"
#include "io.h"

namespace envconv {
namespace {

using bc6h::Block;
using test::block_error;
using test::half_bits;
using test::half_value;
using test::HalfTexels;
using Bytes = std::vector<std::uint8_t>;

constexpr Bc6hEffort efforts[] = {Bc6hEffort::fast, Bc6hEffort::normal, Bc6hEffort::best};

std::size_t at(int i) { return static_cast<std::size_t>(i); }

// --- the format

// The first bits that name a mode, number of regions, precision of the end points, and bits of the others' differences:
// Microsoft's "BC6H Format", compressed endpoint formats; mode 11 has no differences, mode 10 neither.
struct ModeFacts {
  int code, regions, precision, red, green, blue;
};
constexpr ModeFacts mode_facts[] = {{0x00, 2, 10, 5, 5, 5}, {0x01, 2, 7, 6, 6, 6},     {0x02, 2, 11, 5, 4, 4},
                                    {0x06, 2, 11, 4, 5, 4}, {0x0A, 2, 11, 4, 4, 5},    {0x0E, 2, 9, 5, 5, 5},
                                    {0x12, 2, 8, 6, 5, 5},  {0x16, 2, 8, 5, 6, 5},     {0x1A, 2, 8, 5, 5, 6},
                                    {0x1E, 2, 6, 6, 6, 6},  {0x03, 1, 10, 10, 10, 10}, {0x07, 1, 11, 9, 9, 9},
                                    {0x0B, 1, 12, 8, 8, 8}, {0x0F, 1, 16, 4, 4, 4}};

TEST(Bc6hFormat, ModesAreTheSpecifications) {
  ASSERT_EQ(std::size(mode_facts), bc6h::modes.size());
  for (std::size_t m = 0; m < bc6h::modes.size(); ++m) {
    const bc6h::Mode& mode = bc6h::modes[m];
    const ModeFacts& facts = mode_facts[m];
    EXPECT_EQ(mode.code, facts.code);
    EXPECT_EQ(mode.code_bits, facts.code < 2 ? 2 : 5);
    EXPECT_EQ(mode.regions, facts.regions);
    EXPECT_EQ(mode.end_bits, facts.precision);
    EXPECT_EQ(mode.rest_bits[0], facts.red);
    EXPECT_EQ(mode.rest_bits[1], facts.green);
    EXPECT_EQ(mode.rest_bits[2], facts.blue);
    EXPECT_EQ(mode.transformed, facts.code != 0x03 && facts.code != 0x1E);
    // 128 bits in all: mode, end points, partition, indices without the anchors' highest bits.
    const int ends = 3 * facts.precision + (2 * facts.regions - 1) * (facts.red + facts.green + facts.blue);
    EXPECT_EQ(mode.code_bits + ends + (facts.regions == 2 ? 5 + 46 : 63), 128);
  }
}

Block random_block(int mode, std::mt19937& random) {
  const bc6h::Mode& m = bc6h::modes[at(mode)];
  Block block{};
  block.mode = mode;
  const int mask = (1 << m.end_bits) - 1;
  for (std::size_t e = 0; e < 2u * m.regions; ++e)
    for (std::size_t c = 0; c < 3; ++c) {
      const int number = static_cast<int>(random());
      const int difference = (number & ((1 << m.rest_bits[c]) - 1)) - (1 << (m.rest_bits[c] - 1));
      block.ends[e][c] = (m.transformed && e > 0 ? block.ends[0][c] + difference : number) & mask;
    }
  if (m.regions == 2) block.partition = static_cast<int>(random() % bc6h::partition_count);
  for (std::size_t k = 0; k < 16; ++k) {
    const bool anchor = k == 0 || (m.regions == 2 && k == bc6h::second_anchor[at(block.partition)]);
    block.index[k] = static_cast<std::uint8_t>(random() % (16u >> (m.regions - 1) >> anchor));
  }
  return block;
}

TEST(Bc6hFormat, WhatIsPackedIsUnpacked) {
  std::mt19937 random(1);
  for (int mode = 0; mode < bc6h::mode_count; ++mode)
    for (int i = 0; i < 500; ++i) {
      const Block block = random_block(mode, random);
      ASSERT_TRUE(bc6h::fits(block));
      std::uint8_t bytes[16];
      bc6h::pack(block, bytes);
      Block back;
      ASSERT_TRUE(bc6h::unpack(bytes, false, back));
      EXPECT_EQ(back.mode, block.mode);
      EXPECT_EQ(back.partition, block.partition);
      EXPECT_EQ(back.ends, block.ends);
      EXPECT_EQ(back.index, block.index);
    }
}

TEST(Bc6hFormat, FitsIsWhatCanBeStored) {
  Block block{};
  block.mode = 12;  // 12 bits, differences of 8
  block.ends[0] = {1000, 1000, 1000};
  block.ends[1] = {1127, 872, 1000};
  EXPECT_TRUE(bc6h::fits(block));
  block.ends[1][0] = 1128;
  EXPECT_FALSE(bc6h::fits(block));
  block.ends[1] = {1000, 871, 1000};
  EXPECT_FALSE(bc6h::fits(block));
}

// A number of `count` bits set at `first` of a block of zeros.
void set_bits(std::array<std::uint8_t, 16>& bytes, int first, int count, int value) {
  for (int i = 0; i < count; ++i)
    if (value >> i & 1) bytes[at((first + i) / 8)] |= static_cast<std::uint8_t>(1 << (first + i) % 8);
}
std::array<float, 48> decode_one(const std::array<std::uint8_t, 16>& bytes, bool is_signed = false) {
  std::array<float, 48> rgb;
  decode_bc6h(bytes.data(), 4, 4, is_signed, rgb.data());
  return rgb;
}

// Bit positions as in the specification's table; the arithmetic is worked out here.
TEST(Bc6hFormat, HandMadeBlocks) {
  std::array<std::uint8_t, 16> bytes{};
  set_bits(bytes, 0, 5, 0x03);  // one region, 10 bits
  set_bits(bytes, 5, 10, 480);  // red 0
  set_bits(bytes, 25, 10, 1023);
  set_bits(bytes, 35, 10, 240);    // red 1
  set_bits(bytes, 65 + 3, 4, 15);  // texel 1 (texel 0 has three bits)
  set_bits(bytes, 65 + 7, 4, 5);   // texel 2: 21/64 of the second end point
  auto rgb = decode_one(bytes);
  // (480 * 65536 + 32768) / 1024 = 30752; 30752 * 31 / 64 = 14895.5
  EXPECT_EQ(rgb[0], half_value(14895));
  EXPECT_EQ(rgb[1], 0);
  EXPECT_EQ(rgb[2], 65504);
  // (240 * 65536 + 32768) / 1024 = 15392; * 31 / 64 = 7455.5; the blue end points are 1023 and 0
  EXPECT_EQ(rgb[3], half_value(7455));
  EXPECT_EQ(rgb[5], 0);
  // (30752 * 43 + 15392 * 21 + 32) / 64 = 25712.5; * 31 / 64 = 12454.25
  EXPECT_EQ(rgb[6], half_value(12454));
  // (65535 * 43 + 32) / 64 = 44031.8; * 31 / 64 = 21327.5
  EXPECT_EQ(rgb[8], half_value(21327));

  bytes = {};
  set_bits(bytes, 0, 5, 0x0F);    // one region, 16 bits: no rounding at all
  set_bits(bytes, 5, 10, 0x155);  // red 0, bits 0 to 9
  set_bits(bytes, 35, 4, 0x9);    // red 1: -7
  set_bits(bytes, 39, 6, 0x0D);   // red 0, bits 15 to 10: 101100
  set_bits(bytes, 68, 4, 15);
  rgb = decode_one(bytes);
  EXPECT_EQ(rgb[0], half_value((0xB155 * 31) >> 6));
  EXPECT_EQ(rgb[3], half_value(((0xB155 - 7) * 31) >> 6));

  bytes = {};
  set_bits(bytes, 0, 2, 0x00);   // two regions, 10 bits, differences of 5
  set_bits(bytes, 2, 1, 1);      // green of region 1's first end point, bit 4
  set_bits(bytes, 15, 10, 500);  // green 0
  set_bits(bytes, 41, 4, 0x2);   // the same, bits 0 to 3: 10010 is -14
  set_bits(bytes, 77, 5, 13);    // partition 13: the lower half is region 1
  rgb = decode_one(bytes);
  // (500 * 65536 + 32768) / 1024 = 32032; * 31 / 64 = 15515.5;  486: 31136; * 31 / 64 = 15081.5
  for (std::size_t k = 0; k < 16; ++k) EXPECT_EQ(rgb[3 * k + 1], half_value(k < 8 ? 15515 : 15081)) << k;
}

TEST(Bc6hFormat, SignedBlocks) {
  std::array<std::uint8_t, 16> bytes{};
  set_bits(bytes, 0, 5, 0x03);
  set_bits(bytes, 5, 10, -100 & 1023);
  set_bits(bytes, 35, 10, -100 & 1023);
  // (100 * 32768 + 16384) / 512 = 6432; * 31 / 32 = 6231
  EXPECT_EQ(decode_one(bytes, true)[0], -half_value(6231));
}

TEST(Bc6hFormat, ReservedModesAreBlack) {
  for (const int code : {0x13, 0x17, 0x1B, 0x1F}) {
    std::array<std::uint8_t, 16> bytes;
    bytes.fill(0xFF);
    bytes[0] = static_cast<std::uint8_t>(0xE0 | code);
    for (const float value : decode_one(bytes)) EXPECT_EQ(value, 0) << code;
  }
}

// --- the encoder

Image image_of(const std::vector<HalfTexels>& blocks) {
  Image image(4 * static_cast<int>(blocks.size()), 4, 3);
  for (int i = 0; i < image.width(); ++i)
    for (int y = 0; y < 4; ++y)
      for (int c = 0; c < 3; ++c)
        image.at(i, y)[c] = static_cast<float>(half_value(blocks[at(i / 4)][at(4 * y + i % 4)][at(c)]));
  return image;
}
Bytes encode(const Image& image, Bc6hEffort effort, int threads = 1) {
  Bytes bytes(bc6h_bytes(image.width(), image.height()));
  encode_bc6h(image, effort, threads, bytes.data());
  return bytes;
}
std::vector<Block> encode_blocks(const std::vector<HalfTexels>& texels, Bc6hEffort effort) {
  const Bytes bytes = encode(image_of(texels), effort);
  std::vector<Block> blocks(texels.size());
  for (std::size_t i = 0; i < blocks.size(); ++i) EXPECT_TRUE(bc6h::unpack(&bytes[16 * i], false, blocks[i]));
  return blocks;
}
std::vector<float> round_trip(const Image& image, Bc6hEffort effort) {
  const Bytes bytes = encode(image, effort);
  std::vector<float> rgb(image.pixel_count() * 3);
  decode_bc6h(bytes.data(), image.width(), image.height(), false, rgb.data());
  return rgb;
}
HalfTexels constant(int red, int green, int blue) {
  HalfTexels texels;
  texels.fill({static_cast<std::uint16_t>(red), static_cast<std::uint16_t>(green), static_cast<std::uint16_t>(blue)});
  return texels;
}

// The 16-bit mode holds every half.
TEST(Bc6hEncoder, ConstantBlocksAreExact) {
  std::mt19937 random(2);
  std::vector<HalfTexels> texels;
  for (int bits = 0; bits <= 0x7BFF; bits += 7) texels.push_back(constant(bits, bits, bits));
  for (int i = 0; i < 2000; ++i)
    texels.push_back(constant(static_cast<int>(random() % 0x7C00), static_cast<int>(random() % 0x7C00),
                              static_cast<int>(random() % 0x7C00)));
  texels.push_back(constant(0, 0x7BFF, 1));
  texels.push_back(constant(0x7BFF, 0x7BFF, 0x7BFF));
  for (const Bc6hEffort effort : efforts) {
    const std::vector<Block> blocks = encode_blocks(texels, effort);
    for (std::size_t i = 0; i < blocks.size(); ++i) ASSERT_EQ(bc6h::decode(blocks[i], false), texels[i]) << i;
  }
}

// Sixteen levels along a line are what one region has: nothing is lost but the end points' rounding.
TEST(Bc6hEncoder, RampsAreLines) {
  for (const int range : {150, 600, 3000, 12000}) {
    HalfTexels texels;
    for (int k = 0; k < 16; ++k)
      texels[at(k)] = {static_cast<std::uint16_t>(15360 + range * k / 15),
                       static_cast<std::uint16_t>(15360 - range * k / 15),
                       static_cast<std::uint16_t>(14000 + range * k / 30)};
    // The mode of most precision that reaches: differences of 9 bits and steps of 16, of 8 and 8, of 10 and 32, or of
    // 64 (in the space of interpolation, 64/31 of half bit patterns).
    const int reach = range * 64 / 31;
    const double step = reach < 127 * 16 ? 16 : reach < 255 * 32 ? 32 : 64;
    // Indices' weights are rounded to 64ths, end points to steps, the result to whole bit patterns.
    const double most = range / 128.0 + step / 2 * 31 / 64 + 1;
    for (const Bc6hEffort effort : {Bc6hEffort::fast, Bc6hEffort::normal}) {
      const HalfTexels got = bc6h::decode(encode_blocks({texels}, effort)[0], false);
      double sum = 0;
      for (std::size_t k = 0; k < 16; ++k)
        for (std::size_t c = 0; c < 3; ++c) sum += std::pow(got[k][c] - texels[k][c], 2);
      EXPECT_LT(std::sqrt(sum / 48), most) << range;
    }
  }
}

// What a block was made of in a mode is found again, and the mode with it.
TEST(Bc6hEncoder, EveryModeIsChosen) {
  std::mt19937 random(3);
  for (int mode = 0; mode < bc6h::mode_count; ++mode) {
    std::vector<HalfTexels> texels;
    for (int i = 0; i < 200; ++i) texels.push_back(bc6h::decode(random_block(mode, random), false));
    for (const Bc6hEffort effort : efforts) {
      int chosen = 0;
      for (const Block& block : encode_blocks(texels, effort)) chosen += block.mode == mode;
      EXPECT_GE(chosen, 5) << "mode " << mode << " effort " << static_cast<int>(effort);
    }
  }
}

// The simplest encoder there is: the 10-bit mode from corner to corner of the bounding box, along the diagonal that
// follows green.  What it makes of a block.
HalfTexels simple_encoding(const HalfTexels& texels) {
  Block block{};
  block.mode = 10;
  std::array<int, 3> low, high;
  for (std::size_t c = 0; c < 3; ++c) {
    low[c] = high[c] = texels[0][c];
    double mean[2]{}, covariance = 0;
    for (const auto& texel : texels) {
      low[c] = std::min<int>(low[c], texel[c]);
      high[c] = std::max<int>(high[c], texel[c]);
      mean[0] += texel[c] / 16.0, mean[1] += texel[1] / 16.0;
    }
    for (const auto& texel : texels) covariance += (texel[c] - mean[0]) * (texel[1] - mean[1]);
    if (covariance < 0) std::swap(low[c], high[c]);
    block.ends[0][c] = low[c] * 64 / 31 >> 6;
    block.ends[1][c] = high[c] * 64 / 31 >> 6;
  }
  HalfTexels best{};
  for (std::size_t k = 0; k < 16; ++k) {
    double least = HUGE_VAL;
    for (int i = 0; i < 16; ++i) {
      double error = 0;
      std::array<std::uint16_t, 3> now;
      for (std::size_t c = 0; c < 3; ++c) {
        const int u = bc6h::interpolate(bc6h::unquantize(block.ends[0][c], 10), bc6h::unquantize(block.ends[1][c], 10),
                                        bc6h::weight(1, i));
        now[c] = static_cast<std::uint16_t>(bc6h::to_half_bits(u));
        error += std::pow(test::log_levels()[now[c]] - test::log_levels()[texels[k][c]], 2);
      }
      if (error < least) least = error, best[k] = now;
    }
  }
  return best;
}
// How far channels' sums of radiance are apart.
double sum_error(const HalfTexels& a, const HalfTexels& b) {
  double error = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    double difference = 0;
    for (std::size_t k = 0; k < 16; ++k) difference += half_value(a[k][c]) - half_value(b[k][c]);
    error += std::abs(difference);
  }
  return error;
}

Image panorama(const std::string& name) {
  Result<PictureFile> file = read_pictures(ENVCONV_TESTDATA "/panoramas/" + name, {});
  if (!file) {
    ADD_FAILURE() << file.error().message;
    return Image(4, 4, 3);
  }
  return std::move(file->pictures[0].image);
}
HalfTexels block_of(const Image& image, int number) {
  const int columns = image.width() / 4, x = 4 * (number % columns), y = 4 * (number / columns);
  HalfTexels texels;
  for (int k = 0; k < 16; ++k)
    for (int c = 0; c < 3; ++c) texels[at(k)][at(c)] = half_bits(image.at(x + k % 4, y + k / 4)[c]);
  return texels;
}
// Numbers of every `stride`-th block.
std::vector<int> every(const Image& image, int stride) {
  std::vector<int> numbers;
  for (int i = stride / 2; i < image.width() / 4 * (image.height() / 4); i += stride) numbers.push_back(i);
  return numbers;
}
std::vector<HalfTexels> sample(const Image& image, int stride) {
  std::vector<HalfTexels> blocks;
  for (const int number : every(image, stride)) blocks.push_back(block_of(image, number));
  return blocks;
}

TEST(Bc6hEncoder, NeverWorseThanTheSimplest) {
  std::mt19937 random(4);
  std::vector<HalfTexels> texels = sample(panorama("interior.exr"), 7);
  for (int i = 0; i < 1500; ++i) {  // noise of all ranges
    HalfTexels& block = texels.emplace_back();
    const unsigned range = 1 + random() % 0x7C00, low = random() % (0x7C00 - range + 1);
    for (auto& texel : block)
      for (std::uint16_t& bits : texel) bits = static_cast<std::uint16_t>(low + random() % range);
  }
  for (const Bc6hEffort effort : {Bc6hEffort::fast, Bc6hEffort::normal}) {
    const std::vector<Block> blocks = encode_blocks(texels, effort);
    // In the logarithm, which the encoder has to 0.01 octaves, or else in the sum.
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      const HalfTexels got = bc6h::decode(blocks[i], false), simple = simple_encoding(texels[i]);
      if (sum_error(got, texels[i]) < sum_error(simple, texels[i])) continue;
      ASSERT_LE(block_error(got, texels[i]), 1.03 * block_error(simple, texels[i]) + 1e-6) << i;
    }
  }
}

// How far an encoding of an image is from the exhaustive search in some of its blocks, in dB.
double loss(const Image& image, const Bytes& bytes, const std::vector<int>& numbers) {
  double least = 0, sum = 0;
  for (const int number : numbers) {
    const HalfTexels texels = block_of(image, number);
    const test::ExhaustiveSearch search(texels);
    EXPECT_NEAR(block_error(bc6h::decode(search.block(), false), texels), search.error(), 1e-3 * search.error() + 1e-5);
    least += search.error();
    Block block;
    EXPECT_TRUE(bc6h::unpack(&bytes[16 * at(number)], false, block));
    sum += block_error(bc6h::decode(block, false), texels);
  }
  return 10 * std::log10(sum / least);
}

// Numbers of the blocks of a square of 16x16 texels.
std::vector<int> square(const Image& image, int left, int top) {
  std::vector<int> numbers;
  for (int k = 0; k < 16; ++k) numbers.push_back((top / 4 + k / 4) * (image.width() / 4) + left / 4 + k % 4);
  return numbers;
}

// Where a search with the same effort everywhere loses most, 0.7 to 3.5 dB: a block or two that hold most of a crop's
// error, edges that no partition follows, clusters that end points of few bits hit by luck; and 0.5 to 0.9 dB near the
// poles, where rows of four texels are alike and their blocks but luck of rounding.
struct Panorama {
  const char* name;
  std::vector<std::pair<int, int>> crops;
};
class Bc6hQuality : public testing::TestWithParam<Panorama> {};
TEST_P(Bc6hQuality, IsNearTheBestThereIs) {
  const Image image = panorama(GetParam().name);
  const Bytes fast = encode(image, Bc6hEffort::fast, 2), normal = encode(image, Bc6hEffort::normal, 2);
  const std::vector<int> some = every(image, 4000);
  EXPECT_LT(loss(image, normal, some), 0);
  EXPECT_LT(loss(image, fast, some), 0.3);
  for (const auto& [left, top] : GetParam().crops)
    EXPECT_LT(loss(image, normal, square(image, left, top)), 0.5) << left << ',' << top;
}
INSTANTIATE_TEST_SUITE_P(, Bc6hQuality,
                         testing::Values(Panorama{"venice.hdr", {{328, 264}}},
                                         Panorama{"city.exr", {{768, 284}, {268, 332}, {216, 4}, {896, 148}}},
                                         Panorama{"courtyard.exr", {{296, 252}}},
                                         Panorama{"interior.exr", {{376, 496}, {244, 96}, {616, 36}}}),
                         [](const auto& info) {
                           return std::string(info.param.name, std::strcspn(info.param.name, "."));
                         });

TEST(Bc6hEncoder, MoreEffortIsNoWorse) {
  const std::vector<HalfTexels> texels = sample(panorama("courtyard.exr"), 37);
  double before = HUGE_VAL;
  for (const Bc6hEffort effort : efforts) {
    const std::vector<Block> blocks = encode_blocks(texels, effort);
    double sum = 0;
    for (std::size_t i = 0; i < blocks.size(); ++i) sum += block_error(bc6h::decode(blocks[i], false), texels[i]);
    EXPECT_LT(sum, before);
    before = sum;
  }
}

TEST(Bc6hEncoder, SunAmongTheSky) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> sky(0.45f, 0.55f);
  for (const Bc6hEffort effort : efforts)
    for (int place = 0; place < 16; ++place) {
      Image image(4, 4, 3);
      for (int i = 0; i < 48; ++i) image.data()[i] = sky(random);
      for (int c = 0; c < 3; ++c) image.at(place % 4, place / 4)[c] = 5e4f;
      const std::vector<float> rgb = round_trip(image, effort);
      for (int i = 0; i < 48; ++i) {
        const float value = rgb[at(i)], ratio = value / image.data()[i];
        if (i / 3 == place) {
          EXPECT_NEAR(ratio, 1, 0.05) << place;
        } else {  // 16 levels over 17 octaves: the sky may lose its detail, never take the sun's light
          EXPECT_GT(ratio, 0.75) << place;
          EXPECT_LT(ratio, 1.33) << place;
        }
      }
    }
}

// What lights a scene is often a few texels in blocks that are hard to encode: without regard to it 3.6 percent were
// gained in city's green, and 1.7 lost in interior's.
TEST(Bc6hEncoder, MeanRadianceStays) {
  for (const char* name : {"city.exr", "interior.exr", "venice.hdr"}) {
    const Image image = panorama(name);
    for (const Bc6hEffort effort : {Bc6hEffort::fast, Bc6hEffort::normal}) {
      const std::vector<float> rgb = round_trip(image, effort);
      for (std::size_t c = 0; c < 3; ++c) {
        double before = 0, after = 0;
        for (std::size_t i = 0; i < image.pixel_count(); ++i) {
          before += std::clamp(image.data()[i * at(image.channels()) + c], 0.f, 65504.f);
          after += rgb[3 * i + c];
        }
        EXPECT_NEAR(after / before, 1, 0.005) << name << " channel " << c;
      }
    }
  }
}

TEST(Bc6hEncoder, ValuesOutsideTheFormat) {
  constexpr float infinity = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  const float values[][2] = {{0, 0},
                             {-0.f, 0},
                             {-1, 0},
                             {nan, 0},
                             {-infinity, 0},
                             {1e-30f, 0},
                             {-1e-45f, 0},
                             {infinity, 65504},
                             {65504, 65504},
                             {65505, 65504},
                             {1e30f, 65504},
                             {0x1p-24f, 0x1p-24f},
                             {0x3p-20f, 0x3p-20f},
                             {0x1p-14f, 0x1p-14f}};
  for (const Bc6hEffort effort : efforts)
    for (const auto& [given, wanted] : values) {
      Image image(4, 4, 3);
      image.fill(given);
      for (const float value : round_trip(image, effort)) EXPECT_EQ(value, wanted) << given;
    }
  // Any mixture decodes to numbers from 0 to 65504.
  std::mt19937 random(6);
  Image image(256, 64, 3);
  for (std::size_t i = 0; i < image.value_count(); ++i) {
    const std::uint32_t bits = static_cast<std::uint32_t>(random());
    std::memcpy(image.data() + i, &bits, 4);
  }
  for (const Bc6hEffort effort : efforts)
    for (const float value : round_trip(image, effort)) ASSERT_TRUE(value >= 0 && value <= 65504) << value;
}

Image noise(int width, int height, int channels) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> octaves(-8, 4);
  Image image(width, height, channels);
  for (std::size_t i = 0; i < image.value_count(); ++i) image.data()[i] = std::exp2(octaves(random));
  return image;
}

TEST(Bc6hEncoder, PartialBlocksGoOnAsTheyEnd) {
  for (const auto& [width, height] : {std::pair{1, 1}, {2, 7}, {5, 3}, {261, 9}}) {
    const Image image = noise(width, height, 3);
    Image whole((width + 3) / 4 * 4, (height + 3) / 4 * 4, 3);
    for (int y = 0; y < whole.height(); ++y)
      for (int x = 0; x < whole.width(); ++x)
        std::copy_n(image.at(std::min(x, width - 1), std::min(y, height - 1)), 3, whole.at(x, y));
    const Bytes bytes = encode(image, Bc6hEffort::fast);
    EXPECT_EQ(bytes, encode(whole, Bc6hEffort::fast));
    std::vector<float> rgb(image.pixel_count() * 3), all(whole.pixel_count() * 3);
    decode_bc6h(bytes.data(), width, height, false, rgb.data());
    decode_bc6h(bytes.data(), whole.width(), whole.height(), false, all.data());
    for (int y = 0; y < height; ++y)
      for (int i = 0; i < 3 * width; ++i)
        ASSERT_EQ(rgb[at(3 * width * y + i)], all[at(3 * whole.width() * y + i)]) << i << ' ' << y;
  }
}

TEST(Bc6hEncoder, ChannelsBesideThree) {
  const Image rgb = noise(16, 8, 3);
  Image rgba(16, 8, 4), grey(16, 8, 1), grey_alpha(16, 8, 2), repeated(16, 8, 3);
  for (std::size_t i = 0; i < rgb.pixel_count(); ++i) {
    std::copy_n(rgb.data() + 3 * i, 3, rgba.data() + 4 * i);
    rgba.data()[4 * i + 3] = 0.25f;
    grey.data()[i] = grey_alpha.data()[2 * i] = rgb.data()[3 * i];
    grey_alpha.data()[2 * i + 1] = 0.75f;
    std::fill_n(repeated.data() + 3 * i, 3, rgb.data()[3 * i]);
  }
  EXPECT_EQ(encode(rgba, Bc6hEffort::fast), encode(rgb, Bc6hEffort::fast));
  EXPECT_EQ(encode(grey, Bc6hEffort::fast), encode(repeated, Bc6hEffort::fast));
  EXPECT_EQ(encode(grey_alpha, Bc6hEffort::fast), encode(repeated, Bc6hEffort::fast));
}

TEST(Bc6hEncoder, ThreadsDoNotMatter) {
  const Image image = noise(1000, 36, 3);
  for (const Bc6hEffort effort : {Bc6hEffort::fast, Bc6hEffort::normal})
    EXPECT_EQ(encode(image, effort, 1), encode(image, effort, 2));
}

TEST(Bc6hEncoder, ProcessorsDoNotMatter) {
  const Image image = panorama("city.exr");
  Image crop(64, 64, 3);
  for (int y = 0; y < 64; ++y) std::copy_n(image.at(400, 220 + y), 64 * 3, crop.row(y));
  for (const Bc6hEffort effort : {Bc6hEffort::fast, Bc6hEffort::normal}) {
    Bytes first;
    hwy::SetSupportedTargetsForTest(0);
    const std::int64_t targets = hwy::SupportedTargets() & HWY_TARGETS;
    for (int bit = 0; bit < 63; ++bit) {
      if (!(targets >> bit & 1)) continue;
      hwy::SetSupportedTargetsForTest(std::int64_t{1} << bit);
      const Bytes bytes = encode(crop, effort);
      if (first.empty()) first = bytes;
      EXPECT_TRUE(bytes == first) << "target " << bit;
    }
    hwy::SetSupportedTargetsForTest(0);
  }
}

}  // namespace
}  // namespace envconv
