// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <string>

#include "io_shared.h"
#include "ktx.h"

namespace envconv {
namespace {

constexpr std::array<std::uint8_t, 12> kIdentifier{0xAB, 'K', 'T', 'X', ' ', '1', '1', 0xBB, '\r', '\n', 0x1A, '\n'};
constexpr std::uint32_t kEndianness = 0x04030201, kSwapped = 0x01020304;
constexpr std::size_t kHeaderSize = 64;

// OpenGL's numbers of a format.  The format without channels of its own, GL_RGB or GL_RGBA, is the base of each.
struct GlFormat {
  std::uint32_t type, type_size, internal;
  TexelFormat format;
};
constexpr GlFormat kFormats[] = {
    {0x140B, 2, 0x881A, {.type = PixelType::half, .channels = 4, .bytes = 8}},                 // RGBA16F
    {0x1406, 4, 0x8814, {.type = PixelType::float32, .channels = 4, .bytes = 16}},             // RGBA32F
    {0x8C3B, 4, 0x8C3A, {.type = PixelType::r11g11b10f, .channels = 3, .bytes = 4}},           // R11F_G11F_B10F
    {0x8C3E, 4, 0x8C3D, {.type = PixelType::rgb9e5, .channels = 3, .bytes = 4}},               // RGB9_E5
    {0x1401, 1, 0x8058, {.type = PixelType::uint8, .channels = 4, .bytes = 4}},                // RGBA8
    {0x1401, 1, 0x8C43, {.type = PixelType::uint8, .channels = 4, .bytes = 4, .srgb = true}},  // SRGB8_ALPHA8
    {0, 1, 0x8E8F, {.type = PixelType::bc6h, .channels = 3, .bytes = 16}},                     // BPTC_UNSIGNED_FLOAT
    {0, 1, 0x8E8E, {.type = PixelType::bc6h, .channels = 3, .bytes = 16, .is_signed = true}},  // BPTC_SIGNED_FLOAT
    {0, 1, 0x83F0, without_alpha(block_format(BlockCode::bc1))},                               // RGB_S3TC_DXT1
    {0, 1, 0x83F1, block_format(BlockCode::bc1)},
    {0, 1, 0x83F2, block_format(BlockCode::bc2)},
    {0, 1, 0x83F3, block_format(BlockCode::bc3)},
    {0, 1, 0x8C4C, without_alpha(block_format(BlockCode::bc1, BlockValues::srgb))},
    {0, 1, 0x8C4D, block_format(BlockCode::bc1, BlockValues::srgb)},
    {0, 1, 0x8C4E, block_format(BlockCode::bc2, BlockValues::srgb)},
    {0, 1, 0x8C4F, block_format(BlockCode::bc3, BlockValues::srgb)},
    {0, 1, 0x8DBB, block_format(BlockCode::bc4)},  // RED_RGTC1
    {0, 1, 0x8DBC, block_format(BlockCode::bc4, BlockValues::with_sign)},
    {0, 1, 0x8DBD, block_format(BlockCode::bc5)},
    {0, 1, 0x8DBE, block_format(BlockCode::bc5, BlockValues::with_sign)},
    {0, 1, 0x8E8C, block_format(BlockCode::bc7)},  // RGBA_BPTC_UNORM
    {0, 1, 0x8E8D, block_format(BlockCode::bc7, BlockValues::srgb)},
};
constexpr std::uint32_t kRgb = 0x1907, kRgba = 0x1908;

std::uint32_t base_format(const TexelFormat& format) { return format.channels == 4 ? kRgba : kRgb; }

constexpr std::uint64_t padded(std::uint64_t size) { return (size + 3) / 4 * 4; }

class Ktx1Decoder final : public TextureDecoder {
 public:
  using TextureDecoder::TextureDecoder;

  Result<Ok> open() {
    ENVCONV_TRY(const std::uint64_t size, file_size());
    if (size < kHeaderSize) return truncated_texture();
    std::array<std::uint8_t, kHeaderSize> header{};
    ENVCONV_CHECK(read_at(0, header.data(), header.size()));
    const auto word = [&](std::size_t i) { return little_endian<std::uint32_t>(header.data() + 12 + 4 * i); };
    if (!std::equal(kIdentifier.begin(), kIdentifier.end(), header.begin())) {
      return Error{ErrorCode::input, "not a KTX file"};
    }
    if (word(0) == kSwapped) return Error{ErrorCode::input, "a big-endian KTX file, which is not supported"};
    if (word(0) != kEndianness) return damaged_texture("a bad KTX header");
    TextureFacts facts;
    const auto known = std::find_if(std::begin(kFormats), std::end(kFormats), [&](const GlFormat& format) {
      return format.internal == word(4) && format.type == word(1) &&
             word(3) == (format.type == 0 ? 0 : base_format(format.format));
    });
    if (known == std::end(kFormats)) {
      return Error{ErrorCode::input, "a KTX file of texels in OpenGL format " + std::to_string(word(4)) +
                                         ", which is not supported (RGBA16F, RGBA32F, R11F_G11F_B10F, RGB9_E5, RGBA8 "
                                         "and BC1 to BC7 are)"};
    }
    facts.format = known->format;
    facts.premultiplied = !is_integer(facts.format.type);  // the specification does not say
    if (word(2) != known->type_size) return damaged_texture("its type size is not that of its format");
    TextureShape shape;
    const auto positive = [](std::uint32_t v) { return static_cast<int>(std::min<std::uint32_t>(v, 0x7FFFFFFF)); };
    if (word(8) != 0 || word(7) == 0) {
      return Error{ErrorCode::input, "a KTX file that is no two-dimensional texture but a volume or a line"};
    }
    if (word(10) != 1 && word(10) != 6) return damaged_texture("it claims " + std::to_string(word(10)) + " faces");
    shape.size = {positive(word(6)), positive(word(7))};
    shape.cube = word(10) == 6;
    if (shape.cube && word(9) > 1) {
      return Error{ErrorCode::input, "holds " + std::to_string(word(9)) + " cube maps, where one was expected"};
    }
    shape.pictures = shape.cube ? 6 : std::max(positive(word(9)), 1);
    shape.levels = std::max(positive(word(11)), 1);
    if (word(12) > (1u << 20) || word(12) > size - kHeaderSize) {
      return damaged_texture("its keys and values lie outside the file, or are too many");
    }
    ENVCONV_TRY(const std::vector<std::uint8_t> pairs, TextureDecoder::read_at(kHeaderSize, std::uint64_t{word(12)}));
    Metadata more;
    ENVCONV_CHECK(unpack_key_values(pairs, spec_.metadata, more));
    if (const auto alpha = spec_.metadata.find("envconv:alpha"); alpha != spec_.metadata.end()) {
      facts.opaque = alpha->second == "opaque";
      spec_.metadata.erase(alpha);
    }
    if (is_integer(facts.format.type)) spec_.color_how = "internal format";
    ENVCONV_CHECK(describe(shape, facts));
    return find_level(kHeaderSize + word(12), size, word(9) == 0 && shape.cube);
  }

 private:
  // Levels follow each other, each with its size in front: that of one face for a cube map.
  Result<Ok> find_level(std::uint64_t at, std::uint64_t file_size, bool size_of_face) {
    for (int level = 0; level < shape_.levels; ++level) {
      const Size here = size_of_level(shape_.size, level);
      const std::uint64_t one = surface_bytes(facts_.format, here.width, here.height);
      const std::uint64_t all = padded(one) * static_cast<std::uint64_t>(shape_.pictures);
      if (at > file_size || file_size - at < 4 || file_size - at - 4 < all) return truncated_texture();
      std::array<std::uint8_t, 4> bytes{};
      ENVCONV_CHECK(read_at(at, bytes.data(), bytes.size()));
      const std::uint64_t claimed = little_endian<std::uint32_t>(bytes.data());
      if (claimed != (size_of_face ? one : all)) {
        return damaged_texture("level " + std::to_string(level) + " has not the size that its texels need");
      }
      if (level == level_) offset_ = at + 4;
      at += 4 + padded(all);
    }
    if (at < file_size) return damaged_texture("it goes on behind its last level");
    return Ok{};
  }

  Result<std::vector<std::uint8_t>> read_surface(int picture) override {
    const Size here = size_of_level(shape_.size, level_);
    const std::uint64_t one = surface_bytes(facts_.format, here.width, here.height);
    return TextureDecoder::read_at(offset_ + static_cast<std::uint64_t>(picture) * padded(one), one);
  }

  std::uint64_t offset_ = 0;
};

std::string head_of(const TextureShape& shape, const TexelFormat& format, const std::string& pairs) {
  const auto known = std::find_if(std::begin(kFormats), std::end(kFormats), [&](const GlFormat& candidate) {
    return candidate.format.type == format.type && candidate.format.srgb == format.srgb;
  });
  ByteWriter out;
  out.text({reinterpret_cast<const char*>(kIdentifier.data()), kIdentifier.size()});
  out.u32(kEndianness);
  out.u32(known->type);
  out.u32(known->type_size);
  out.u32(known->type == 0 ? 0 : base_format(format));
  out.u32(known->internal);
  out.u32(base_format(format));
  out.u32(static_cast<std::uint32_t>(shape.size.width));
  out.u32(static_cast<std::uint32_t>(shape.size.height));
  out.u32(0);                                                                                   // depth
  out.u32(shape.cube || shape.pictures == 1 ? 0 : static_cast<std::uint32_t>(shape.pictures));  // array elements
  out.u32(shape.cube ? 6 : 1);
  out.u32(static_cast<std::uint32_t>(shape.levels));
  out.u32(static_cast<std::uint32_t>(pairs.size()));
  out.text(pairs);
  return out.bytes();
}

}  // namespace

Result<std::unique_ptr<Decoder>> open_ktx1(int fd, const DecoderOptions& options) {
  auto decoder = std::make_unique<Ktx1Decoder>(fd, options);
  ENVCONV_CHECK(decoder->open());
  return std::unique_ptr<Decoder>(std::move(decoder));
}

Result<Ok> write_ktx1(OutputFile& file, std::span<const std::vector<Picture>> levels, const WriteOptions& options,
                      const TextureCompression& compression, WriteReport& report) {
  ENVCONV_TRY(const TextureShape shape, shape_of(levels, options.cube));
  const TexelFormat format = texel_format(report.type, stored_color(options, report.type).transfer == Transfer::srgb);
  const bool alpha = levels.front().front().channels.alpha >= 0;
  Metadata more{{"KTXorientation", "S=r,T=d"}, {"KTXwriter", texture_writer()}};
  if (format.has_alpha() && !alpha) more["envconv:alpha"] = "opaque";
  const std::string head = head_of(shape, format, pack_key_values(options.metadata, more));
  file.write(head.data(), head.size());
  const EncodeOptions how{compression.effort, options.encoding, options.threads};
  for (std::size_t level = 0; level < levels.size(); ++level) {
    const Size here = size_of_level(shape.size, static_cast<int>(level));
    const std::uint64_t one = surface_bytes(format, here.width, here.height);
    const std::uint64_t claimed = shape.cube ? one : padded(one) * static_cast<std::uint64_t>(shape.pictures);
    if (claimed > 0xFFFFFFFFu)
      return Error{ErrorCode::unsupported, "a KTX file cannot hold a level of 4 GB (KTX2 can)"};
    ByteWriter size;
    size.u32(static_cast<std::uint32_t>(claimed));
    file.write(size.bytes().data(), size.size());
    for (const Picture& picture : levels[level]) {
      const std::vector<std::uint8_t> bytes = encode_surface(picture, format, how, report);
      file.write(bytes.data(), bytes.size());
      pad_file(file, 4);
    }
  }
  return Ok{};
}

}  // namespace envconv
