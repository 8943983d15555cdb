// SPDX-License-Identifier: Apache-2.0
#include "ktx2_descriptor.h"

#include <bit>

#include "texture_file.h"

namespace envconv {
namespace {

// The first of a type (and curve) is what is written.
constexpr NumberedFormat kFormats[] = {
    {23, {.type = PixelType::uint8, .channels = 3, .bytes = 3}},                             // R8G8B8_UNORM
    {29, {.type = PixelType::uint8, .channels = 3, .bytes = 3, .srgb = true}},               // R8G8B8_SRGB
    {37, {.type = PixelType::uint8, .channels = 4, .bytes = 4}},                             // R8G8B8A8_UNORM
    {43, {.type = PixelType::uint8, .channels = 4, .bytes = 4, .srgb = true}},               // R8G8B8A8_SRGB
    {44, {.type = PixelType::uint8, .channels = 4, .bytes = 4, .bgr = true}},                // B8G8R8A8_UNORM
    {50, {.type = PixelType::uint8, .channels = 4, .bytes = 4, .srgb = true, .bgr = true}},  // B8G8R8A8_SRGB
    {84, {.type = PixelType::uint16, .channels = 3, .bytes = 6}},                            // R16G16B16_UNORM
    {90, {.type = PixelType::half, .channels = 3, .bytes = 6}},                              // R16G16B16_SFLOAT
    {91, {.type = PixelType::uint16, .channels = 4, .bytes = 8}},                            // R16G16B16A16_UNORM
    {97, {.type = PixelType::half, .channels = 4, .bytes = 8}},                              // R16G16B16A16_SFLOAT
    {106, {.type = PixelType::float32, .channels = 3, .bytes = 12}},                         // R32G32B32_SFLOAT
    {109, {.type = PixelType::float32, .channels = 4, .bytes = 16}},                         // R32G32B32A32_SFLOAT
    {122, {.type = PixelType::r11g11b10f, .channels = 3, .bytes = 4}},                       // B10G11R11_UFLOAT_PACK32
    {123, {.type = PixelType::rgb9e5, .channels = 3, .bytes = 4}},                           // E5B9G9R9_UFLOAT_PACK32
    {143, {.type = PixelType::bc6h, .channels = 3, .bytes = 16}},                            // BC6H_UFLOAT_BLOCK
    {144, {.type = PixelType::bc6h, .channels = 3, .bytes = 16, .is_signed = true}},         // BC6H_SFLOAT_BLOCK
    {131, without_alpha(block_format(BlockCode::bc1))},                                      // BC1_RGB_UNORM_BLOCK
    {132, without_alpha(block_format(BlockCode::bc1, BlockValues::srgb))},
    {133, block_format(BlockCode::bc1)},  // BC1_RGBA_UNORM_BLOCK
    {134, block_format(BlockCode::bc1, BlockValues::srgb)},
    {135, block_format(BlockCode::bc2)},
    {136, block_format(BlockCode::bc2, BlockValues::srgb)},
    {137, block_format(BlockCode::bc3)},
    {138, block_format(BlockCode::bc3, BlockValues::srgb)},
    {139, block_format(BlockCode::bc4)},
    {140, block_format(BlockCode::bc4, BlockValues::with_sign)},
    {141, block_format(BlockCode::bc5)},
    {142, block_format(BlockCode::bc5, BlockValues::with_sign)},
    {145, block_format(BlockCode::bc7)},
    {146, block_format(BlockCode::bc7, BlockValues::srgb)},
};

// Names of the data format specification.
enum : std::uint32_t {
  kModelRgbsda = 1,
  kModelBc1 = 128,  // BC2 to BC7 follow
  kModelBc6h = 133,
  kModelBc7 = 134,
  kTransferLinear = 1,
  kTransferSrgb = 2,
  kFlagPremultiplied = 1,
  kChannelAlpha = 15,
  // Qualifiers, above a channel's four bits.
  kLinear = 0x10,
  kExponent = 0x20,
  kSigned = 0x40,
  kFloat = 0x80
};

struct Sample {
  std::uint32_t offset, bits, channel, lower, upper;  // channel: with its qualifiers
};

// Of blocks: alpha apart where it is, and each channel of BC4 and BC5.
std::vector<Sample> samples_of_blocks(const TexelFormat& format) {
  const std::uint32_t lower = format.is_signed ? 0x80000000u : 0, upper = format.is_signed ? 0x7FFFFFFFu : 0xFFFFFFFFu,
                      sign = format.is_signed ? std::uint32_t{kSigned} : 0;
  const std::uint32_t of_alpha = kChannelAlpha | (format.srgb ? std::uint32_t{kLinear} : 0);
  switch (format.code) {
    case BlockCode::bc1: return {{0, 64, format.padded ? 0u : 1u, lower, upper}};  // 1: with alpha
    case BlockCode::bc2:
    case BlockCode::bc3: return {{0, 64, of_alpha, lower, upper}, {64, 64, 0, lower, upper}};
    case BlockCode::bc4: return {{0, 64, sign, lower, upper}};
    case BlockCode::bc5: return {{0, 64, sign, lower, upper}, {64, 64, 1 | sign, lower, upper}};
    default: return {{0, 128, 0, lower, upper}};
  }
}

std::uint32_t model_of(const TexelFormat& format) {
  if (format.type == PixelType::bc6h) return kModelBc6h;
  if (format.code == BlockCode::bc7) return kModelBc7;
  return format.code == BlockCode::none
             ? std::uint32_t{kModelRgbsda}
             : kModelBc1 + static_cast<std::uint32_t>(format.code) - static_cast<std::uint32_t>(BlockCode::bc1);
}

// Floats range over [-1, 1] or, without sign, [0, 1]; integers over their codes.
std::vector<Sample> samples_of(const TexelFormat& format) {
  if (format.code != BlockCode::none) return samples_of_blocks(format);
  const std::uint32_t one = std::bit_cast<std::uint32_t>(1.f), minus_one = std::bit_cast<std::uint32_t>(-1.f);
  switch (format.type) {
    case PixelType::bc6h:
      if (format.is_signed) return {{0, 128, kFloat | kSigned, minus_one, one}};
      return {{0, 128, kFloat, 0, one}};
    case PixelType::r11g11b10f:
      return {{0, 11, kFloat, 0, one}, {11, 11, kFloat | 1, 0, one}, {22, 10, kFloat | 2, 0, one}};
    case PixelType::rgb9e5: {
      // A mantissa and the exponent (bias 15, at most 31) for each; 8448 is the mantissa's code of 1 at that exponent.
      std::vector<Sample> samples;
      for (std::uint32_t c = 0; c < 3; ++c) {
        samples.push_back({9 * c, 9, c, 0, 8448});
        samples.push_back({27, 5, c | kExponent, 15, 31});
      }
      return samples;
    }
    default: break;
  }
  const std::uint32_t bits = static_cast<std::uint32_t>(8 * format.bytes / format.channels);
  const bool real = !(format.type == PixelType::uint8 || format.type == PixelType::uint16);
  std::vector<Sample> samples;
  for (std::uint32_t i = 0; i < static_cast<std::uint32_t>(format.channels); ++i) {
    std::uint32_t channel = i == 3 ? kChannelAlpha : format.bgr ? 2 - i : i;
    if (real) channel |= kFloat | kSigned;
    if (i == 3 && format.srgb) channel |= kLinear;  // alpha has no curve
    samples.push_back({bits * i, bits, channel, real ? minus_one : 0, real ? one : (1u << bits) - 1});
  }
  return samples;
}

}  // namespace

std::uint32_t vk_format(const TexelFormat& format) { return number_of(kFormats, format); }
const TexelFormat* format_of_vk(std::uint32_t number) { return format_numbered(kFormats, number); }

std::uint32_t type_size(const TexelFormat& format) {
  if (format.block() > 1) return 1;
  switch (format.type) {
    case PixelType::uint8: return 1;
    case PixelType::half:
    case PixelType::uint16: return 2;
    default: return 4;
  }
}

std::vector<std::uint32_t> make_descriptor(const TexelFormat& format, bool premultiplied, std::uint32_t primaries) {
  const std::vector<Sample> samples = samples_of(format);
  const auto block_size = static_cast<std::uint32_t>(24 + 16 * samples.size());
  const bool blocks = format.block() > 1;
  std::vector<std::uint32_t> words;
  words.push_back(4 + block_size);
  words.push_back(0);  // Khronos, basic
  words.push_back(2u | block_size << 16);
  words.push_back(model_of(format) | primaries << 8 | (format.srgb ? kTransferSrgb : kTransferLinear) << 16 |
                  (premultiplied ? kFlagPremultiplied : 0u) << 24);
  words.push_back(blocks ? 0x0303u : 0u);  // a block's size less one
  words.push_back(static_cast<std::uint32_t>(format.bytes));
  words.push_back(0);
  for (const Sample& sample : samples) {
    words.push_back(sample.offset | (sample.bits - 1) << 16 | sample.channel << 24);
    words.push_back(0);  // in the middle of the texel
    words.push_back(sample.lower);
    words.push_back(sample.upper);
  }
  return words;
}

Result<DescriptorFacts> check_descriptor(std::span<const std::uint8_t> bytes, const TexelFormat& format) {
  const std::vector<std::uint32_t> expected = make_descriptor(format, false);
  const Error wrong = damaged_texture("its data format descriptor is not that of its format");
  if (bytes.size() < 28 || bytes.size() % 4 != 0) return wrong;
  const auto word = [&](std::size_t i) { return little_endian<std::uint32_t>(bytes.data() + 4 * i); };
  // More blocks may follow the basic one.
  if (word(0) != bytes.size() || (word(1) & 0x1FFFF) != 0 || word(2) >> 16 != expected[0] - 4) return wrong;
  if (bytes.size() < expected[0]) return wrong;
  if ((word(3) & 0xFF) != (expected[3] & 0xFF) || word(4) != expected[4]) return wrong;
  // Once, the size of a texel was to be 0 in files that are compressed.
  if (word(5) != expected[5] && word(5) != 0) return wrong;
  // Of samples: place, size and meaning.  Ranges have been written in several ways, and alpha's being linear is
  // implied.
  for (std::size_t i = 7; i < expected.size(); i += 4) {
    constexpr std::uint32_t kMask = ~(std::uint32_t{kLinear} << 24);
    if ((word(i) & kMask) != (expected[i] & kMask)) return wrong;
  }
  DescriptorFacts facts;
  const std::uint32_t transfer = word(3) >> 16 & 0xFF;
  if (transfer > kTransferSrgb) {
    return Error{ErrorCode::input, "its values follow transfer function " + std::to_string(transfer) +
                                       " of the data format specification, which is not supported"};
  }
  facts.srgb = transfer == kTransferSrgb || (transfer == 0 && format.srgb);
  facts.primaries = word(3) >> 8 & 0xFF;
  facts.premultiplied = (word(3) >> 24 & kFlagPremultiplied) != 0;
  return facts;
}

}  // namespace envconv
