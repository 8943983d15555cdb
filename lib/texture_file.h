// SPDX-License-Identifier: Apache-2.0
// What DDS, KTX and KTX2 files have in common: surfaces (faces or layers) in levels, all of one format.  Internal: not
// installed.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "decoder.h"
#include "image.h"
#include "io.h"
#include "output_file.h"
#include "result.h"
#include "texel_format.h"

namespace envconv {

/// True for "dds", "ktx" and "ktx2".
bool is_texture_file(std::string_view format);

/// How a file's levels are packed.  The numbers are KTX2's.
enum class Supercompression : std::uint32_t { none = 0, zstd = 2, zlib = 3 };

/// What --compression says of such a file.
struct TextureCompression {
  Bc6hEffort effort = Bc6hEffort::normal;
  Supercompression scheme = Supercompression::none;
  int level = 0;
};

/// "", "none", of KTX2 "zstd[:1-22]" and "zlib[:1-12]", of bc6h an effort "fast", "normal" or "best"; both with a
/// comma. Error: unsupported, with what there is.
Result<TextureCompression> parse_texture_compression(std::string_view format, PixelType type, const std::string& text);

/// True when such a file can hold so many faces or layers with so many channels.  Error: unsupported.
Result<Ok> check_texture(std::string_view format, PixelType type, bool cube, int pictures, int channels);

/// Levels that a chain down to one texel has.
int full_chain(int width, int height);
/// A level's size: halved, rounded down, at least 1.
Size size_of_level(Size base, int level);

/// What a file holds.
struct TextureShape {
  Size size;         ///< of level 0
  int pictures = 1;  ///< faces or layers
  int levels = 1;
  bool cube = false;
};

/// The shape of what is to be written.  Errors: unsupported, for faces that differ in size and levels that do not
/// halve.
Result<TextureShape> shape_of(std::span<const std::vector<Picture>> levels, bool cube);

/// What a reader found, beside the shape.
struct TextureFacts {
  TexelFormat format;
  bool opaque = false;         ///< there is an alpha channel, and it is 1 everywhere
  bool premultiplied = false;  ///< colour is multiplied by alpha
};

/// A file of surfaces, when its header was understood.  A reader fills in `spec`, `shape` and `facts`, and says where
/// the bytes of a surface are.
class TextureDecoder : public Decoder {
 public:
  TextureDecoder(int fd, const DecoderOptions& options) : fd_(fd), options_(options) {}
  const FileSpec& spec() const override { return spec_; }
  Result<Ok> decode(int picture, void* pixels) override;

 protected:
  /// Checks the shape against the limits and fills in the pictures of the level that is wanted.
  Result<Ok> describe(const TextureShape& shape, const TextureFacts& facts);
  /// The stored bytes of a picture of that level.
  virtual Result<std::vector<std::uint8_t>> read_surface(int picture) = 0;

  /// Bytes at a place of the file.  Error: truncated.  `size` must have been checked against file_size().
  Result<Ok> read_at(std::uint64_t offset, void* to, std::size_t size) const;
  Result<std::vector<std::uint8_t>> read_at(std::uint64_t offset, std::uint64_t size) const;
  Result<std::uint64_t> file_size() const;

  int fd_;
  DecoderOptions options_;
  FileSpec spec_;
  TextureShape shape_;
  TextureFacts facts_;
  int level_ = 0;  ///< the one that is wanted, or 0 when there is no such level
};

/// ErrorCode::input, "damaged: " and what.
Error damaged_texture(const std::string& what);
/// Half a file.
Error truncated_texture();

/// A little-endian number; `bytes` has sizeof(T) of them.
template <class T>
T little_endian(const std::uint8_t* bytes) {
  T value = 0;
  for (std::size_t i = sizeof(T); i-- > 0;) value = static_cast<T>(value << 8 | bytes[i]);
  return value;
}

/// Writes numbers and texts, little-endian, to memory.
class ByteWriter {
 public:
  void u32(std::uint32_t v) { number(v, 4); }
  void u64(std::uint64_t v) { number(v, 8); }
  void text(std::string_view v) { bytes_ += v; }
  void zeros(std::size_t count) { bytes_.append(count, '\0'); }
  /// Zeros up to a multiple.
  void align(std::size_t multiple) { zeros((multiple - bytes_.size() % multiple) % multiple); }
  const std::string& bytes() const { return bytes_; }
  std::size_t size() const { return bytes_.size(); }

 private:
  void number(std::uint64_t v, int count) {
    for (int i = 0; i < count; ++i) bytes_ += static_cast<char>(v >> (8 * i) & 0xFF);
  }
  std::string bytes_;
};

/// KTX's key and value pairs, each padded to 4 bytes: sorted, envconv's own and `more`; and back, envconv's own into
/// `metadata` and the rest into `more`.  Error: input, damaged.
std::string pack_key_values(const Metadata& metadata, const Metadata& more);
Result<Ok> unpack_key_values(std::span<const std::uint8_t> bytes, Metadata& metadata, Metadata& more);

/// "envconv 0.1.0": who wrote it.
std::string texture_writer();

/// Zeros, so that the file goes on at a multiple.
void pad_file(OutputFile& file, std::uint64_t multiple);

}  // namespace envconv
