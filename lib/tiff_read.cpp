// SPDX-License-Identifier: Apache-2.0
#include "tiff_read.h"

#include <libdeflate.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <limits>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "decode_blocks.h"
#include "embedded_metadata.h"
#include "file_bytes.h"
#include "row_kernels.h"
#include "tiff_bounds.h"
#include "tiff_damage.h"
#include "tiff_input.h"
#include "tiff_predictor.h"

namespace envconv {
namespace {

constexpr int most_levels = 32;

template <class T>
std::optional<T> field_of(TIFF* tiff, std::uint32_t tag) {
  T value{};
  return TIFFGetField(tiff, tag, &value) == 1 ? std::optional(value) : std::nullopt;
}
template <class T>
T field_or_usual(TIFF* tiff, std::uint32_t tag) {
  T value{};
  TIFFGetFieldDefaulted(tiff, tag, &value);
  return value;
}

// Bytes that are a field's value; none where it is not there.
std::string_view bytes_of_field(TIFF* tiff, std::uint32_t tag) {
  std::uint32_t count = 0;
  const void* data = nullptr;
  if (TIFFGetField(tiff, tag, &count, &data) != 1 || !data) return {};
  return {static_cast<const char*>(data), count};
}

// A picture's strips or tiles, and how its texels lie in them.
struct Storage {
  int width = 0, height = 0, channels = 0;
  std::uint16_t compression = COMPRESSION_NONE;
  bool tiled = false;
  int block_width = 0, block_height = 0;  // of a strip: rows that it has at most
  PixelType stored = PixelType::uint8;
  TiffSamples samples;

  bool deflated() const { return compression == COMPRESSION_ADOBE_DEFLATE || compression == COMPRESSION_DEFLATE; }
  int across() const { return (width + block_width - 1) / block_width; }
  int down() const { return (height + block_height - 1) / block_height; }
  std::size_t texel() const { return static_cast<std::size_t>(channels) * samples.size; }
  std::size_t line() const { return static_cast<std::size_t>(block_width) * texel(); }
};

std::optional<PixelType> type_of(int bits, int format) {
  if (bits == 8 && format == SAMPLEFORMAT_UINT) return PixelType::uint8;
  if (bits == 16 && format == SAMPLEFORMAT_UINT) return PixelType::uint16;
  if (bits == 16 && format == SAMPLEFORMAT_IEEEFP) return PixelType::half;
  if (bits == 32 && format == SAMPLEFORMAT_IEEEFP) return PixelType::float32;
  return {};
}

// Nothing where the present directory is of a kind that is not read here.
std::optional<Storage> storage_of(TIFF* tiff) {
  constexpr std::uint32_t most = std::numeric_limits<int>::max();
  Storage storage;
  const auto width = field_of<std::uint32_t>(tiff, TIFFTAG_IMAGEWIDTH).value_or(0);
  const auto height = field_of<std::uint32_t>(tiff, TIFFTAG_IMAGELENGTH).value_or(0);
  storage.channels = field_or_usual<std::uint16_t>(tiff, TIFFTAG_SAMPLESPERPIXEL);
  const auto kind = field_of<std::uint16_t>(tiff, TIFFTAG_PHOTOMETRIC);
  const bool grey = kind == PHOTOMETRIC_MINISBLACK, color = kind == PHOTOMETRIC_RGB;
  if (width < 1 || width > most || height < 1 || height > most || (!grey && !color)) return {};
  if (storage.channels < (color ? 3 : 1) || storage.channels > kMaxChannels) return {};
  storage.width = static_cast<int>(width), storage.height = static_cast<int>(height);
  const auto type = type_of(field_of<std::uint16_t>(tiff, TIFFTAG_BITSPERSAMPLE).value_or(0),
                            field_or_usual<std::uint16_t>(tiff, TIFFTAG_SAMPLEFORMAT));
  if (!type || field_or_usual<std::uint16_t>(tiff, TIFFTAG_PLANARCONFIG) != PLANARCONFIG_CONTIG ||
      field_or_usual<std::uint16_t>(tiff, TIFFTAG_FILLORDER) != FILLORDER_MSB2LSB ||
      field_or_usual<std::uint32_t>(tiff, TIFFTAG_IMAGEDEPTH) != 1)
    return {};
  storage.stored = *type;
  storage.compression = field_or_usual<std::uint16_t>(tiff, TIFFTAG_COMPRESSION);
  storage.samples = {size_of(*type), static_cast<std::size_t>(storage.channels), PREDICTOR_NONE,
                     TIFFIsByteSwapped(tiff) != 0};
  switch (storage.compression) {
    case COMPRESSION_NONE: break;
    case COMPRESSION_LZW:
    case COMPRESSION_DEFLATE:
    case COMPRESSION_ADOBE_DEFLATE:
      storage.samples.predictor = field_of<std::uint16_t>(tiff, TIFFTAG_PREDICTOR).value_or(PREDICTOR_NONE);
      break;
    default: return {};
  }
  const bool real = storage.stored == PixelType::half || storage.stored == PixelType::float32;
  const int predictor = storage.samples.predictor;
  if (predictor != PREDICTOR_NONE && predictor != PREDICTOR_HORIZONTAL &&
      !(real && predictor == PREDICTOR_FLOATINGPOINT))
    return {};
  storage.tiled = TIFFIsTiled(tiff) != 0;
  std::uint32_t block_width = width, block_height = 0;
  if (storage.tiled) {
    block_width = field_of<std::uint32_t>(tiff, TIFFTAG_TILEWIDTH).value_or(0);
    block_height = field_of<std::uint32_t>(tiff, TIFFTAG_TILELENGTH).value_or(0);
    if (field_or_usual<std::uint32_t>(tiff, TIFFTAG_TILEDEPTH) != 1) return {};
  } else {
    block_height = std::min(field_or_usual<std::uint32_t>(tiff, TIFFTAG_ROWSPERSTRIP), height);
  }
  constexpr std::uint32_t largest_tile = 1 << 16;
  if (block_width < 1 || block_height < 1 || (storage.tiled && std::max(block_width, block_height) > largest_tile))
    return {};
  storage.block_width = static_cast<int>(block_width), storage.block_height = static_cast<int>(block_height);
  const auto count = static_cast<std::uint64_t>(storage.across()) * static_cast<std::uint64_t>(storage.down());
  if (count != (storage.tiled ? TIFFNumberOfTiles(tiff) : TIFFNumberOfStrips(tiff))) return {};
  const tmsize_t line = storage.tiled ? TIFFTileRowSize(tiff) : TIFFScanlineSize(tiff);
  if (line <= 0 || static_cast<std::size_t>(line) != storage.line()) return {};
  return storage;
}

// As OpenImageIO names them.  Sets `unassociated` where an alpha channel says so.
Channels channels_of(TIFF* tiff, int count, bool& unassociated) {
  constexpr std::array usual{"R", "G", "B", "A"};
  Channels channels{{count < 3 ? "Y" : "R"}, count > 3 ? 3 : -1};
  for (std::size_t c = 1; c < static_cast<std::size_t>(count); ++c)
    channels.names.push_back(c < usual.size() ? usual[c] : "channel" + std::to_string(c));
  std::uint16_t extra = 0, *kinds = nullptr;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_EXTRASAMPLES, &extra, &kinds);
  const int colors = field_of<std::uint16_t>(tiff, TIFFTAG_PHOTOMETRIC) == PHOTOMETRIC_RGB ? 3 : 1;
  for (int i = 0, c = colors; i < extra && c < count; ++i, ++c) {
    if (kinds[i] == EXTRASAMPLE_ASSOCALPHA || kinds[i] == EXTRASAMPLE_UNASSALPHA) {
      channels.alpha = c;
      unassociated = unassociated || kinds[i] == EXTRASAMPLE_UNASSALPHA;
    } else if (channels.alpha == c) {
      channels.names[static_cast<std::size_t>(c)] = "channel" + std::to_string(c);
      channels.alpha = -1;
    }
  }
  if (extra > 0 && channels.alpha >= 0) channels.names[static_cast<std::size_t>(channels.alpha)] = "A";
  return channels;
}

// Decodes blocks one at a time.  One thread's.
class BlockReader {
 public:
  /// `level`: of the directory that `storage` is of.
  BlockReader(int fd, std::uint64_t size, int level, const Storage& storage) : input_(fd, size), storage_(storage) {
    ready_ = input_.tiff() && (level == 0 || TIFFSetDirectory(input_.tiff(), static_cast<tdir_t>(level)));
  }

  /// Puts the block where it lies in rows from `first` on, of the picture's width.
  Result<Ok> read(std::int64_t number, int first, void* pixels) {
    if (!ready_) return input_.damage();
    const int x = static_cast<int>(number % storage_.across()) * storage_.block_width;
    const int y = static_cast<int>(number / storage_.across()) * storage_.block_height;
    const int rows = std::min(storage_.block_height, storage_.height - y);
    const int columns = std::min(storage_.block_width, storage_.width - x);
    const bool half = storage_.stored == PixelType::half;
    const std::size_t element = half ? sizeof(float) : storage_.samples.size;
    const std::size_t texel = element * static_cast<std::size_t>(storage_.channels);
    const std::size_t row = static_cast<std::size_t>(storage_.width) * texel;
    auto* to = static_cast<std::uint8_t*>(pixels) + static_cast<std::size_t>(y - first) * row +
               static_cast<std::size_t>(x) * texel;
    const std::size_t line = storage_.line(), whole = line * static_cast<std::size_t>(storage_.block_height);
    // Straight into place, where whole lines of the picture are as they are wanted.
    const bool in_place = !half && !storage_.tiled && rows == storage_.block_height;
    if (in_place) return unpack(number, rows, {to, whole});
    block_.resize(whole);
    ENVCONV_CHECK(unpack(number, rows, block_));
    const std::size_t values = static_cast<std::size_t>(columns) * static_cast<std::size_t>(storage_.channels);
    for (int i = 0; i < rows; ++i, to += row) {
      const std::uint8_t* from = block_.data() + static_cast<std::size_t>(i) * line;
      if (half)
        halves_to_floats(reinterpret_cast<const std::uint16_t*>(from), values, reinterpret_cast<float*>(to));
      else
        std::memcpy(to, from, values * element);
    }
    return Ok{};
  }

 private:
  // All lines of a tile, or `rows` of a strip; `to` has room for a whole block.
  Result<Ok> unpack(std::int64_t number, int rows, std::span<std::uint8_t> to) {
    const auto block = static_cast<std::uint32_t>(number);
    const std::size_t wanted = storage_.tiled ? to.size() : storage_.line() * static_cast<std::size_t>(rows);
    if (storage_.compression == COMPRESSION_NONE) return copy(block, to.first(wanted));
    if (storage_.deflated()) return inflate(block, to, wanted);
    const auto read = storage_.tiled ? TIFFReadEncodedTile : TIFFReadEncodedStrip;
    const auto size = static_cast<tmsize_t>(wanted);
    if (read(input_.tiff(), block, to.data(), size) != size) return input_.damage();
    return Ok{};
  }

  Result<Ok> copy(std::uint32_t block, std::span<std::uint8_t> to) {
    const TiffExtent extent = extent_of_block(input_.tiff(), block);
    if (extent.size < to.size()) return damaged_file(name_of_block(input_.tiff(), block) + " has not all of its rows");
    ENVCONV_CHECK(read_at(input_.fd(), extent.offset, to));
    undo_predictors(to);
    return Ok{};
  }

  void undo_predictors(std::span<std::uint8_t> lines) {
    const std::size_t line = storage_.line();
    for (std::size_t at = 0; at < lines.size(); at += line)
      undo_tiff_predictor(storage_.samples, lines.subspan(at, line), line_);
  }

  // The whole stream, for its checksum: the last strip may have rows that the picture has not.
  Result<Ok> inflate(std::uint32_t block, std::span<std::uint8_t> to, std::size_t wanted) {
    const TiffExtent extent = extent_of_block(input_.tiff(), block);
    if (extent.offset > input_.size() || extent.size > input_.size() - extent.offset)
      return damaged_file(name_of_block(input_.tiff(), block) + " lies behind the end of the file");
    packed_.resize(static_cast<std::size_t>(extent.size));
    ENVCONV_CHECK(read_at(input_.fd(), extent.offset, packed_));
    if (!codec_) codec_.reset(libdeflate_alloc_decompressor());
    if (!codec_) throw std::bad_alloc();
    std::size_t made = 0;
    if (libdeflate_zlib_decompress(codec_.get(), packed_.data(), packed_.size(), to.data(), to.size(), &made) !=
        LIBDEFLATE_SUCCESS)
      return damaged_file(name_of_block(input_.tiff(), block) + " does not match its checksum");
    if (made < wanted) return damaged_file(name_of_block(input_.tiff(), block) + " has not all of its rows");
    undo_predictors(to.first(wanted));
    return Ok{};
  }

  struct FreeDecompressor {
    void operator()(libdeflate_decompressor* d) const { libdeflate_free_decompressor(d); }
  };
  TiffInput input_;
  const Storage& storage_;
  bool ready_ = false;
  std::unique_ptr<libdeflate_decompressor, FreeDecompressor> codec_;
  std::vector<std::uint8_t> packed_, block_, line_;
};

class TiffDecoder final : public Decoder {
 public:
  TiffDecoder(int fd, std::uint64_t size, const DecoderOptions& options)
      : fd_(fd), size_(size), threads_(std::max(options.threads, 1)), input_(fd, size) {}

  /// False for a file that is left to the image library.
  Result<bool> open(const DecoderOptions& options) {
    TIFF* const tiff = input_.tiff();
    if (!tiff) return input_.damage();
    const auto first = storage_of(tiff);
    if (!first) return false;
    spec_.compression = first->compression == COMPRESSION_NONE  ? "none"
                        : first->compression == COMPRESSION_LZW ? "lzw"
                                                                : "zip";
    const bool real = first->stored == PixelType::half || first->stored == PixelType::float32;
    spec_.transfer = real ? Transfer::linear : Transfer::srgb;
    if (!take_metadata(tiff, first->stored)) return false;
    PictureSpec picture;
    picture.channels = channels_of(tiff, first->channels, spec_.unassociated);
    const char* levels = nullptr;
    const bool has_levels = TIFFGetField(tiff, TIFFTAG_PIXAR_TEXTUREFORMAT, &levels) == 1 && levels;
    if (has_levels && std::string_view(levels) == "Shadow") return false;
    if (!has_levels && TIFFSetDirectory(tiff, 1))
      spec_.warnings.push_back("only the first of several pictures is read");
    while (has_levels && spec_.levels < most_levels && TIFFSetDirectory(tiff, static_cast<tdir_t>(spec_.levels)))
      ++spec_.levels;
    level_ = std::clamp(options.level, 0, spec_.levels - 1);
    if (!TIFFSetDirectory(tiff, static_cast<tdir_t>(level_))) return input_.damage();
    const auto storage = storage_of(tiff);
    if (!storage || storage->channels != first->channels || storage->stored != first->stored) return false;
    storage_ = *storage;
    picture.width = storage_.width, picture.height = storage_.height;
    if (picture.width > options.max_pixels / picture.height)
      return too_many_pixels(picture.width, picture.height, options.max_pixels);
    picture.type = storage_.stored;
    picture.element = storage_.stored == PixelType::half ? PixelType::float32 : storage_.stored;
    const auto least = std::int64_t{storage_.block_height} * threads_;
    picture.band =
        band_rows(picture, storage_.block_height, static_cast<int>(std::min<std::int64_t>(least, picture.height)));
    spec_.pictures.push_back(std::move(picture));
    return true;
  }

  const FileSpec& spec() const override { return spec_; }

  Result<Ok> decode(int picture, void* pixels) override {
    return decode_rows(picture, 0, spec_.pictures.front().height, pixels);
  }

  Result<Ok> decode_rows(int, int first, int count, void* pixels) override {
    if (first == 0) ENVCONV_CHECK(check_tiff(fd_, level_, false));
    readers_.resize(static_cast<std::size_t>(threads_));
    const std::int64_t across = storage_.across();
    const std::int64_t begin = first / storage_.block_height * across;
    const std::int64_t end = ((first + count - 1) / storage_.block_height + 1) * across;
    return decode_blocks(begin, end, threads_, [&](int thread, std::int64_t number) {
      auto& reader = readers_[static_cast<std::size_t>(thread)];
      if (!reader) reader = std::make_unique<BlockReader>(fd_, size_, level_, storage_);
      return reader->read(number, first, pixels);
    });
  }

 private:
  // Of the first picture.  False where there is more in them than is understood here.
  bool take_metadata(TIFF* tiff, PixelType stored) {
    spec_.orientation = std::clamp<int>(field_of<std::uint16_t>(tiff, TIFFTAG_ORIENTATION).value_or(1), 1, 8);
    // Fields of Exif, in a directory of their own or beside the others.
    constexpr std::uint32_t user_comment = 37510, color_space = 40961, gamma = 42240;
    for (int i = 0; i < TIFFGetTagListCount(tiff); ++i) {
      const std::uint32_t tag = TIFFGetTagListEntry(tiff, i);
      if (tag == TIFFTAG_EXIFIFD || tag == user_comment || tag == color_space || tag == gamma) return false;
    }
    if (!is_idle_xmp(bytes_of_field(tiff, TIFFTAG_XMLPACKET))) return false;
    std::uint32_t words = 0;  // of four bytes
    const void* iptc = nullptr;
    if (TIFFGetField(tiff, TIFFTAG_RICHTIFFIPTC, &words, &iptc) == 1) return false;
    const auto description = field_of<const char*>(tiff, TIFFTAG_IMAGEDESCRIPTION);
    spec_.metadata["ImageDescription"] = own_description(description && *description ? *description : "");
    const std::string_view profile = bytes_of_field(tiff, TIFFTAG_ICCPROFILE);
    return profile.empty() ||
           take_icc_profile({reinterpret_cast<const std::uint8_t*>(profile.data()), profile.size()}, stored, spec_);
  }

  int fd_;
  std::uint64_t size_;
  int threads_, level_ = 0;
  TiffInput input_;
  Storage storage_;
  FileSpec spec_;
  std::vector<std::unique_ptr<BlockReader>> readers_;  // of each thread
};

}  // namespace

Result<std::unique_ptr<Decoder>> open_tiff(int fd, const DecoderOptions& options) {
  if (tiff_fields_cut_off(fd)) return damaged_file("a field lies behind the end of the file");
  ENVCONV_TRY(const std::uint64_t size, size_of_file(fd));
  auto decoder = std::make_unique<TiffDecoder>(fd, size, options);
  ENVCONV_TRY(const bool ours, decoder->open(options));
  return ours ? std::unique_ptr<Decoder>(std::move(decoder)) : std::unique_ptr<Decoder>();
}

}  // namespace envconv
