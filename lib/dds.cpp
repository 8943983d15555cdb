// SPDX-License-Identifier: Apache-2.0
#include "dds.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <string>

#include "io_shared.h"

namespace envconv {
namespace {

// --- the header ----------------------------------------------------------------------------------------------------

constexpr std::uint32_t fourcc(const char (&text)[5]) {
  std::uint32_t code = 0;
  for (int i = 0; i < 4; ++i) code |= static_cast<std::uint32_t>(static_cast<unsigned char>(text[i])) << (8 * i);
  return code;
}

constexpr std::size_t kHeaderSize = 128, kExtensionSize = 20;  // with the four bytes of "DDS "
constexpr std::size_t kReservedAt = 32, kReservedSize = 44;

enum : std::uint32_t {
  // dwFlags
  kCaps = 0x1,
  kHeight = 0x2,
  kWidth = 0x4,
  kPitch = 0x8,
  kPixelFormat = 0x1000,
  kMipMapCount = 0x20000,
  kLinearSize = 0x80000,
  // ddspf.dwFlags
  kAlphaPixels = 0x1,
  kFourCC = 0x4,
  kRgb = 0x40,
  // dwCaps
  kComplex = 0x8,
  kTexture = 0x1000,
  kMipMap = 0x400000,
  // dwCaps2
  kCubeMap = 0x200,
  kAllFaces = 0xFC00,
  kVolume = 0x200000,
  // DX10
  kTexture2D = 3,
  kTextureCube = 0x4,
  kAlphaStraight = 1,
  kAlphaPremultiplied = 2,
  kAlphaOpaque = 3
};

// The first of a type (and curve) is what is written.
constexpr NumberedFormat kFormats[] = {
    {2, {.type = PixelType::float32, .channels = 4, .bytes = 16}},                             // R32G32B32A32_FLOAT
    {6, {.type = PixelType::float32, .channels = 3, .bytes = 12}},                             // R32G32B32_FLOAT
    {10, {.type = PixelType::half, .channels = 4, .bytes = 8}},                                // R16G16B16A16_FLOAT
    {11, {.type = PixelType::uint16, .channels = 4, .bytes = 8}},                              // R16G16B16A16_UNORM
    {26, {.type = PixelType::r11g11b10f, .channels = 3, .bytes = 4}},                          // R11G11B10_FLOAT
    {28, {.type = PixelType::uint8, .channels = 4, .bytes = 4}},                               // R8G8B8A8_UNORM
    {29, {.type = PixelType::uint8, .channels = 4, .bytes = 4, .srgb = true}},                 // _SRGB
    {67, {.type = PixelType::rgb9e5, .channels = 3, .bytes = 4}},                              // R9G9B9E5_SHAREDEXP
    {87, {.type = PixelType::uint8, .channels = 4, .bytes = 4, .bgr = true}},                  // B8G8R8A8_UNORM
    {88, {.type = PixelType::uint8, .channels = 4, .bytes = 4, .bgr = true, .padded = true}},  // B8G8R8X8_UNORM
    {91, {.type = PixelType::uint8, .channels = 4, .bytes = 4, .srgb = true, .bgr = true}},    // B8G8R8A8_UNORM_SRGB
    {93, {.type = PixelType::uint8, .channels = 4, .bytes = 4, .srgb = true, .bgr = true, .padded = true}},
    {95, {.type = PixelType::bc6h, .channels = 3, .bytes = 16}},                     // BC6H_UF16
    {96, {.type = PixelType::bc6h, .channels = 3, .bytes = 16, .is_signed = true}},  // BC6H_SF16
    {71, block_format(BlockCode::bc1)},                                              // BC1_UNORM
    {72, block_format(BlockCode::bc1, BlockValues::srgb)},
    {74, block_format(BlockCode::bc2)},
    {75, block_format(BlockCode::bc2, BlockValues::srgb)},
    {77, block_format(BlockCode::bc3)},
    {78, block_format(BlockCode::bc3, BlockValues::srgb)},
    {80, block_format(BlockCode::bc4)},
    {81, block_format(BlockCode::bc4, BlockValues::with_sign)},  // BC4_SNORM
    {83, block_format(BlockCode::bc5)},
    {84, block_format(BlockCode::bc5, BlockValues::with_sign)},
    {98, block_format(BlockCode::bc7)},
    {99, block_format(BlockCode::bc7, BlockValues::srgb)},
};

// --- our line in the reserved words --------------------------------------------------------------------------------

// "ENVC", then the values of these keys with slashes between them, nothing for a usual one, zeros at the end.
constexpr std::string_view kMark = "ENVC";
struct NoteKey {
  const char* name;
  std::string_view usual;
};
constexpr NoteKey kNoteKeys[] = {{"envconv:layout", ""},    {"envconv:frame", "world"}, {"envconv:seam", "none"},
                                 {"envconv:size", ""},      {"envconv:level", ""},      {"envconv:packing", "parts"},
                                 {"envconv:colorspace", ""}};

std::string pack_note(const Metadata& metadata, const TexelFormat& format, WriteReport& report) {
  if (!metadata.contains("envconv:layout")) return {};
  const std::string_view usual_space = format.srgb ? kSrgbSpace : kLinearSpace;
  const auto note_without = [&](std::string_view left_out) {
    std::string note(kMark);
    for (const auto& [name, usual] : kNoteKeys) {
      const auto entry = metadata.find(name);
      const bool is_usual = entry != metadata.end() && (entry->second == usual || entry->second == usual_space);
      if (entry != metadata.end() && name != left_out && !is_usual) note += entry->second;
      note += '/';
    }
    note.erase(note.find_last_not_of('/') + 1);
    return note;
  };
  // The size can be told from the pictures, but for those with gutters.
  std::string note = note_without("");
  const auto seam = metadata.find("envconv:seam");
  const bool gutter = seam != metadata.end() && seam->second.compare(0, 6, "gutter") == 0;
  if (note.size() > kReservedSize && !gutter) note = note_without("envconv:size");
  if (note.size() <= kReservedSize) return note;
  report.warnings.push_back("the file's header has no room for envconv's attributes: the layout is not recorded");
  return {};
}

void unpack_note(std::string_view note, Metadata& metadata) {
  if (note.substr(0, kMark.size()) != kMark) return;
  note = note.substr(kMark.size());
  note = note.substr(0, note.find('\0'));
  for (const auto& [name, usual] : kNoteKeys) {
    // The last one may have slashes of its own.
    const bool last = std::string_view(name) == "envconv:colorspace";
    const std::string_view word = last ? note : note.substr(0, note.find('/'));
    if (!word.empty()) metadata[name] = std::string(word);
    if (word.size() == note.size()) break;
    note.remove_prefix(word.size() + 1);
  }
}

// --- reading -------------------------------------------------------------------------------------------------------

struct Header {
  std::uint32_t flags, height, width, pitch, mip_count, caps2;
  std::uint32_t pixel_flags, code, bits;
  std::array<std::uint32_t, 4> masks;  // red, green, blue, alpha
  bool extended = false;               // the rest is there
  std::uint32_t dxgi = 0, dimension = 0, misc = 0, array_size = 1, alpha_mode = 0;
};

// Direct3D 9's numbers in the place of a code: R16G16B16A16, the same of half, of float.
std::optional<std::uint32_t> dxgi_of_d3d9(std::uint32_t code) {
  if (code == 36) return 11;
  if (code == 113) return 10;
  if (code == 116) return 2;
  return std::nullopt;
}

// The sRGB one of the pair where there is one, since nothing else is said of the colour.
std::uint32_t dxgi_of_code(std::uint32_t code) {
  if (code == fourcc("DXT1")) return 72;
  if (code == fourcc("DXT2") || code == fourcc("DXT3")) return 75;
  if (code == fourcc("DXT4") || code == fourcc("DXT5")) return 78;
  if (code == fourcc("ATI1") || code == fourcc("BC4U")) return 80;
  if (code == fourcc("BC4S")) return 81;
  if (code == fourcc("ATI2") || code == fourcc("BC5U")) return 83;
  if (code == fourcc("BC5S")) return 84;
  return 0;
}

std::string code_text(std::uint32_t code) {
  std::string text;
  for (int i = 0; i < 4; ++i) text += static_cast<char>(code >> (8 * i) & 0xFF);
  const bool plain = std::all_of(text.begin(), text.end(), [](char c) { return c >= ' ' && c <= '~'; });
  return plain ? "\"" + text + "\"" : std::to_string(code);
}

Error not_supported(const std::string& format) {
  return {ErrorCode::input,
          "a DDS file of texels in " + format +
              ", which is not supported (half, float, 8-bit RGBA, R11G11B10F, RGB9E5 and BC1-BC7 are)"};
}

// Eight-bit channels by their masks.
Result<TexelFormat> format_of_masks(const Header& h) {
  TexelFormat format{.type = PixelType::uint8, .channels = static_cast<int>(h.bits / 8), .bytes = format.channels};
  format.srgb = true;
  const std::array<std::uint32_t, 3> rgb{0xFF, 0xFF00, 0xFF0000}, bgr{0xFF0000, 0xFF00, 0xFF};
  const std::array<std::uint32_t, 3> masks{h.masks[0], h.masks[1], h.masks[2]};
  format.bgr = masks == bgr;
  const bool alpha = (h.pixel_flags & kAlphaPixels) != 0;
  format.padded = !alpha;
  const bool good = (h.bits == 24 || h.bits == 32) && (masks == rgb || masks == bgr) &&
                    (!alpha || (h.bits == 32 && h.masks[3] == 0xFF000000));
  if (!good) return not_supported(std::to_string(h.bits) + " bits with other masks than those of 8-bit RGB or BGR");
  return format;
}

class DdsDecoder final : public TextureDecoder {
 public:
  using TextureDecoder::TextureDecoder;

  Result<Ok> open() {
    ENVCONV_TRY(const Header h, read_header());
    ENVCONV_CHECK(understand(h));
    ENVCONV_TRY(const std::uint64_t size, file_size());
    for (int level = 0; level < shape_.levels; ++level) {
      const Size here = size_of_level(shape_.size, level);
      if (level < level_) level_offset_ += surface_bytes(facts_.format, here.width, here.height);
      face_bytes_ += surface_bytes(facts_.format, here.width, here.height);
    }
    if (size < data_offset_ || face_bytes_ * static_cast<std::uint64_t>(shape_.pictures) > size - data_offset_) {
      return truncated_texture();
    }
    const std::uint64_t read = data_offset_ + face_bytes_ * static_cast<std::uint64_t>(shape_.pictures);
    return size > read ? judge_rest(h, size - read) : Ok{};
  }

 private:
  // Bytes after the last texel.  Some engines put data of their own there; but where they are as many as further levels
  // or pictures have, or where the header's pitch is of another size too, the texels are not where the header says.
  Result<Ok> judge_rest(const Header& h, std::uint64_t rest) {
    const Size size = shape_.size;
    const auto pictures = static_cast<std::uint64_t>(shape_.pictures);
    bool texels = rest % face_bytes_ == 0 || (!h.extended && rest == kExtensionSize);
    std::uint64_t further = 0;
    for (int level = shape_.levels; level < full_chain(size.width, size.height); ++level) {
      const Size here = size_of_level(size, level);
      further += surface_bytes(facts_.format, here.width, here.height);
      texels = texels || rest == further * pictures;
    }
    // Rows that a header with too small a height leaves over: of one level in one picture, as others have places too.
    if (shape_.levels == 1 && pictures == 1) texels = texels || rest % row_bytes(facts_.format, size.width) == 0;
    if ((h.flags & kPitch) != 0) texels = texels || h.pitch != row_bytes(facts_.format, size.width);
    if ((h.flags & kLinearSize) != 0) {
      texels = texels || h.pitch != surface_bytes(facts_.format, size.width, size.height);
    }
    const std::string much = std::to_string(rest) + " bytes after the last texel";
    if (texels) return damaged_texture(much + ", more than its header tells of");
    spec_.warnings.push_back("has " + much + ", which are not read");
    return Ok{};
  }

  Result<Header> read_header() {
    std::array<std::uint8_t, kHeaderSize + kExtensionSize> bytes{};
    ENVCONV_TRY(const std::uint64_t size, file_size());
    if (size < kHeaderSize) return truncated_texture();
    ENVCONV_CHECK(read_at(0, bytes.data(), kHeaderSize));
    const auto word = [&](std::size_t at) { return little_endian<std::uint32_t>(bytes.data() + at); };
    if (word(0) != fourcc("DDS ") || word(4) != 124 || word(76) != 32) return damaged_texture("a bad DDS header");
    Header h{};
    h.flags = word(8);
    h.height = word(12);
    h.width = word(16);
    h.pitch = word(20);
    h.mip_count = word(28);
    h.pixel_flags = word(80);
    h.code = word(84);
    h.bits = word(88);
    h.masks = {word(92), word(96), word(100), word(104)};
    h.caps2 = word(112);
    unpack_note({reinterpret_cast<const char*>(bytes.data()) + kReservedAt, kReservedSize}, spec_.metadata);
    data_offset_ = kHeaderSize;
    if ((h.pixel_flags & kFourCC) != 0 && h.code == fourcc("DX10")) {
      data_offset_ += kExtensionSize;
      if (size < data_offset_) return truncated_texture();
      ENVCONV_CHECK(read_at(kHeaderSize, bytes.data() + kHeaderSize, kExtensionSize));
      h.extended = true;
      h.dxgi = word(128);
      h.dimension = word(132);
      h.misc = word(136);
      h.array_size = word(140);
      h.alpha_mode = word(144) & 7;
    } else if (h.code == fourcc("DXT2") || h.code == fourcc("DXT4")) {
      h.alpha_mode = kAlphaPremultiplied;
    }
    return h;
  }

  Result<Ok> understand(const Header& h) {
    if ((h.extended && h.dimension != kTexture2D) || (h.caps2 & kVolume) != 0) {
      return Error{ErrorCode::input, "a DDS file that is no two-dimensional texture but a volume or a line"};
    }
    TextureShape shape;
    const auto positive = [](std::uint32_t v) { return static_cast<int>(std::min<std::uint32_t>(v, 0x7FFFFFFF)); };
    shape.size = {positive(h.width), positive(h.height)};
    shape.levels = std::max(positive(h.mip_count), 1);
    shape.cube = h.extended ? (h.misc & kTextureCube) != 0 : (h.caps2 & kCubeMap) != 0;
    if (!h.extended && shape.cube && (h.caps2 & kAllFaces) != kAllFaces) {
      return Error{ErrorCode::input, "a cube map that lacks some of its six faces"};
    }
    if (h.extended && shape.cube && h.array_size != 1) {
      return Error{ErrorCode::input, "holds " + std::to_string(h.array_size) + " cube maps, where one was expected"};
    }
    shape.pictures = shape.cube ? 6 : positive(h.array_size);
    TextureFacts facts;
    ENVCONV_TRY(facts.format, format_of(h));
    facts.opaque = h.alpha_mode == kAlphaOpaque;
    // Where nothing is said, floats are taken as they are: the alpha of many an environment is 0.
    facts.premultiplied = h.alpha_mode == kAlphaPremultiplied || (h.alpha_mode == 0 && !is_integer(facts.format.type));
    if (is_integer(facts.format.type) && h.extended) spec_.color_how = "DXGI format";
    if (facts.format.channels < 3 && !h.extended) spec_.color_how = "assumed for single channels";
    return describe(shape, facts);
  }

  Result<TexelFormat> format_of(const Header& h) {
    if ((h.pixel_flags & kFourCC) == 0) {
      if ((h.pixel_flags & kRgb) == 0) return not_supported("a format that is neither RGB nor compressed");
      return format_of_masks(h);
    }
    const std::uint32_t dxgi = h.extended ? h.dxgi : dxgi_of_d3d9(h.code).value_or(dxgi_of_code(h.code));
    if (const TexelFormat* known = format_numbered(kFormats, dxgi)) return *known;
    return not_supported(h.extended ? "DXGI format " + std::to_string(h.dxgi) : "FourCC " + code_text(h.code));
  }

  Result<std::vector<std::uint8_t>> read_surface(int picture) override {
    const Size here = size_of_level(shape_.size, level_);
    return TextureDecoder::read_at(data_offset_ + static_cast<std::uint64_t>(picture) * face_bytes_ + level_offset_,
                                   surface_bytes(facts_.format, here.width, here.height));
  }

  std::uint64_t data_offset_ = 0, level_offset_ = 0, face_bytes_ = 0;
};

// --- writing -------------------------------------------------------------------------------------------------------

std::string header_of(const TextureShape& shape, const TexelFormat& format, const std::string& note, bool alpha) {
  const bool blocks = format.block() > 1;
  ByteWriter out;
  out.text("DDS ");
  out.u32(124);
  out.u32(kCaps | kHeight | kWidth | kPixelFormat | (blocks ? kLinearSize : kPitch) |
          (shape.levels > 1 ? kMipMapCount : 0u));
  out.u32(static_cast<std::uint32_t>(shape.size.height));
  out.u32(static_cast<std::uint32_t>(shape.size.width));
  out.u32(static_cast<std::uint32_t>(blocks ? surface_bytes(format, shape.size.width, shape.size.height)
                                            : row_bytes(format, shape.size.width)));
  out.u32(0);  // depth
  out.u32(static_cast<std::uint32_t>(shape.levels));
  out.text(note);
  out.zeros(kReservedSize - note.size());
  out.u32(32);  // the pixel format
  out.u32(kFourCC);
  out.text("DX10");
  out.zeros(20);  // bits and masks
  const bool complex = shape.levels > 1 || shape.pictures > 1;
  out.u32(kTexture | (complex ? kComplex : 0u) | (shape.levels > 1 ? kMipMap : 0u));
  out.u32(shape.cube ? kCubeMap | kAllFaces : 0u);
  out.zeros(12);
  out.u32(number_of(kFormats, format));
  out.u32(kTexture2D);
  out.u32(shape.cube ? kTextureCube : 0u);
  out.u32(shape.cube ? 1u : static_cast<std::uint32_t>(shape.pictures));
  out.u32(!format.has_alpha()               ? 0u
          : !alpha                          ? kAlphaOpaque
          : format.type == PixelType::uint8 ? kAlphaStraight
                                            : kAlphaPremultiplied);
  return out.bytes();
}

}  // namespace

Result<std::unique_ptr<Decoder>> open_dds(int fd, const DecoderOptions& options) {
  auto decoder = std::make_unique<DdsDecoder>(fd, options);
  ENVCONV_CHECK(decoder->open());
  return std::unique_ptr<Decoder>(std::move(decoder));
}

Result<Ok> write_dds(OutputFile& file, std::span<const std::vector<Picture>> levels, const WriteOptions& options,
                     const TextureCompression& compression, WriteReport& report) {
  ENVCONV_TRY(const TextureShape shape, shape_of(levels, options.cube));
  const TexelFormat format = texel_format(report.type, stored_color(options, report.type).transfer == Transfer::srgb);
  const std::string header =
      header_of(shape, format, pack_note(options.metadata, format, report), levels.front().front().channels.alpha >= 0);
  file.write(header.data(), header.size());
  if (format.block() > 1 && (shape.size.width % 4 != 0 || shape.size.height % 4 != 0)) {
    report.warnings.push_back("Direct3D loads " + std::string(name_of(report.type)) +
                              " only of sizes that are multiples of 4");
  }
  const EncodeOptions how{compression.effort, options.encoding, options.threads};
  for (std::size_t picture = 0; picture < static_cast<std::size_t>(shape.pictures); ++picture) {
    for (const std::vector<Picture>& level : levels) {
      const std::vector<std::uint8_t> bytes = encode_surface(level[picture], format, how, report);
      file.write(bytes.data(), bytes.size());
    }
  }
  return Ok{};
}

}  // namespace envconv
