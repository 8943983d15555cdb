// SPDX-License-Identifier: Apache-2.0
// Codes of packed floats, all of them, against the specifications' formulas written out in double precision.
#include "texel_format.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace envconv {
namespace {

// Khronos Data Format Specification 1.3, sections 10.1 to 10.3: the value of an unsigned float of 5 exponent bits.
double small_float(unsigned code, int mantissa_bits) {
  const unsigned exponent = code >> mantissa_bits, mantissa = code & ((1u << mantissa_bits) - 1);
  if (exponent == 31) return mantissa ? NAN : INFINITY;
  if (exponent == 0) return std::ldexp(mantissa, -14 - mantissa_bits);
  return std::ldexp(1 + std::ldexp(mantissa, -mantissa_bits), static_cast<int>(exponent) - 15);
}

// A channel of R11G11B10F, so that each test runs over all three.
struct Channel {
  int index, bits, shift;
  unsigned codes() const { return 31u << bits; }  // of finite values
  unsigned code(float v) const {
    float rgb[3] = {0, 0, 0};
    rgb[index] = v;
    const std::uint32_t word = pack_r11g11b10f(rgb[0], rgb[1], rgb[2]);
    const std::uint32_t mask = (32u << bits) - 1;
    EXPECT_EQ(word & ~(mask << shift), 0u) << "another channel changed";
    return word >> shift & mask;
  }
  float value(unsigned c) const {
    float rgb[3];
    unpack_r11g11b10f(c << shift, rgb);
    return rgb[index];
  }
};
constexpr Channel kChannels[] = {{0, 6, 0}, {1, 6, 11}, {2, 5, 22}};

TEST(R11G11B10F, EveryCodeHasItsValue) {
  for (const Channel& channel : kChannels) {
    for (unsigned code = 0; code < 32u << channel.bits; ++code) {
      const double expected = small_float(code, channel.bits);
      if (std::isnan(expected)) {
        EXPECT_TRUE(std::isnan(channel.value(code)));
      } else {
        EXPECT_EQ(channel.value(code), expected) << code;
      }
    }
  }
}

TEST(R11G11B10F, EveryCodeIsTheNearestOfItsNeighbourhood) {
  for (const Channel& channel : kChannels) {
    for (unsigned code = 0; code + 1 < channel.codes(); ++code) {
      const double low = small_float(code, channel.bits), high = small_float(code + 1, channel.bits);
      const auto middle = static_cast<float>((low + high) / 2);  // exact: floats have more bits
      ASSERT_EQ(middle, (low + high) / 2);
      ASSERT_EQ(channel.code(static_cast<float>(low)), code);
      ASSERT_EQ(channel.code(middle), code % 2 == 0 ? code : code + 1) << "a tie goes to the even code";
      ASSERT_EQ(channel.code(std::nextafter(middle, 0.f)), code);
      ASSERT_EQ(channel.code(std::nextafter(middle, 1e9f)), code + 1);
    }
  }
}

TEST(R11G11B10F, EndsOfTheRange) {
  for (const Channel& channel : kChannels) {
    const float largest = channel.index == 2 ? 64512.f : 65024.f;
    EXPECT_EQ(channel.value(channel.codes() - 1), largest);
    for (const float v : {largest, 65504.f, 1e6f, std::numeric_limits<float>::max(), INFINITY}) {
      EXPECT_EQ(channel.code(v), channel.codes() - 1) << v;
    }
    for (const float v : {0.f, -0.f, -1.f, -INFINITY, std::numeric_limits<float>::quiet_NaN(), 1e-30f}) {
      EXPECT_EQ(channel.code(v), 0u) << v;
    }
  }
}

// EXT_texture_shared_exponent, section 3.8.x: N = 9 mantissa bits, B = 15, Emax = 31.
std::uint32_t shared_exponent(double r, double g, double b) {
  const int n = 9, bias = 15;
  const double largest = (std::pow(2, n) - 1) / std::pow(2, n) * std::pow(2, 31 - bias);
  const auto clamp = [&](double v) { return std::isnan(v) ? 0 : std::fmax(0, std::fmin(largest, v)); };
  const double c[3] = {clamp(r), clamp(g), clamp(b)};
  const double top = std::fmax(c[0], std::fmax(c[1], c[2]));
  const double preliminary = std::fmax(-bias - 1, top > 0 ? std::floor(std::log2(top)) : -1e9) + 1 + bias;
  const double top_mantissa = std::floor(top / std::pow(2, preliminary - bias - n) + 0.5);
  const double exponent = top_mantissa < std::pow(2, n) ? preliminary : preliminary + 1;
  std::uint32_t code = static_cast<std::uint32_t>(exponent) << 27;
  for (int i = 0; i < 3; ++i) {
    code |= static_cast<std::uint32_t>(std::floor(c[i] / std::pow(2, exponent - bias - n) + 0.5)) << (9 * i);
  }
  return code;
}

TEST(Rgb9e5, EveryMantissaAndExponentHasItsValue) {
  for (unsigned exponent = 0; exponent < 32; ++exponent) {
    for (unsigned mantissa = 0; mantissa < 512; ++mantissa) {
      // Three different mantissas at a time: each runs through all.
      const unsigned m[3] = {mantissa, (mantissa * 7 + 3) % 512, 511 - mantissa};
      const std::uint32_t code = m[0] | m[1] << 9 | m[2] << 18 | exponent << 27;
      float rgb[3];
      unpack_rgb9e5(code, rgb);
      for (int c = 0; c < 3; ++c) {
        ASSERT_EQ(rgb[c], std::ldexp(static_cast<double>(m[c]), static_cast<int>(exponent) - 24)) << code;
      }
      // A code in its shortest form comes back, another as its equal.
      const std::uint32_t again = pack_rgb9e5(rgb[0], rgb[1], rgb[2]);
      if (exponent == 0 || (m[0] | m[1] | m[2]) >= 256) {
        ASSERT_EQ(again, code);
      } else {
        float same[3];
        unpack_rgb9e5(again, same);
        for (int c = 0; c < 3; ++c) ASSERT_EQ(same[c], rgb[c]);
      }
    }
  }
}

TEST(Rgb9e5, RoundsAsTheSpecificationSays) {
  std::mt19937 random(9);
  std::uniform_real_distribution<float> exponent(-26, 18), fraction(0, 1);
  for (int i = 0; i < 300000; ++i) {
    const float v[3] = {std::exp2(exponent(random)), std::exp2(exponent(random)) * fraction(random),
                        std::exp2(exponent(random)) * fraction(random)};
    ASSERT_EQ(pack_rgb9e5(v[0], v[1], v[2]), shared_exponent(v[0], v[1], v[2])) << v[0] << " " << v[1] << " " << v[2];
  }
  // Where the mantissa becomes 512, at every exponent, on both sides of the change and on it.
  for (int e = -20; e <= 15; ++e) {
    const auto change = static_cast<float>(std::ldexp(511.5, e - 8));
    for (const float v : {std::nextafter(change, 0.f), change, std::nextafter(change, 1e9f)}) {
      ASSERT_EQ(pack_rgb9e5(v, v / 3, 0), shared_exponent(v, v / 3, 0)) << v;
    }
  }
}

TEST(Rgb9e5, EndsOfTheRange) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(pack_rgb9e5(65408, 0, 0), 511u | 31u << 27);
  EXPECT_EQ(pack_rgb9e5(INFINITY, -1, nan), 511u | 31u << 27);
  EXPECT_EQ(pack_rgb9e5(0, 0, 1e30f), 511u << 18 | 31u << 27);
  EXPECT_EQ(pack_rgb9e5(0, 0, 0), 0u);
  EXPECT_EQ(pack_rgb9e5(-0.f, -INFINITY, nan), 0u);
}

TEST(Half, EveryCodeHasItsValue) {
  for (unsigned code = 0; code < 0x8000; ++code) {
    const double expected = small_float(code, 10);
    const float plus = half_to_float(static_cast<std::uint16_t>(code));
    const float minus = half_to_float(static_cast<std::uint16_t>(code | 0x8000));
    if (std::isnan(expected)) {
      EXPECT_TRUE(std::isnan(plus) && std::isnan(minus));
    } else {
      EXPECT_EQ(plus, expected);
      EXPECT_EQ(minus, -expected);
    }
  }
}

Picture picture_of(std::vector<float> values, int channels) {
  Picture picture;
  picture.channels = Channels::standard(channels);
  picture.image = Image(static_cast<int>(values.size()) / channels, 1, channels);
  std::copy(values.begin(), values.end(), picture.image.data());
  return picture;
}

struct Counts {
  std::int64_t high, negative, nonfinite;
  bool operator==(const Counts&) const = default;
};
Counts counts_of(PixelType type, std::vector<float> values, int channels = 3) {
  WriteReport report;
  encode_surface(picture_of(std::move(values), channels), texel_format(type, true), {}, report);
  return {report.clamped_high, report.clamped_negative, report.nonfinite};
}

TEST(EncodeSurface, CountsWhatDoesNotFit) {
  using enum PixelType;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<float> odd{70000, 1, 1, -1, 1, 1, nan, INFINITY, -INFINITY, 1, 2, 3};
  for (const PixelType type : {r11g11b10f, rgb9e5, bc6h}) EXPECT_EQ(counts_of(type, odd), (Counts{1, 1, 3}));
  EXPECT_EQ(counts_of(half, odd), (Counts{1, 0, 3}));
  EXPECT_EQ(counts_of(half, {-70000, 65519, -65519}), (Counts{1, 0, 0}));
  EXPECT_EQ(counts_of(uint8, {2, -1, 0.5f}), (Counts{1, 1, 0}));
  // Rounding to the end of the range loses nothing.
  EXPECT_EQ(counts_of(r11g11b10f, {65100, 65279, 65023}), (Counts{0, 0, 0}));
  EXPECT_EQ(counts_of(r11g11b10f, {65280, 65279, 65024}), (Counts{2, 0, 0}));
  EXPECT_EQ(counts_of(rgb9e5, {65471, 65472, -1e-9f}), (Counts{1, 0, 0}));
  // Grey becomes three values and is one.
  EXPECT_EQ(counts_of(rgb9e5, {70000, -1}, 1), (Counts{1, 1, 0}));
}

TEST(EncodeSurface, ChannelsTakeTheirPlaces) {
  WriteReport report;
  const TexelFormat format = texel_format(PixelType::float32, false);
  const auto floats = [&](std::vector<float> values, int channels) {
    const std::vector<std::uint8_t> bytes = encode_surface(picture_of(std::move(values), channels), format, {}, report);
    std::vector<float> out(bytes.size() / 4);
    std::copy_n(bytes.begin(), bytes.size(), reinterpret_cast<std::uint8_t*>(out.data()));
    return out;
  };
  EXPECT_EQ(floats({7}, 1), (std::vector<float>{7, 7, 7, 1}));
  EXPECT_EQ(floats({7, 0.5f}, 2), (std::vector<float>{7, 7, 7, 0.5f}));
  EXPECT_EQ(floats({7, 8, 9}, 3), (std::vector<float>{7, 8, 9, 1}));
  EXPECT_EQ(floats({7, 8, 9, 0.5f}, 4), (std::vector<float>{7, 8, 9, 0.5f}));
}

TEST(EncodeSurface, IntegersFollowTheCurveOrNot) {
  WriteReport report;
  const TexelFormat format = texel_format(PixelType::uint8, true);
  const Picture picture = picture_of({0.5f, 0.25f, 1, 0.5f}, 4);
  // Colour is divided by alpha: 1, 0.5 and (clamped) 2.  sRGB's code of 0.5 is 188 (IEC 61966-2-1).
  EXPECT_EQ(encode_surface(picture, format, {}, report), (std::vector<std::uint8_t>{255, 188, 255, 128}));
  EncodeOptions as_is;
  as_is.encoding = Encoding::as_is;
  EXPECT_EQ(encode_surface(picture, format, as_is, report), (std::vector<std::uint8_t>{255, 128, 255, 128}));
}

}  // namespace
}  // namespace envconv
