// SPDX-License-Identifier: Apache-2.0
#include "texel_format.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstring>

#include "io_shared.h"

namespace envconv {
namespace {

static_assert(std::endian::native == std::endian::little);  // as all containers here

// Floats of 5 exponent bits (bias 15) and some mantissa bits, without the sign.
template <int kMantissa>
struct SmallFloat {
  static constexpr std::uint32_t kLargestCode = (31u << kMantissa) - 1;
  static constexpr float kLargest = (2 - 1.f / (1 << kMantissa)) * 0x1p15f;
  // Values that round beyond the largest, and the first below 0 that do not round to it.
  static constexpr float kTooHigh = (2 - 0.5f / (1 << kMantissa)) * 0x1p15f;
  static constexpr float kTooLow = -0.5f * 0x1p-14f / (1 << kMantissa);

  // Finite v >= 0 to the nearest code, ties to even.
  static std::uint32_t code(float v) {
    if (v >= kTooHigh) return kLargestCode;
    if (v < 0x1p-14f) return static_cast<std::uint32_t>(std::rint(v * (0x1p14f * (1 << kMantissa))));
    constexpr int kDropped = 23 - kMantissa;
    const std::uint32_t bits = std::bit_cast<std::uint32_t>(v) - (112u << 23);
    return (bits + (1u << (kDropped - 1)) - 1 + ((bits >> kDropped) & 1)) >> kDropped;
  }
  static float value(std::uint32_t code) {
    const std::uint32_t exponent = code >> kMantissa, mantissa = code & ((1u << kMantissa) - 1);
    if (exponent == 0) return static_cast<float>(mantissa) * (0x1p-14f / (1 << kMantissa));
    const std::uint32_t rebiased = exponent == 31 ? 255 : exponent + 112;
    return std::bit_cast<float>(rebiased << 23 | mantissa << (23 - kMantissa));
  }
};
using Float11 = SmallFloat<6>;
using Float10 = SmallFloat<5>;
using Half = SmallFloat<10>;

// Of RGB9E5, as the extension names them.
constexpr int kN = 9, kB = 15;
constexpr float kSharedMax = 65408;  // (2^9 - 1) / 2^9 * 2^(31 - 15)

// 0 for NaN and what is negative.
float positive(float v) { return v > 0 ? std::min(v, 0x1p17f) : 0.f; }

// What does not fit.
struct Tally {
  std::int64_t high = 0, negative = 0, nonfinite = 0;
  void add(float v, float too_high, float too_low) {
    if (!std::isfinite(v)) {
      ++nonfinite;
    } else if (v >= too_high) {
      ++high;
    } else if (v < too_low) {
      ++negative;
    }
  }
};

std::uint16_t half_code(float v) {
  if (std::isnan(v)) return 0;
  const std::uint32_t magnitude = Half::code(std::min(std::abs(v), 0x1p17f));
  return static_cast<std::uint16_t>(magnitude | (std::signbit(v) ? 0x8000u : 0u));
}

void put(std::uint8_t*& to, std::uint16_t v) {
  std::memcpy(to, &v, 2);
  to += 2;
}
void put(std::uint8_t*& to, std::uint32_t v) {
  std::memcpy(to, &v, 4);
  to += 4;
}
template <class T>
T get(const std::uint8_t* from) {
  T v;
  std::memcpy(&v, from, sizeof v);
  return v;
}

// Where R, G, B and A of a picture are; grey stands for all three.
struct Sources {
  int rgb[3];
  int alpha;
  int colors;  // channels of colour, so that grey is counted once
  explicit Sources(const Picture& picture) {
    const int channels = picture.channels.count();
    alpha = picture.channels.alpha;
    colors = channels - (alpha >= 0);
    int next = 0;
    for (int& c : rgb) {
      if (next == alpha) ++next;
      c = next;
      if (colors >= 3) ++next;
    }
  }
};

// One texel of floats; `v` has four values.
void encode_texel(const float* v, PixelType type, std::uint8_t*& to) {
  switch (type) {
    case PixelType::half:
      for (int c = 0; c < 4; ++c) put(to, half_code(v[c]));
      break;
    case PixelType::r11g11b10f: put(to, pack_r11g11b10f(v[0], v[1], v[2])); break;
    case PixelType::rgb9e5: put(to, pack_rgb9e5(v[0], v[1], v[2])); break;
    default:
      for (int c = 0; c < 4; ++c) put(to, std::bit_cast<std::uint32_t>(v[c]));
  }
}

struct Range {
  float too_high, too_low;
};

Range range_of(PixelType type, int channel) {
  switch (type) {
    case PixelType::half: return {Half::kTooHigh, -Half::kTooHigh};
    case PixelType::r11g11b10f:
      return channel == 2 ? Range{Float10::kTooHigh, Float10::kTooLow} : Range{Float11::kTooHigh, Float11::kTooLow};
    case PixelType::rgb9e5: return {kSharedMax + 64, -0x1p-25f};
    case PixelType::bc6h: return {Half::kTooHigh, Half::kTooLow};
    default: return {INFINITY, -INFINITY};
  }
}

// Half below its negative end is too large, not negative.
void add_to(Tally& tally, float v, PixelType type, int channel) {
  const Range range = range_of(type, channel);
  if (type == PixelType::half && v <= range.too_low && std::isfinite(v)) {
    ++tally.high;
  } else {
    tally.add(v, range.too_high, range.too_low);
  }
}

// Calls row(y, tally) for all rows and adds up what does not fit.
template <class F>
void for_rows(int height, WriteReport& report, F&& row) {
  std::atomic<std::int64_t> high{0}, negative{0}, nonfinite{0};
  tbb::parallel_for(0, height, [&](int y) {
    Tally tally;
    row(y, tally);
    high += tally.high;
    negative += tally.negative;
    nonfinite += tally.nonfinite;
  });
  report.clamped_high += high;
  report.clamped_negative += negative;
  report.nonfinite += nonfinite;
}

void encode_floats(const Picture& picture, PixelType type, std::uint8_t* bytes, std::size_t row_size,
                   WriteReport& report) {
  const Image& image = picture.image;
  const Sources sources(picture);
  for_rows(image.height(), report, [&](int y, Tally& tally) {
    std::uint8_t* to = bytes + static_cast<std::size_t>(y) * row_size;
    const float* from = image.row(y);
    for (int x = 0; x < image.width(); ++x, from += image.channels()) {
      float v[4] = {from[sources.rgb[0]], from[sources.rgb[1]], from[sources.rgb[2]],
                    sources.alpha >= 0 ? from[sources.alpha] : 1.f};
      for (int c = 0; c < 4; ++c) {
        if (c == 3 ? sources.alpha >= 0 : c < sources.colors) add_to(tally, v[c], type, c);
      }
      encode_texel(v, type, to);
    }
  });
}

void encode_blocks(const Picture& picture, const EncodeOptions& options, std::uint8_t* bytes, WriteReport& report) {
  const Image& image = picture.image;
  for_rows(image.height(), report, [&](int y, Tally& tally) {
    const float* from = image.row(y);
    for (int x = 0; x < image.width(); ++x, from += image.channels()) {
      for (int c = 0; c < std::min(image.channels(), 3); ++c) add_to(tally, from[c], PixelType::bc6h, c);
    }
  });
  encode_bc6h(image, options.effort, options.threads, bytes);
}

void encode_integers(const Picture& picture, const EncodeOptions& options, std::uint8_t* bytes, WriteReport& report) {
  const auto elements = to_elements(picture, PixelType::uint8, options.encoding, report);
  const auto* from = static_cast<const std::uint8_t*>(elements.get());
  const Sources sources(picture);
  const auto channels = static_cast<std::size_t>(picture.image.channels());
  for (std::size_t i = 0; i < picture.image.pixel_count(); ++i, from += channels, bytes += 4) {
    for (int c = 0; c < 3; ++c) bytes[c] = from[sources.rgb[c]];
    bytes[3] = sources.alpha >= 0 ? from[sources.alpha] : 255;
  }
}

void decode_texel(const std::uint8_t* from, const TexelFormat& format, int channels, float* to) {
  switch (format.type) {
    case PixelType::half:
      for (int c = 0; c < channels; ++c) to[c] = half_to_float(get<std::uint16_t>(from + 2 * c));
      break;
    case PixelType::r11g11b10f: unpack_r11g11b10f(get<std::uint32_t>(from), to); break;
    case PixelType::rgb9e5: unpack_rgb9e5(get<std::uint32_t>(from), to); break;
    default: std::memcpy(to, from, sizeof(float) * static_cast<std::size_t>(channels));
  }
}

template <class T>
void decode_integers(const std::uint8_t* from, const TexelFormat& format, std::size_t texels, int channels, T* to) {
  for (std::size_t i = 0; i < texels; ++i, from += format.bytes, to += channels) {
    std::memcpy(to, from, sizeof(T) * static_cast<std::size_t>(channels));
    if (format.bgr) std::swap(to[0], to[2]);
  }
}

}  // namespace

std::uint32_t pack_r11g11b10f(float r, float g, float b) {
  return Float11::code(positive(r)) | Float11::code(positive(g)) << 11 | Float10::code(positive(b)) << 22;
}

void unpack_r11g11b10f(std::uint32_t code, float* rgb) {
  rgb[0] = Float11::value(code & 0x7FF);
  rgb[1] = Float11::value(code >> 11 & 0x7FF);
  rgb[2] = Float10::value(code >> 22);
}

std::uint32_t pack_rgb9e5(float r, float g, float b) {
  const float v[3] = {std::min(positive(r), kSharedMax), std::min(positive(g), kSharedMax),
                      std::min(positive(b), kSharedMax)};
  const float top = std::max({v[0], v[1], v[2]});
  // floor(log2(top)), at least -B - 1.
  const int log = top > 0 ? std::max(std::ilogb(top), -kB - 1) : -kB - 1;
  int exponent = log + 1 + kB;
  const auto mantissa = [&](float c) {
    return static_cast<std::uint32_t>(std::floor(std::ldexp(static_cast<double>(c), kB + kN - exponent) + 0.5));
  };
  if (mantissa(top) == 1u << kN) ++exponent;
  return mantissa(v[0]) | mantissa(v[1]) << 9 | mantissa(v[2]) << 18 | static_cast<std::uint32_t>(exponent) << 27;
}

void unpack_rgb9e5(std::uint32_t code, float* rgb) {
  const float scale = std::ldexp(1.f, static_cast<int>(code >> 27) - kB - kN);
  for (int c = 0; c < 3; ++c) rgb[c] = static_cast<float>(code >> (9 * c) & 0x1FF) * scale;
}

float half_to_float(std::uint16_t half) {
  const float magnitude = Half::value(half & 0x7FFFu);
  return (half & 0x8000u) != 0 ? -magnitude : magnitude;
}

TexelFormat texel_format(PixelType type, bool srgb) {
  switch (type) {
    case PixelType::float32: return {.type = type, .channels = 4, .bytes = 16};
    case PixelType::uint8: return {.type = type, .channels = 4, .bytes = 4, .srgb = srgb};
    case PixelType::r11g11b10f:
    case PixelType::rgb9e5: return {.type = type, .channels = 3, .bytes = 4};
    case PixelType::bc6h: return {.type = type, .channels = 3, .bytes = 16};
    default: return {.type = PixelType::half, .channels = 4, .bytes = 8};
  }
}

std::uint32_t number_of(std::span<const NumberedFormat> table, const TexelFormat& format) {
  for (const auto& [number, known] : table) {
    if (known.type == format.type && known.channels == format.channels && known.srgb == format.srgb) return number;
  }
  return 0;
}

const TexelFormat* format_numbered(std::span<const NumberedFormat> table, std::uint32_t number) {
  for (const NumberedFormat& known : table) {
    if (known.number == number) return &known.format;
  }
  return nullptr;
}

std::uint64_t row_bytes(const TexelFormat& format, int width) {
  const auto block = static_cast<std::uint64_t>(format.block());
  return (static_cast<std::uint64_t>(width) + block - 1) / block * static_cast<std::uint64_t>(format.bytes);
}

std::uint64_t surface_bytes(const TexelFormat& format, int width, int height) {
  const auto block = static_cast<std::uint64_t>(format.block());
  return row_bytes(format, width) * ((static_cast<std::uint64_t>(height) + block - 1) / block);
}

std::vector<std::uint8_t> encode_surface(const Picture& picture, const TexelFormat& format,
                                         const EncodeOptions& options, WriteReport& report) {
  const Image& image = picture.image;
  std::vector<std::uint8_t> bytes(surface_bytes(format, image.width(), image.height()));
  if (format.type == PixelType::bc6h) {
    encode_blocks(picture, options, bytes.data(), report);
  } else if (format.type == PixelType::uint8) {
    encode_integers(picture, options, bytes.data(), report);
  } else {
    encode_floats(picture, format.type, bytes.data(), row_bytes(format, image.width()), report);
  }
  return bytes;
}

Channels channels_of(const TexelFormat& format) {
  if (format.channels == 2) return {.names = {"R", "G"}};
  return Channels::standard(format.has_alpha() ? 4 : std::min(format.channels, 3));
}

PixelType element_of(const TexelFormat& format) { return is_integer(format.type) ? format.type : PixelType::float32; }

void decode_surface(const std::uint8_t* bytes, const TexelFormat& format, int width, int height, int channels,
                    void* elements) {
  if (format.code != BlockCode::none)
    return decode_blocks(bytes, format.code, format.is_signed, width, height, channels, elements);
  const std::size_t texels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  switch (format.type) {
    case PixelType::bc6h: decode_bc6h(bytes, width, height, format.is_signed, static_cast<float*>(elements)); break;
    case PixelType::uint8:
      decode_integers(bytes, format, texels, channels, static_cast<std::uint8_t*>(elements));
      break;
    case PixelType::uint16:
      decode_integers(bytes, format, texels, channels, static_cast<std::uint16_t*>(elements));
      break;
    default:
      auto* to = static_cast<float*>(elements);
      for (std::size_t i = 0; i < texels; ++i, bytes += format.bytes, to += channels) {
        decode_texel(bytes, format, channels, to);
      }
  }
}

}  // namespace envconv
