// SPDX-License-Identifier: Apache-2.0
#include <libdeflate.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <numeric>
#include <optional>
#include <span>
#include <string>

#include "io_shared.h"
#include "ktx.h"
#include "ktx2_descriptor.h"

namespace envconv {
namespace {

constexpr std::array<std::uint8_t, 12> kIdentifier{0xAB, 'K', 'T', 'X', ' ', '2', '0', 0xBB, '\r', '\n', 0x1A, '\n'};
constexpr std::size_t kHeaderSize = 80, kIndexEntry = 24;

// Where the data of a level must begin: not so when it is compressed.
std::uint64_t alignment_of(const TexelFormat& format, Supercompression scheme) {
  return scheme == Supercompression::none ? std::lcm<std::uint64_t>(static_cast<std::uint64_t>(format.bytes), 4) : 1;
}

std::string_view name_of(Supercompression scheme) {
  return scheme == Supercompression::zstd ? "zstd" : scheme == Supercompression::zlib ? "zlib" : "none";
}

// --- compression ---------------------------------------------------------------------------------------------------

Result<std::vector<std::uint8_t>> deflated(const std::vector<std::uint8_t>& from, int level) {
  libdeflate_compressor* compressor = libdeflate_alloc_compressor(level);
  if (!compressor) throw std::bad_alloc();
  std::vector<std::uint8_t> to(libdeflate_zlib_compress_bound(compressor, from.size()));
  to.resize(libdeflate_zlib_compress(compressor, from.data(), from.size(), to.data(), to.size()));
  libdeflate_free_compressor(compressor);
  if (to.empty()) return Error{ErrorCode::internal, "zlib compression failed"};
  return to;
}

// One frame of Zstandard, written as its bytes arrive.
class ZstandardFrame {
 public:
  // `size`: bytes that will be added.
  ZstandardFrame(OutputFile& file, std::uint64_t size, int level, int threads)
      : file_(file), context_(ZSTD_createCCtx()), out_(ZSTD_CStreamOutSize()) {
    if (!context_) throw std::bad_alloc();
    ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_compressionLevel, level);
    ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_checksumFlag, 1);  // else few damages are noticed
    // With one worker or many the bytes are the same, without any they are others.
    ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_nbWorkers, thread_count(threads));
    ZSTD_CCtx_setPledgedSrcSize(context_.get(), size);
  }
  Result<Ok> add(std::span<const std::uint8_t> bytes) { return compress(bytes, ZSTD_e_continue); }
  Result<Ok> end() { return compress({}, ZSTD_e_end); }

 private:
  Result<Ok> compress(std::span<const std::uint8_t> bytes, ZSTD_EndDirective what) {
    ZSTD_inBuffer in{bytes.data(), bytes.size(), 0};
    std::size_t left = 1;
    while (what == ZSTD_e_end ? left > 0 : in.pos < in.size) {
      ZSTD_outBuffer out{out_.data(), out_.size(), 0};
      left = ZSTD_compressStream2(context_.get(), &out, &in, what);
      if (ZSTD_isError(left)) return Error{ErrorCode::internal, std::string("zstd: ") + ZSTD_getErrorName(left)};
      file_.write(out_.data(), out.pos);
    }
    return Ok{};
  }

  struct Free {
    void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  };
  OutputFile& file_;
  std::unique_ptr<ZSTD_CCtx, Free> context_;
  std::vector<std::uint8_t> out_;
};

// Exactly `size` bytes, or an error: whatever the data claims, no more than that is made.
Result<std::vector<std::uint8_t>> inflated(const std::vector<std::uint8_t>& from, Supercompression scheme,
                                           std::uint64_t size) {
  std::vector<std::uint8_t> to(size);
  bool good;
  if (scheme == Supercompression::zstd) {
    good = ZSTD_decompress(to.data(), to.size(), from.data(), from.size()) == size;
  } else {
    libdeflate_decompressor* decompressor = libdeflate_alloc_decompressor();
    if (!decompressor) throw std::bad_alloc();
    // Without a place for the size made, fewer bytes are an error.
    std::size_t taken = 0;
    good = libdeflate_zlib_decompress_ex(decompressor, from.data(), from.size(), to.data(), to.size(), &taken,
                                         nullptr) == LIBDEFLATE_SUCCESS &&
           taken == from.size();
    libdeflate_free_decompressor(decompressor);
  }
  if (!good) return damaged_texture("a level does not unpack to its size");
  return to;
}

// --- reading -------------------------------------------------------------------------------------------------------

struct Extent {
  std::uint64_t offset, size;
};

class Ktx2Decoder final : public TextureDecoder {
 public:
  using TextureDecoder::TextureDecoder;

  Result<Ok> open() {
    ENVCONV_TRY(file_size_, file_size());
    if (file_size_ < kHeaderSize) return truncated_texture();
    std::array<std::uint8_t, kHeaderSize> header{};
    ENVCONV_CHECK(read_at(0, header.data(), header.size()));
    const auto word = [&](std::size_t i) { return little_endian<std::uint32_t>(header.data() + 12 + 4 * i); };
    if (!std::equal(kIdentifier.begin(), kIdentifier.end(), header.begin())) {
      return Error{ErrorCode::input, "not a KTX2 file"};
    }
    const TexelFormat* format = format_of_vk(word(0));
    if (!format) {
      return Error{ErrorCode::input, "a KTX2 file of texels in VkFormat " + std::to_string(word(0)) +
                                         ", which is not supported (half, float, 8- and 16-bit RGB, B10G11R11, "
                                         "E5B9G9R9 and BC1 to BC7 are)"};
    }
    facts_.format = *format;
    if (word(1) != type_size(*format)) return damaged_texture("its type size is not that of its format");
    ENVCONV_CHECK(read_shape(word(2), word(3), word(4), word(5), word(6), word(7)));
    if (word(8) != 0 && word(8) != 2 && word(8) != 3) {
      return Error{ErrorCode::input, word(8) == 1 ? std::string("compressed as Basis LZ, which is not supported")
                                                  : "of unknown supercompression " + std::to_string(word(8))};
    }
    scheme_ = static_cast<Supercompression>(word(8));
    spec_.compression = name_of(scheme_);
    const Extent descriptor{word(9), word(10)}, pairs{word(11), word(12)};
    const Extent global{little_endian<std::uint64_t>(header.data() + 64),
                        little_endian<std::uint64_t>(header.data() + 72)};
    if (global.size != 0) return damaged_texture("it has global data, which its compression does not use");
    ENVCONV_CHECK(read_descriptor(descriptor));
    ENVCONV_CHECK(read_pairs(pairs));
    // The level index has no other end (section 4).
    if (descriptor.offset != kHeaderSize + kIndexEntry * std::max<std::uint64_t>(word(7), 1))
      return damaged_texture("its levels are not as many as its level index has");
    const TextureShape shape = shape_;
    const TextureFacts facts = facts_;
    ENVCONV_CHECK(describe(shape, facts));
    return read_index({descriptor, pairs});
  }

 private:
  Result<Ok> read_shape(std::uint32_t width, std::uint32_t height, std::uint32_t depth, std::uint32_t layers,
                        std::uint32_t faces, std::uint32_t levels) {
    if (depth != 0 || height == 0) {
      return Error{ErrorCode::input, "a KTX2 file that is no two-dimensional texture but a volume or a line"};
    }
    if (faces != 1 && faces != 6) return damaged_texture("it claims " + std::to_string(faces) + " faces");
    if (faces == 6 && layers > 1) {
      return Error{ErrorCode::input, "holds " + std::to_string(layers) + " cube maps, where one was expected"};
    }
    const auto positive = [](std::uint32_t v) { return static_cast<int>(std::min<std::uint32_t>(v, 0x7FFFFFFF)); };
    shape_.size = {positive(width), positive(height)};
    shape_.levels = std::max(positive(levels), 1);  // 0: the program that loads it is to make them
    shape_.cube = faces == 6;
    shape_.pictures = shape_.cube ? 6 : std::max(positive(layers), 1);
    return Ok{};
  }

  bool is_inside(const Extent& part) const {
    return part.offset <= file_size_ && part.size <= file_size_ - part.offset;
  }

  Result<Ok> read_descriptor(const Extent& at) {
    if (at.offset < kHeaderSize || at.size > 4096 || !is_inside(at)) {
      return damaged_texture("its data format descriptor lies outside the file");
    }
    ENVCONV_TRY(const std::vector<std::uint8_t> bytes, TextureDecoder::read_at(at.offset, at.size));
    ENVCONV_TRY(const DescriptorFacts found, check_descriptor(bytes, facts_.format));
    facts_.format.srgb = found.srgb;
    facts_.premultiplied = found.premultiplied;
    for (const Primaries& known : all_primaries()) {
      if (known.khronos == 0 || static_cast<std::uint32_t>(known.khronos) != found.primaries) continue;
      spec_.primaries = known.xy;
      spec_.color_how = "data format descriptor";
    }
    return Ok{};
  }

  Result<Ok> read_pairs(const Extent& at) {
    if (at.size == 0 && at.offset != 0) return damaged_texture("its keys and values have a place and no size");
    if (at.size == 0) return Ok{};
    if (at.offset < kHeaderSize || at.size > (1u << 20) || !is_inside(at)) {
      return damaged_texture("its keys and values lie outside the file, or are too many");
    }
    ENVCONV_TRY(const std::vector<std::uint8_t> bytes, TextureDecoder::read_at(at.offset, at.size));
    Metadata more;
    ENVCONV_CHECK(unpack_key_values(bytes, spec_.metadata, more));
    if (more.contains("KTXcubemapIncomplete")) {
      return Error{ErrorCode::input, "a cube map that lacks some of its six faces"};
    }
    if (const auto alpha = spec_.metadata.find("envconv:alpha"); alpha != spec_.metadata.end()) {
      facts_.opaque = alpha->second == "opaque";
      spec_.metadata.erase(alpha);
    }
    // Right and down, unless it says otherwise; as Exif numbers it.
    const auto entry = more.find("KTXorientation");
    const std::string orientation = entry == more.end() ? "rd" : entry->second.substr(0, 2);
    if (shape_.cube && orientation != "rd") return damaged_texture("a cube map whose orientation is not \"rd\"");
    spec_.orientation = orientation == "ld" ? 2 : orientation == "lu" ? 3 : orientation == "ru" ? 4 : 1;
    if (spec_.orientation == 1 && orientation != "rd")
      return damaged_texture("its orientation is none of rd, ru, ld, lu");
    return Ok{};
  }

  std::uint64_t level_bytes(int level) const {
    const Size here = size_of_level(shape_.size, level);
    return surface_bytes(facts_.format, here.width, here.height) * static_cast<std::uint64_t>(shape_.pictures);
  }

  Result<Ok> read_index(std::vector<Extent> taken) {
    const std::uint64_t size = kIndexEntry * static_cast<std::uint64_t>(shape_.levels);
    if (size > file_size_ - kHeaderSize) return truncated_texture();
    taken.push_back({kHeaderSize, size});
    ENVCONV_TRY(const std::vector<std::uint8_t> index, TextureDecoder::read_at(kHeaderSize, size));
    for (int level = 0; level < shape_.levels; ++level) {
      const std::uint8_t* entry = index.data() + kIndexEntry * static_cast<std::size_t>(level);
      const Extent extent{little_endian<std::uint64_t>(entry), little_endian<std::uint64_t>(entry + 8)};
      const std::uint64_t unpacked = little_endian<std::uint64_t>(entry + 16);
      const std::string which = "level " + std::to_string(level);
      if (unpacked != level_bytes(level) || (scheme_ == Supercompression::none && extent.size != unpacked)) {
        return damaged_texture(which + " has not the size that its texels need");
      }
      if (extent.size == 0) return damaged_texture(which + " is empty");
      if (!is_inside(extent)) return truncated_texture();
      taken.push_back(extent);
      extents_.push_back(extent);
    }
    std::sort(taken.begin(), taken.end(), [](const Extent& a, const Extent& b) { return a.offset < b.offset; });
    for (std::size_t i = 1; i < taken.size(); ++i) {
      if (taken[i - 1].offset + taken[i - 1].size > taken[i].offset && taken[i].size > 0) {
        return damaged_texture("its parts overlap");
      }
    }
    // Level 0 ends the file (Khronos Texture 2.0, section 4): where more than padding follows, something was inserted.
    constexpr std::uint64_t kMostPadding = 15;
    if (file_size_ - taken.back().offset - taken.back().size > kMostPadding)
      return damaged_texture("it goes on behind its last part");
    return Ok{};
  }

  Result<std::vector<std::uint8_t>> read_surface(int picture) override {
    const std::uint64_t bytes = level_bytes(level_) / static_cast<std::uint64_t>(shape_.pictures);
    const std::uint64_t at = static_cast<std::uint64_t>(picture) * bytes;
    const Extent wanted = extents_[static_cast<std::size_t>(level_)];
    if (scheme_ == Supercompression::none) return TextureDecoder::read_at(wanted.offset + at, bytes);
    if (level_data_.empty()) {
      ENVCONV_TRY(const std::vector<std::uint8_t> packed, TextureDecoder::read_at(wanted.offset, wanted.size));
      ENVCONV_TRY(level_data_, inflated(packed, scheme_, level_bytes(level_)));
      ENVCONV_CHECK(check_smaller_levels());
    }
    const auto begin = level_data_.begin() + static_cast<std::ptrdiff_t>(at);
    return std::vector<std::uint8_t>(begin, begin + static_cast<std::ptrdiff_t>(bytes));
  }

  // They must be what the file says too, although nobody asked for them; together they are no larger than the level
  // that was.
  Result<Ok> check_smaller_levels() {
    for (int level = level_ + 1; level < shape_.levels; ++level) {
      const Extent extent = extents_[static_cast<std::size_t>(level)];
      ENVCONV_TRY(const std::vector<std::uint8_t> packed, TextureDecoder::read_at(extent.offset, extent.size));
      ENVCONV_CHECK(inflated(packed, scheme_, level_bytes(level)));
    }
    return Ok{};
  }

  std::uint64_t file_size_ = 0;
  Supercompression scheme_ = Supercompression::none;
  std::vector<Extent> extents_;           // of the levels
  std::vector<std::uint8_t> level_data_;  // unpacked, once it was needed
};

// --- writing -------------------------------------------------------------------------------------------------------

struct Level {
  Extent extent;
  std::uint64_t unpacked;
};

// BT.709 where nothing is said, 0 for those that have no code.
std::uint32_t primaries_code(const ColorEncoding& color) {
  if (!color.primaries) return 1;
  const Primaries* known = find_primaries(*color.primaries);
  return known ? static_cast<std::uint32_t>(known->khronos) : 0;
}

// Everything before the levels' data.
std::string head_of(const TextureShape& shape, const TexelFormat& format, Supercompression scheme,
                    const std::vector<std::uint32_t>& descriptor, const std::string& pairs,
                    const std::vector<Level>& levels) {
  const std::size_t descriptor_at = kHeaderSize + kIndexEntry * levels.size();
  const std::size_t pairs_at = descriptor_at + 4 * descriptor.size();
  ByteWriter out;
  out.text({reinterpret_cast<const char*>(kIdentifier.data()), kIdentifier.size()});
  out.u32(vk_format(format));
  out.u32(type_size(format));
  out.u32(static_cast<std::uint32_t>(shape.size.width));
  out.u32(static_cast<std::uint32_t>(shape.size.height));
  out.u32(0);                                                                                   // depth
  out.u32(shape.cube || shape.pictures == 1 ? 0 : static_cast<std::uint32_t>(shape.pictures));  // layers
  out.u32(shape.cube ? 6 : 1);
  out.u32(static_cast<std::uint32_t>(shape.levels));
  out.u32(static_cast<std::uint32_t>(scheme));
  out.u32(static_cast<std::uint32_t>(descriptor_at));
  out.u32(static_cast<std::uint32_t>(4 * descriptor.size()));
  out.u32(static_cast<std::uint32_t>(pairs_at));
  out.u32(static_cast<std::uint32_t>(pairs.size()));
  out.u64(0);  // no global data
  out.u64(0);
  for (const Level& level : levels) {
    out.u64(level.extent.offset);
    out.u64(level.extent.size);
    out.u64(level.unpacked);
  }
  for (const std::uint32_t word : descriptor) out.u32(word);
  out.text(pairs);
  return out.bytes();
}

// All pictures of a level, one after the other, as the file has them.  zlib's library takes only the whole.
Result<Ok> write_level(OutputFile& file, const std::vector<Picture>& pictures, const TexelFormat& format,
                       const TextureCompression& compression, const EncodeOptions& how, WriteReport& report,
                       Level& level) {
  for (const Picture& picture : pictures)
    level.unpacked += surface_bytes(format, picture.image.width(), picture.image.height());
  level.extent.offset = file.tell();
  std::optional<ZstandardFrame> frame;
  if (compression.scheme == Supercompression::zstd) frame.emplace(file, level.unpacked, compression.level, how.threads);
  std::vector<std::uint8_t> whole;
  for (const Picture& picture : pictures) {
    const std::vector<std::uint8_t> bytes = encode_surface(picture, format, how, report);
    if (frame) {
      ENVCONV_CHECK(frame->add(bytes));
    } else if (compression.scheme == Supercompression::zlib) {
      whole.insert(whole.end(), bytes.begin(), bytes.end());
    } else {
      file.write(bytes.data(), bytes.size());
    }
  }
  if (frame) ENVCONV_CHECK(frame->end());
  if (compression.scheme == Supercompression::zlib) {
    ENVCONV_TRY(const std::vector<std::uint8_t> small, deflated(whole, compression.level));
    file.write(small.data(), small.size());
  }
  level.extent.size = file.tell() - level.extent.offset;
  return Ok{};
}

}  // namespace

Result<std::unique_ptr<Decoder>> open_ktx2(int fd, const DecoderOptions& options) {
  auto decoder = std::make_unique<Ktx2Decoder>(fd, options);
  ENVCONV_CHECK(decoder->open());
  return std::unique_ptr<Decoder>(std::move(decoder));
}

Result<Ok> write_ktx2(OutputFile& file, std::span<const std::vector<Picture>> levels, const WriteOptions& options,
                      const TextureCompression& compression, WriteReport& report) {
  ENVCONV_TRY(const TextureShape shape, shape_of(levels, options.cube));
  const TexelFormat format = texel_format(report.type, stored_color(options, report.type).transfer == Transfer::srgb);
  const bool alpha = levels.front().front().channels.alpha >= 0;
  const std::vector<std::uint32_t> descriptor =
      make_descriptor(format, alpha && format.has_alpha() && format.type != PixelType::uint8,
                      primaries_code(stored_color(options, report.type)));
  Metadata more{{"KTXorientation", "rd"}, {"KTXwriter", texture_writer()}};
  if (format.has_alpha() && !alpha) more["envconv:alpha"] = "opaque";
  const std::string pairs = pack_key_values(options.metadata, more);
  std::vector<Level> index(levels.size());
  const std::string room = head_of(shape, format, compression.scheme, descriptor, pairs, index);
  file.write(room.data(), room.size());
  const EncodeOptions how{compression.effort, options.encoding, options.threads};
  // The smallest level comes first, so that it can be shown while the others are still loading.
  for (std::size_t level = levels.size(); level-- > 0;) {
    pad_file(file, alignment_of(format, compression.scheme));
    ENVCONV_CHECK(write_level(file, levels[level], format, compression, how, report, index[level]));
  }
  const std::string head = head_of(shape, format, compression.scheme, descriptor, pairs, index);
  file.seek(0);
  file.write(head.data(), head.size());
  return Ok{};
}

}  // namespace envconv
