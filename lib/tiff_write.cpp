// SPDX-License-Identifier: Apache-2.0
// TIFF Revision 6.0 (Adobe 1992), with Adobe's technical notes on deflate (2002) and on the predictor for floats
// (2005).
#include "tiff_write.h"

#include <fcntl.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <new>
#include <vector>

#include "deflate.h"
#include "in_order.h"
#include "tiff_lzw.h"
#include "tiff_messages.h"

namespace envconv {
namespace {

constexpr std::size_t strip_bytes = std::size_t{1} << 18;
constexpr int deflate_level = 6;
constexpr int tile_side = 64;                               // of levels
static_assert(std::endian::native == std::endian::little);  // as the file

std::uint16_t scheme_of(const std::string& compression) {
  if (compression == "zip") return COMPRESSION_ADOBE_DEFLATE;
  if (compression == "lzw") return COMPRESSION_LZW;
  return compression == "packbits" ? COMPRESSION_PACKBITS : COMPRESSION_NONE;
}

bool is_real(PixelType type) { return type == PixelType::half || type == PixelType::float32; }

// --- strips and tiles ----------------------------------------------------------------------------------------------

// Rows of blocks, which are strips of whole lines or tiles.
struct Blocks {
  int width, height;  // of a block
  int across, count;

  Blocks(const StoredPixels& pixels, int tile) {
    width = tile > 0 ? tile : pixels.width;
    height = tile > 0 ? tile
                      : static_cast<int>(std::clamp<std::size_t>(strip_bytes / pixels.row_size(), 1,
                                                                 static_cast<std::size_t>(pixels.height)));
    across = (pixels.width + width - 1) / width;
    count = across * ((pixels.height + height - 1) / height);
  }
};

// Each sample less the one before it of the same channel.
template <class Sample>
void difference(std::uint8_t* row, std::size_t size, std::size_t channels) {
  for (std::size_t i = size / sizeof(Sample); i-- > channels;) {
    Sample a, b;
    std::memcpy(&a, row + (i - channels) * sizeof a, sizeof a);
    std::memcpy(&b, row + i * sizeof b, sizeof b);
    b = static_cast<Sample>(b - a);
    std::memcpy(row + i * sizeof b, &b, sizeof b);
  }
}

// What a block is made into, with buffers that are kept.
class BlockPacker {
 public:
  // Its lines; a tile goes on with zeros beyond the picture.
  void gather(const StoredPixels& pixels, const Blocks& blocks, std::int64_t number, bool whole) {
    const int x = static_cast<int>(number % blocks.across) * blocks.width;
    const int y = static_cast<int>(number / blocks.across) * blocks.height;
    const int rows = std::min(blocks.height, pixels.height - y);
    const std::size_t texel = pixels.texel_size();
    const std::size_t used = static_cast<std::size_t>(std::min(blocks.width, pixels.width - x)) * texel;
    line_ = static_cast<std::size_t>(blocks.width) * texel;
    bytes_.assign(line_ * static_cast<std::size_t>(whole ? blocks.height : rows), 0);
    for (int i = 0; i < rows; ++i)
      std::memcpy(bytes_.data() + static_cast<std::size_t>(i) * line_,
                  pixels.row(y + i) + static_cast<std::size_t>(x) * texel, used);
  }

  // Not by libtiff: it knows one thread, and where it has no memory to predict a line in, it stores another one.
  void pack(const StoredPixels& pixels, std::uint16_t scheme) {
    for (std::size_t at = 0; at < bytes_.size(); at += line_) predict(pixels, bytes_.data() + at);
    if (scheme == COMPRESSION_LZW) {
      lzw_.pack(bytes_, packed_);
    } else {
      packed_.resize(libdeflate_zlib_compress_bound(nullptr, bytes_.size()));
      packed_.resize(deflater_.zlib(bytes_, deflate_level, packed_));
    }
    bytes_.swap(packed_);
  }

  std::vector<std::uint8_t>& bytes() { return bytes_; }

 private:
  void predict(const StoredPixels& pixels, std::uint8_t* line) {
    const auto channels = static_cast<std::size_t>(pixels.channels);
    if (pixels.type == PixelType::uint8) return difference<std::uint8_t>(line, line_, channels);
    if (pixels.type == PixelType::uint16) return difference<std::uint16_t>(line, line_, channels);
    // All samples' highest bytes, then all next ones, and differences of those.
    const std::size_t size = size_of(pixels.type), samples = line_ / size;
    planes_.resize(line_);
    for (std::size_t byte = 0; byte < size; ++byte)
      for (std::size_t i = 0; i < samples; ++i) planes_[byte * samples + i] = line[i * size + size - 1 - byte];
    difference<std::uint8_t>(planes_.data(), line_, channels);
    std::memcpy(line, planes_.data(), line_);
  }

  Deflater deflater_;
  LzwEncoder lzw_;
  std::size_t line_ = 0;  // bytes
  std::vector<std::uint8_t> bytes_, packed_, planes_;
};

// --- libtiff's view of the file --------------------------------------------------------------------------------------

OutputFile& file_of(thandle_t handle) { return *static_cast<OutputFile*>(handle); }

tmsize_t read_bytes(thandle_t handle, void* to, tmsize_t size) {
  return static_cast<tmsize_t>(file_of(handle).read(to, static_cast<std::size_t>(size)));
}
tmsize_t write_bytes(thandle_t handle, void* from, tmsize_t size) {
  if (!from && size > 0) return -1;  // it had no memory, and takes no notice
  file_of(handle).write(from, static_cast<std::size_t>(size));
  return size;
}
toff_t seek(thandle_t handle, toff_t offset, int whence) {
  OutputFile& file = file_of(handle);
  file.seek(offset + (whence == SEEK_END ? file.size() : whence == SEEK_CUR ? file.tell() : 0));
  return file.tell();
}
int close(thandle_t) { return 0; }
toff_t size(thandle_t handle) { return file_of(handle).size(); }

}  // namespace

struct TiffWriter::State {
  OutputFile& file;
  std::string message;  // libtiff's last
  TIFF* tiff = nullptr;
  bool more = false;  // not the first picture
  bool incomplete = false;

  explicit State(OutputFile& f) : file(f) {}
  ~State() {
    // A directory that libtiff had no memory for it cannot free either: it would crash.
    if (!tiff || incomplete) return;
    // As if it had been read: what was left unfinished is not written, which may be more than libtiff can.
    TIFFSetMode(tiff, O_RDONLY);
    TIFFClose(tiff);
  }

  // A disk that is full has not got what was written, and says so itself when asked to sync.
  Result<Ok> failure() const {
    if (!file.sync()) return Ok{};
    return Error{ErrorCode::output, message.empty() ? "libtiff failed and gave no reason" : message};
  }

  // Fails only for want of memory, after which libtiff would go on without the field, or crash.
  template <class... Values>
  void set(std::uint32_t tag, Values... values) {
    if (TIFFSetField(tiff, tag, values...) != 1) incomplete = true;
  }

  void describe(const StoredPixels& pixels, const TiffStorage& storage, const Blocks& blocks) {
    if (more) set(TIFFTAG_SUBFILETYPE, FILETYPE_REDUCEDIMAGE);
    set(TIFFTAG_IMAGEWIDTH, static_cast<std::uint32_t>(pixels.width));
    set(TIFFTAG_IMAGELENGTH, static_cast<std::uint32_t>(pixels.height));
    set(TIFFTAG_SAMPLESPERPIXEL, pixels.channels);
    set(TIFFTAG_BITSPERSAMPLE, static_cast<int>(8 * size_of(pixels.type)));
    set(TIFFTAG_SAMPLEFORMAT, is_real(pixels.type) ? SAMPLEFORMAT_IEEEFP : SAMPLEFORMAT_UINT);
    set(TIFFTAG_ORIENTATION, ORIENTATION_TOPLEFT);
    set(TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    const int colors = pixels.channels >= 3 ? 3 : 1;
    set(TIFFTAG_PHOTOMETRIC, colors == 3 ? PHOTOMETRIC_RGB : PHOTOMETRIC_MINISBLACK);
    if (pixels.channels > colors) {
      std::vector<std::uint16_t> kinds(static_cast<std::size_t>(pixels.channels - colors), EXTRASAMPLE_UNSPECIFIED);
      if (pixels.alpha >= colors)
        kinds[static_cast<std::size_t>(pixels.alpha - colors)] =
            is_real(pixels.type) ? EXTRASAMPLE_ASSOCALPHA : EXTRASAMPLE_UNASSALPHA;
      set(TIFFTAG_EXTRASAMPLES, static_cast<int>(kinds.size()), kinds.data());
    }
    const std::uint16_t scheme = scheme_of(storage.compression);
    set(TIFFTAG_COMPRESSION, scheme);
    if (scheme == COMPRESSION_ADOBE_DEFLATE || scheme == COMPRESSION_LZW)
      set(TIFFTAG_PREDICTOR, is_real(pixels.type) ? PREDICTOR_FLOATINGPOINT : PREDICTOR_HORIZONTAL);
    if (storage.tile > 0) {
      set(TIFFTAG_TILEWIDTH, storage.tile);
      set(TIFFTAG_TILELENGTH, storage.tile);
      // By this, readers take the pictures that follow for levels.
      set(TIFFTAG_PIXAR_TEXTUREFORMAT, "Plain Texture");
    } else {
      set(TIFFTAG_ROWSPERSTRIP, static_cast<std::uint32_t>(blocks.height));
    }
    if (!storage.description.empty()) set(TIFFTAG_IMAGEDESCRIPTION, storage.description.c_str());
  }

  // A block whose bytes are as the file has them, or left to libtiff to compress.
  bool put(std::vector<std::uint8_t>& bytes, std::int64_t number, bool tiled, bool raw) {
    const auto write = tiled ? raw ? TIFFWriteRawTile : TIFFWriteEncodedTile
                       : raw ? TIFFWriteRawStrip
                             : TIFFWriteEncodedStrip;
    const auto length = static_cast<tmsize_t>(bytes.size());
    return write(tiff, static_cast<std::uint32_t>(number), bytes.data(), length) == length;
  }
};

TiffWriter::TiffWriter(OutputFile& file, std::uint64_t bytes, std::uint64_t largest)
    : state_(std::make_unique<State>(file)) {
  // What is deflated may grow by some bytes in a thousand; directories come on top.
  const bool big = bytes + bytes / 256 + (1 << 20) > largest;
  const TiffOptions options = tiff_messages_to(state_->message);
  state_->tiff = TIFFClientOpenExt("the file", big ? "wl8" : "wl", &file, read_bytes, write_bytes, seek, close, size,
                                   nullptr, nullptr, options.get());
}

TiffWriter::~TiffWriter() = default;

Result<Ok> TiffWriter::add(const StoredPixels& pixels, const TiffStorage& storage) {
  if (!state_->tiff) return state_->failure();
  const Blocks blocks(pixels, storage.tile);
  state_->describe(pixels, storage, blocks);
  if (state_->incomplete) throw std::bad_alloc();
  const std::uint16_t scheme = scheme_of(storage.compression);
  const bool tiled = storage.tile > 0, raw = scheme != COMPRESSION_PACKBITS;
  bool good = true;
  in_order<BlockPacker>(
      blocks.count,
      [&](BlockPacker& packer, std::int64_t number) {
        packer.gather(pixels, blocks, number, tiled);
        if (raw && scheme != COMPRESSION_NONE) packer.pack(pixels, scheme);
      },
      [&](BlockPacker& packer, std::int64_t number) {
        good = good && state_->put(packer.bytes(), number, tiled, raw);
      });
  state_->more = true;
  if (!good || !TIFFWriteDirectory(state_->tiff)) return state_->failure();
  return Ok{};
}

Result<Ok> TiffWriter::finish() {
  if (!state_->tiff) return state_->failure();
  TIFFClose(state_->tiff);
  state_->tiff = nullptr;
  return Ok{};
}

Result<Ok> write_tiff(OutputFile& file, std::span<const std::vector<Picture>> levels, const std::string& compression,
                      const WriteOptions& options, WriteReport& report) {
  std::uint64_t values = 0;
  for (const std::vector<Picture>& level : levels) values += level.front().image.value_count();
  TiffWriter writer(file, values * size_of(report.type));
  const TiffStorage storage{compression, join_metadata(options.metadata), levels.size() > 1 ? tile_side : 0};
  for (const std::vector<Picture>& level : levels)
    ENVCONV_CHECK(writer.add(stored_pixels(level.front(), options, report), storage));
  return writer.finish();
}

}  // namespace envconv
