// SPDX-License-Identifier: Apache-2.0
#include "tiff_damage.h"

#include <libdeflate.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include "file_bytes.h"
#include "tiff_input.h"
#include "tiff_streams.h"

namespace envconv {
namespace {

constexpr int most_pictures = 64;
constexpr std::uint64_t header = 8;                           // bytes; BigTIFF's has more
constexpr std::uint64_t shortest_directory = 2 + 8 * 12 + 4;  // bytes; of the fields that a picture must have

class Checker {
 public:
  explicit Checker(TiffInput& input) : tiff_(input.tiff()), input_(input), heard_(input.heard()) {}

  // Whether what the fields say of the samples goes together.
  Result<Ok> samples() const {
    std::uint16_t samples = 1, bits = 1, format = SAMPLEFORMAT_UINT, photometric = PHOTOMETRIC_MINISBLACK;
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_SAMPLESPERPIXEL, &samples);
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_BITSPERSAMPLE, &bits);
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_SAMPLEFORMAT, &format);
    if (format == SAMPLEFORMAT_IEEEFP && bits < 16)
      return damaged_file("floating point of " + std::to_string(bits) + " bits");
    if (!TIFFGetField(tiff_, TIFFTAG_PHOTOMETRIC, &photometric)) return Ok{};
    int least = 0;
    switch (photometric) {
      case PHOTOMETRIC_MINISWHITE:
      case PHOTOMETRIC_MINISBLACK:
      case PHOTOMETRIC_PALETTE:
      case PHOTOMETRIC_LOGL: least = 1; break;
      case PHOTOMETRIC_RGB:
      case PHOTOMETRIC_YCBCR:
      case PHOTOMETRIC_CIELAB:
      case PHOTOMETRIC_ICCLAB:
      case PHOTOMETRIC_ITULAB:
      case PHOTOMETRIC_LOGLUV: least = 3; break;
      case PHOTOMETRIC_SEPARATED: least = 4; break;
      default: return damaged_file("its colours are of unknown kind " + std::to_string(photometric));
    }
    if (samples < least) return damaged_file("it has fewer channels than its kind of colours");
    return Ok{};
  }

  Result<Ok> extents() const {
    const std::uint32_t count = blocks();
    const std::uint64_t directory = TIFFCurrentDirOffset(tiff_);
    for (std::uint32_t i = 0; i < count; ++i) {
      const TiffExtent extent = extent_of_block(tiff_, i);
      const bool before = extent.offset <= directory;
      if (before ? directory - extent.offset < extent.size : extent.offset - directory < shortest_directory)
        return damaged_file(name_of_block(tiff_, i) + " lies where the directory is");
      if (extent.offset > input_.size() || extent.size > input_.size() - extent.offset)
        return damaged_file(name_of_block(tiff_, i) + " lies behind the end of the file");
      if (extent.offset < header && extent.size > 0)
        return damaged_file(name_of_block(tiff_, i) + " lies in the file's header");
    }
    return Ok{};
  }

  // Whether the strips or tiles unpack to what they should, as far as their compression tells.
  Result<Ok> streams(bool checksums) const {
    std::uint16_t compression = 0, order = FILLORDER_MSB2LSB;
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_COMPRESSION, &compression);
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_FILLORDER, &order);
    const bool deflated = compression == COMPRESSION_ADOBE_DEFLATE || compression == COMPRESSION_DEFLATE;
    const bool counted = compression == COMPRESSION_LZW || compression == COMPRESSION_PACKBITS;
    if (deflated ? !checksums : !counted && !goes_on_after_errors(compression)) return Ok{};
    const tmsize_t largest = TIFFIsTiled(tiff_) ? TIFFTileSize(tiff_) : TIFFStripSize(tiff_);
    if (largest <= 0) return damaged_file("strips or tiles of no size");
    const auto full = static_cast<std::size_t>(largest);
    if (!deflated && !counted) return unpack(full);
    Checksum checksum(deflated ? full : 0);
    std::vector<std::uint8_t> packed;
    const std::uint32_t count = blocks();
    for (std::uint32_t i = 0; i < count; ++i) {
      const TiffExtent extent = extent_of_block(tiff_, i);
      packed.resize(static_cast<std::size_t>(extent.size));
      ENVCONV_CHECK(read_at(input_.fd(), extent.offset, packed));
      if (order == FILLORDER_LSB2MSB) TIFFReverseBits(packed.data(), static_cast<tmsize_t>(packed.size()));
      if (deflated) {
        if (!checksum.matches(packed)) return damaged_file(name_of_block(tiff_, i) + " does not match its checksum");
        continue;
      }
      const std::uint64_t size = bytes_of(i, full);
      if (!(compression == COMPRESSION_LZW ? lzw_unpacks_to(packed, size, full)
                                           : packbits_unpacks_to(packed, size, full)))
        return damaged_file(name_of_block(tiff_, i) + " does not unpack to its size");
    }
    return Ok{};
  }

 private:
  // Of zlib streams that unpack to so many bytes at most: the last strip may have fewer rows.
  class Checksum {
   public:
    explicit Checksum(std::size_t room)
        : room_(room), codec_(libdeflate_alloc_decompressor(), libdeflate_free_decompressor) {
      if (!codec_) throw std::bad_alloc();
      unpacked_ = std::make_unique_for_overwrite<std::uint8_t[]>(room);
    }
    bool matches(const std::vector<std::uint8_t>& packed) {
      std::size_t made = 0;
      return libdeflate_zlib_decompress(codec_.get(), packed.data(), packed.size(), unpacked_.get(), room_, &made) ==
             LIBDEFLATE_SUCCESS;
    }

   private:
    std::size_t room_;
    std::unique_ptr<libdeflate_decompressor, void (*)(libdeflate_decompressor*)> codec_;
    std::unique_ptr<std::uint8_t[]> unpacked_;
  };

  // libtiff's decoders of the others stop at what they cannot unpack.
  static bool goes_on_after_errors(std::uint16_t compression) {
    switch (compression) {
      case COMPRESSION_CCITTRLE:
      case COMPRESSION_CCITTRLEW:
      case COMPRESSION_CCITTFAX3:
      case COMPRESSION_CCITTFAX4:
      case COMPRESSION_JPEG: return true;
      default: return false;
    }
  }

  // What libtiff's decoders complain of while they go on: the image library takes what they leave for pixels.
  Result<Ok> unpack(std::size_t full) const {
    const auto room = std::make_unique_for_overwrite<std::uint8_t[]>(full);
    const auto size = static_cast<tmsize_t>(full);
    heard_.error.clear();
    for (std::uint32_t i = 0; i < blocks(); ++i) {
      const tmsize_t made = TIFFIsTiled(tiff_) ? TIFFReadEncodedTile(tiff_, i, room.get(), size)
                                               : TIFFReadEncodedStrip(tiff_, i, room.get(), size);
      if (made < 0 || !heard_.error.empty() || heard_.corrupt)
        return damaged_file(name_of_block(tiff_, i) + " does not unpack" +
                            (heard_.error.empty() ? "" : ": " + heard_.error));
    }
    return Ok{};
  }

  // Bytes of a strip or tile, unpacked, of which a strip at the bottom may have fewer.
  std::uint64_t bytes_of(std::uint32_t i, std::size_t full) const {
    if (TIFFIsTiled(tiff_)) return full;
    std::uint32_t height = 0, rows = 0;
    TIFFGetField(tiff_, TIFFTAG_IMAGELENGTH, &height);
    TIFFGetFieldDefaulted(tiff_, TIFFTAG_ROWSPERSTRIP, &rows);
    if (rows == 0 || rows >= height) return full;
    const std::uint32_t first = i % ((height - 1) / rows + 1) * rows;  // planes come one after the other
    const tmsize_t size = TIFFVStripSize(tiff_, std::min(rows, height - first));
    return size > 0 ? static_cast<std::uint64_t>(size) : full;
  }

  std::uint32_t blocks() const { return TIFFIsTiled(tiff_) ? TIFFNumberOfTiles(tiff_) : TIFFNumberOfStrips(tiff_); }

  TIFF* tiff_;
  const TiffInput& input_;
  TiffHeard& heard_;
};

}  // namespace

Result<Ok> check_tiff(int fd, int picture, bool checksums) {
  ENVCONV_TRY(const std::uint64_t file_size, size_of_file(fd));
  TiffInput input(fd, file_size);
  if (!input.tiff()) return input.damage();
  Checker checker(input);
  for (int i = 0; i < most_pictures; ++i) {
    if (input.heard().guessed) return damaged_file("sizes of strips that cannot be");
    ENVCONV_CHECK(checker.extents());
    if (i == picture) {
      ENVCONV_CHECK(checker.samples());
      ENVCONV_CHECK(checker.streams(checksums));
    }
    if (TIFFLastDirectory(input.tiff())) return Ok{};
    if (!TIFFReadDirectory(input.tiff())) return input.damage();
  }
  return Ok{};
}

}  // namespace envconv
