// SPDX-License-Identifier: Apache-2.0
// Texels of the formats that engines load: codes of packed floats, and pictures to and from the bytes of a surface.
// Internal: not installed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "bc6h.h"
#include "block_code.h"
#include "decoder.h"
#include "io.h"

namespace envconv {

// Packed floats.  Values beyond the range become its ends; NaN and negative values become 0.

/// Unsigned floats of 5 exponent bits (bias 15), 6 mantissa bits for red and green and 5 for blue, red in the lowest
/// bits (Khronos Data Format Specification 1.3, sections 10.2 and 10.3).  Rounded to nearest, ties to even; the largest
/// are 65024 and 64512.
std::uint32_t pack_r11g11b10f(float r, float g, float b);
/// rgb[3].  Codes of infinity and NaN, which pack_r11g11b10f never makes, come out as such.
void unpack_r11g11b10f(std::uint32_t code, float* rgb);

/// Three 9-bit mantissas, red in the lowest bits, and above them one exponent (bias 15), rounded as the specification's
/// formula does, ties up (EXT_texture_shared_exponent; Vulkan, section "RGB to Shared Exponent Conversion").  The
/// largest value is 65408.
std::uint32_t pack_rgb9e5(float r, float g, float b);
/// rgb[3].
void unpack_rgb9e5(std::uint32_t code, float* rgb);

float half_to_float(std::uint16_t half);

/// How the texels of a surface are stored.
struct TexelFormat {
  /// half, float32, uint8, uint16, r11g11b10f, rgb9e5 or bc6h; in `bytes` together with `channels`.  Of blocks of
  /// integers what they decode to, uint8 or, with a sign, float32.
  PixelType type = PixelType::half;
  int channels = 4;        ///< stored: R G B and perhaps A; of bc4 and bc5 one and two
  int bytes = 8;           ///< of a texel, or of a block
  bool srgb = false;       ///< integers along sRGB's curve
  bool bgr = false;        ///< blue comes first
  bool padded = false;     ///< the last of four channels means nothing
  bool is_signed = false;  ///< of bc6h, bc4 and bc5
  BlockCode code = BlockCode::none;

  int block() const { return type == PixelType::bc6h || code != BlockCode::none ? 4 : 1; }  ///< texels on a side
  bool has_alpha() const { return channels == 4 && !padded; }
};

/// The format of blocks of integers.
enum class BlockValues { linear, srgb, with_sign };
constexpr TexelFormat block_format(BlockCode code, BlockValues values = BlockValues::linear) {
  const bool is_signed = values == BlockValues::with_sign;
  return {.type = is_signed ? PixelType::float32 : PixelType::uint8,
          .channels = code == BlockCode::bc4   ? 1
                      : code == BlockCode::bc5 ? 2
                                               : 4,
          .bytes = code == BlockCode::bc1 || code == BlockCode::bc4 ? 8 : 16,
          .srgb = values == BlockValues::srgb,
          .is_signed = is_signed,
          .code = code};
}
/// BC1 whose fourth channel means nothing.
constexpr TexelFormat without_alpha(TexelFormat format) {
  format.padded = true;
  return format;
}

/// The format in which pictures of `type` are written: four channels where it has alpha.
TexelFormat texel_format(PixelType type, bool srgb);

/// A format as an interface numbers it: a DXGI_FORMAT, a VkFormat.
struct NumberedFormat {
  std::uint32_t number;
  TexelFormat format;
};
/// The number of what texel_format() gives, the first in the table of its type, channels and curve; 0 when it has none.
std::uint32_t number_of(std::span<const NumberedFormat> table, const TexelFormat& format);
/// The format of a number, or nullptr.
const TexelFormat* format_numbered(std::span<const NumberedFormat> table, std::uint32_t number);

/// Bytes of a row of blocks and of a surface of width x height texels, both at least 1 and below 2^31.
std::uint64_t row_bytes(const TexelFormat& format, int width);
std::uint64_t surface_bytes(const TexelFormat& format, int width, int height);

/// What becomes of a picture that is written.
struct EncodeOptions {
  Bc6hEffort effort = Bc6hEffort::normal;
  Encoding encoding = Encoding::srgb;
  int threads = 0;
};

/// A picture of 1 (grey), 2 (grey, alpha), 3 or 4 channels as the bytes of a surface in the format texel_format()
/// gives. A format with alpha gets 1 where the picture has none.  Floats are associated with alpha, integers are not.
/// What does not fit is counted in the report.
std::vector<std::uint8_t> encode_surface(const Picture& picture, const TexelFormat& format,
                                         const EncodeOptions& options, WriteReport& report);

/// The names of what is stored: Y, R and G, RGB or RGBA.
Channels channels_of(const TexelFormat& format);

/// What decode_surface() delivers of a format: float32, or uint8 and uint16 as stored.
PixelType element_of(const TexelFormat& format);

/// The surface's texels as [height][width][channels] elements, the first `channels` of the stored ones (3 of 4, or
/// all). `bytes` are surface_bytes() of any content.
void decode_surface(const std::uint8_t* bytes, const TexelFormat& format, int width, int height, int channels,
                    void* elements);

}  // namespace envconv
