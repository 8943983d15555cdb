// SPDX-License-Identifier: Apache-2.0
// What a decoder tells of a file before it makes any pixel.  Internal: not installed.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "color_encoding.h"
#include "io.h"
#include "mapped_memory.h"

namespace envconv {

/// A picture of a file, as the decoder will deliver it.
struct PictureSpec {
  std::string name;
  int width = 0, height = 0;  ///< texels
  Channels channels;
  PixelType type = PixelType::float32;     ///< as stored in the file
  PixelType element = PixelType::float32;  ///< as decode() delivers it
  int band = 0;                            ///< rows that decode_rows() delivers at a time; 0: all of them at once
};

/// A file, as the decoder understands it.
struct FileSpec {
  std::string compression;
  Transfer transfer = Transfer::linear;
  float gamma = 1;                          ///< of Transfer::gamma
  std::optional<Chromaticities> primaries;  ///< where the file tells them
  std::string color_how;                    ///< what in the file tells of its colour, or ""
  bool unassociated = false;                ///< colour is not multiplied by alpha
  int orientation = 1;                      ///< Exif's: 1 upright ... 8; the picture is turned after decoding
  int levels = 1;
  std::vector<PictureSpec> pictures;
  Metadata metadata;
  std::vector<std::string> warnings;
};

/// Limits against which names and counts are held, in a decoder and again on the other side of a process boundary.
constexpr int kMaxChannels = 64;
constexpr int kMaxPictures = 64;

/// An open file whose pictures can be had.  Errors carry no path: the caller knows it.  Throws nothing.
class PixelSource {
 public:
  virtual ~PixelSource() = default;
  virtual const FileSpec& spec() const = 0;
  /// All pixels of a picture, [height][width][channels] elements, with room behind them as Image::adopt() needs it.
  /// Nobody else writes there.  Once for each picture.
  virtual Result<MappedMemory> pixels(int picture) = 0;
  /// Delivers `count` rows from `first` on, to memory that is zero: bands of PictureSpec::band rows, of which the last
  /// may be less, each once and in order.  A source delivers all its pictures this way, or all by pixels().
  virtual Result<Ok> decode_rows(int picture, int first, int count, void* pixels) = 0;
  /// Whether decode_rows() works band by band, rather than on all of a picture at the first call.
  virtual bool in_bands() const {
    return std::ranges::any_of(spec().pictures, [](const PictureSpec& picture) { return picture.band > 0; });
  }
};

/// A file that is decoded in this process.
class Decoder : public PixelSource {
 public:
  /// Delivers all pixels of a picture to memory that is zero.
  virtual Result<Ok> decode(int picture, void* pixels) = 0;
  Result<MappedMemory> pixels(int picture) override;
  /// For decoders without bands.
  Result<Ok> decode_rows(int picture, int, int, void* pixels) override { return decode(picture, pixels); }
};

/// What a decoder needs to know.
struct DecoderOptions {
  std::int64_t max_pixels = 0;
  int threads = 1;
  int level = 0;         ///< whose pictures spec() and decode() speak of
  bool library = false;  ///< with the image library, also where there is a reader here
};

/// Rows that make a band of some megabytes, as a multiple of `multiple`; no less than `least`.  0: the whole picture is
/// no more than that.
int band_rows(const PictureSpec& picture, int multiple, int least = 1);
/// Rows of a picture that are delivered at a time, and bytes of so many rows.
inline int rows_at_a_time(const PictureSpec& picture) { return picture.band > 0 ? picture.band : picture.height; }
std::size_t bytes_of_rows(const PictureSpec& picture, int rows);

/// Bytes of an element.
inline std::size_t size_of(PixelType type) {
  switch (type) {
    case PixelType::uint8: return 1;
    case PixelType::half:
    case PixelType::uint16: return 2;
    default: return 4;
  }
}

/// Bytes of a picture's elements and the room behind them, in whole pages.
inline std::size_t bytes_of(const PictureSpec& picture) {
  constexpr std::size_t kPages = 65536;
  return (bytes_of_rows(picture, picture.height) + Image::room + kPages - 1) / kPages * kPages;
}

/// The error where there is no memory for so many bytes.
Error no_memory_for(std::size_t bytes);

/// The error of a picture that claims more than the limit.
Error too_many_pixels(std::int64_t width, std::int64_t height, std::int64_t limit);

/// Whether files of a format are read here, all of them or the usual ones; else the image library reads them.
bool has_own_reader(std::string_view format);

/// Opens a regular file of a format that was recognised by its first bytes.  The descriptor must outlive the decoder.
/// Null: of a kind that only the image library reads, with DecoderOptions::library.
Result<std::unique_ptr<Decoder>> open_decoder(const std::string& format, int fd, const DecoderOptions& options);

}  // namespace envconv
