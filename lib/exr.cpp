// SPDX-License-Identifier: Apache-2.0
#include "exr.h"

#include <ImfChannelList.h>
#include <ImfChromaticitiesAttribute.h>
#include <ImfEnvmap.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputPart.h>
#include <ImfMultiPartInputFile.h>
#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <ImfStringAttribute.h>
#include <ImfThreading.h>
#include <ImfTiledInputPart.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>
#include <optional>

#include "exr_chunk_reader.h"
#include "exr_shared.h"
#include "output_file.h"

namespace envconv {
namespace {

Error bad_input(std::string what) { return {ErrorCode::input, std::move(what)}; }

Error damaged(const std::exception& error) { return exr_failure(ErrorCode::input, "truncated or damaged: ", error); }

class FileStream final : public Imf::IStream {
 public:
  FileStream(int fd, std::uint64_t size) : IStream(kStreamName), fd_(fd), size_(size), buffer_(kBuffer) {}

  bool read(char* c, int n) override {
    if (n < 0) throw Iex::InputExc("negative size");
    auto left = static_cast<std::size_t>(n);
    if (left > size_ - std::min(position_, size_)) throw Iex::InputExc("unexpected end of file");
    while (left > 0) {
      if (position_ >= start_ && position_ < start_ + filled_) {
        const std::size_t offset = static_cast<std::size_t>(position_ - start_);
        const std::size_t part = std::min(left, filled_ - offset);
        std::memcpy(c, buffer_.data() + offset, part);
        c += part;
        left -= part;
        position_ += part;
      } else if (left >= kBuffer) {
        const std::size_t part = fetch(c, left);
        c += part;
        left -= part;
        position_ += part;
      } else {
        filled_ = 0;
        start_ = position_;
        filled_ = fetch(buffer_.data(), kBuffer);
      }
    }
    return position_ < size_;
  }
  std::uint64_t tellg() override { return position_; }
  void seekg(std::uint64_t position) override { position_ = position; }

 private:
  static constexpr std::size_t kBuffer = 16384;

  std::size_t fetch(char* to, std::size_t count) {
    for (;;) {
      const ssize_t n = ::pread(fd_, to, count, static_cast<off_t>(position_));
      if (n > 0) return static_cast<std::size_t>(n);
      if (n == 0) throw Iex::InputExc("unexpected end of file");
      if (errno != EINTR) throw Iex::InputExc(std::string("cannot be read: ") + std::strerror(errno));
    }
  }

  int fd_;
  std::uint64_t size_, position_ = 0, start_ = 0;
  std::size_t filled_ = 0;
  std::vector<char> buffer_;
};

PixelType type_of(Imf::PixelType type) {
  switch (type) {
    case Imf::HALF: return PixelType::half;
    case Imf::UINT: return PixelType::uint32;
    default: return PixelType::float32;
  }
}

// "R" for "R", "r", "red"; "" for what is no colour.
std::string colour_of(const std::string& name) {
  std::string lower;
  for (const char c : name) lower += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  for (const auto& [full, brief] : {std::pair{"red", "R"}, {"green", "G"}, {"blue", "B"}, {"alpha", "A"}}) {
    if (lower == full || (lower.size() == 1 && lower[0] == full[0])) return brief;
  }
  return lower == "y" ? "Y" : "";
}

struct Pick {
  std::vector<std::string> stored;  // names in the file
  Channels channels;                // what they mean
  std::vector<std::string> left_out;
};

// The channels that are the picture: RGB(A) of the base layer, else Y(A) alone, else RGB(A) of the first layer that has
// it, else everything in the file's order.
Result<Pick> pick_channels(const Imf::ChannelList& list) {
  std::vector<std::string> all;
  std::vector<std::string> layers{""};
  for (auto it = list.begin(); it != list.end(); ++it) {
    const std::string name = it.name();
    all.push_back(name);
    const std::size_t dot = name.rfind('.');
    if (dot != std::string::npos) {
      const std::string layer = name.substr(0, dot + 1);
      if (std::find(layers.begin(), layers.end(), layer) == layers.end()) layers.push_back(layer);
    }
  }
  if (all.empty()) return bad_input("has no channels");
  const bool chroma = list.findChannel("RY") && list.findChannel("BY");
  if (chroma && list.findChannel("Y")) {
    return bad_input(
        "stored as luminance and subsampled chroma (Y, RY, BY), which is not supported (convert it to RGB)");
  }
  Pick pick;
  const auto take = [&](const std::string& layer, const std::vector<std::string>& wanted) {
    Pick found;
    for (const std::string& colour : wanted) {
      for (const std::string& name : all) {
        if (name.size() > layer.size() && name.compare(0, layer.size(), layer) == 0 &&
            name.find('.', layer.size()) == std::string::npos && colour_of(name.substr(layer.size())) == colour) {
          found.stored.push_back(name);
          found.channels.names.push_back(colour);
          break;
        }
      }
      if (found.channels.names.empty() || found.channels.names.back() != colour) {
        if (colour != "A") return false;
      }
    }
    pick = found;
    return true;
  };
  bool found = false;
  for (const std::string& layer : layers) {
    if ((found = take(layer, {"R", "G", "B", "A"}))) break;
  }
  if (!found) {
    found = take("", {"Y", "A"}) && pick.stored.size() == all.size();
    if (!found) {
      pick = {};
      pick.stored = pick.channels.names = all;
    }
  }
  for (const std::string& name : all) {
    if (std::find(pick.stored.begin(), pick.stored.end(), name) == pick.stored.end()) pick.left_out.push_back(name);
  }
  for (std::size_t i = 0; i < pick.channels.names.size(); ++i) {
    if (pick.channels.names[i] == "A") pick.channels.alpha = static_cast<int>(i);
  }
  if (pick.channels.count() > kMaxChannels) {
    return bad_input("has " + std::to_string(all.size()) + " channels (at most " + std::to_string(kMaxChannels) +
                     " can be read)");
  }
  for (const std::string& name : pick.stored) {
    const Imf::Channel& channel = list[name.c_str()];
    if (channel.xSampling != 1 || channel.ySampling != 1) {
      return bad_input("channel " + name + " is subsampled, which is not supported (convert it to RGB)");
    }
  }
  return pick;
}

struct Window {
  std::int64_t x0, y0, x1, y1;  // inclusive
  explicit Window(const Imath::Box2i& box) : x0(box.min.x), y0(box.min.y), x1(box.max.x), y1(box.max.y) {}
  std::int64_t width() const { return x1 - x0 + 1; }
  std::int64_t height() const { return y1 - y0 + 1; }
  std::string text() const {
    return std::to_string(width()) + "x" + std::to_string(height()) + " at (" + std::to_string(x0) + ", " +
           std::to_string(y0) + ")";
  }
};

// A part of an open file, which always has a type.  A description of tiles may have stayed in a file of lines.
bool is_tiled(const Imf::Header& header) { return header.type() == Imf::TILEDIMAGE; }

class ExrDecoder final : public Decoder {
 public:
  ExrDecoder(int fd, std::uint64_t size) : fd_(fd), stream_(fd, size), size_(size) {}

  Result<Ok> open(const DecoderOptions& options) {
    threads_ = options.threads;
    if (holds_deep_data(fd_)) return bad_input("deep images are not environment maps");
    ENVCONV_TRY(tables_, find_offset_tables(fd_, size_));
    try {
      file_ = std::make_unique<Imf::MultiPartInputFile>(stream_, threads_, false);
      const int parts = file_->parts();
      if (parts < 1) return bad_input("has no parts");
      if (parts > kMaxPictures) {
        return bad_input("has " + std::to_string(parts) + " parts (at most " + std::to_string(kMaxPictures) +
                         " can be read)");
      }
      for (int part = 0; part < parts; ++part) ENVCONV_CHECK(add(part, options));
    } catch (const std::bad_alloc&) {
      return Error{ErrorCode::limit, "not enough memory to open it"};
    } catch (const std::exception& error) {
      return damaged(error);
    }
    return Ok{};
  }

  const FileSpec& spec() const override { return spec_; }

  Result<Ok> decode(int picture, void* pixels) override {
    return decode_rows(picture, 0, spec_.pictures[static_cast<std::size_t>(picture)].height, pixels);
  }

  Result<Ok> decode_rows(int picture, int first, int count, void* pixels) override {
    ENVCONV_CHECK(read_rows(picture, first, count, pixels));
    return check_values(picture, count, static_cast<const float*>(pixels));
  }

 private:
  Result<Ok> read_rows(int picture, int first, int count, void* pixels) {
    const Part& part = parts_[static_cast<std::size_t>(picture)];
    const PictureSpec& target = spec_.pictures[static_cast<std::size_t>(picture)];
    try {
      ENVCONV_CHECK(check_once());
      auto* base = static_cast<float*>(pixels);
      const std::optional<ChunkGrid> chunks = chunks_of(picture);
      if (chunks) {
        const ChunkTarget place{base,
                                target.width,
                                count,
                                target.channels.count(),
                                part.origin_x - part.data.x0,
                                part.origin_y - part.data.y0 + first};
        buffers_.resize(static_cast<std::size_t>(std::max(threads_, 1)));
        return read_chunks(*chunks, place, buffers_);
      }
      if (threads_ > 1) set_exr_pool_threads(threads_);
      const auto channels = static_cast<std::size_t>(target.channels.count());
      if (part.data.width() == target.width) {
        // The data window has the picture's columns: straight into place.
        const std::int64_t top = part.origin_y + first, bottom = top + count - 1;
        const Imf::FrameBuffer frame =
            frame_buffer(part, base, part.origin_x, top, static_cast<std::size_t>(target.width), channels);
        if (part.tiled && part.data.height() == target.height) {
          Imf::TiledInputPart tiles(*file_, picture);
          tiles.setFrameBuffer(frame);
          const int level = part.level, side = static_cast<int>(tiles.tileYSize());
          tiles.readTiles(0, tiles.numXTiles(level) - 1, first / side, (first + count - 1) / side, level);
        } else {
          Imf::InputPart lines(*file_, picture);
          lines.setFrameBuffer(frame);
          lines.readPixels(static_cast<int>(top), static_cast<int>(bottom));
        }
        return Ok{};
      }
      // Wider than the picture: bands of whole lines, of which the middle is kept.
      Imf::InputPart lines(*file_, picture);
      const auto width = static_cast<std::size_t>(part.data.width());
      constexpr int kBand = 64;
      std::vector<float> band(width * channels * kBand);
      for (int y = 0; y < count; y += kBand) {
        const int rows = std::min(kBand, count - y);
        std::fill(band.begin(), band.end(), 0.f);
        const std::int64_t top = part.origin_y + first + y;
        lines.setFrameBuffer(frame_buffer(part, band.data(), part.data.x0, top, width, channels));
        lines.readPixels(static_cast<int>(top), static_cast<int>(top + rows - 1));
        const std::size_t row_values = static_cast<std::size_t>(target.width) * channels;
        for (int row = 0; row < rows; ++row) {
          const float* from = band.data() + (static_cast<std::size_t>(row) * width +
                                             static_cast<std::size_t>(part.origin_x - part.data.x0)) *
                                                channels;
          std::copy_n(from, row_values, base + static_cast<std::size_t>(y + row) * row_values);
        }
      }
    } catch (const std::bad_alloc&) {
      return Error{ErrorCode::limit, "not enough memory to decode it"};
    } catch (const std::exception& error) {
      return damaged(error);
    }
    return Ok{};
  }

  struct Part {
    Window data;
    std::vector<std::string> stored;
    bool tiled;
    int level;                        // of a tiled part; 0 of others
    std::int64_t origin_x, origin_y;  // of the picture, in the data window's coordinates
    std::int64_t full_width = data.width(), full_height = data.height();  // of level 0

    // Makes the data window and the picture's size those of the level, whose origin is level 0's.  False where the
    // picture is not the whole of it, or levels are not halved along both axes together.
    bool reduce(const Imf::TileDescription& tiles, std::int64_t& width, std::int64_t& height) {
      if (tiles.mode != Imf::MIPMAP_LEVELS || width != data.width() || height != data.height()) return false;
      width = reduced(width, level, tiles.roundingMode), height = reduced(height, level, tiles.roundingMode);
      data.x1 = data.x0 + width - 1, data.y1 = data.y0 + height - 1;
      return true;
    }
  };

  // B44 has no checksum, but takes NaN for 0 when it packs: where there are NaN, blocks are not what was packed.
  Result<Ok> check_values(int picture, int count, const float* pixels) const {
    const Imf::Header& header = file_->header(picture);
    if (header.compression() != Imf::B44_COMPRESSION && header.compression() != Imf::B44A_COMPRESSION) return Ok{};
    const std::vector<std::string>& names = parts_[static_cast<std::size_t>(picture)].stored;
    const auto texels = static_cast<std::size_t>(spec_.pictures[static_cast<std::size_t>(picture)].width) *
                        static_cast<std::size_t>(count);
    for (std::size_t c = 0; c < names.size(); ++c) {
      if (header.channels()[names[c].c_str()].type != Imf::HALF) continue;  // stored as they are
      for (std::size_t i = 0; i < texels; ++i) {
        if (std::isnan(pixels[i * names.size() + c]))
          return bad_input("truncated or damaged: NaN, which B44 cannot hold");
      }
    }
    return Ok{};
  }

  // All of the file must be there, whatever is read of it.
  Result<Ok> check_once() {
    if (checked_) return Ok{};
    std::vector<PartChunks> chunks;
    for (int i = 0; i < file_->parts(); ++i) chunks.push_back(chunks_of_part(file_->header(i)));
    ENVCONV_CHECK(check_chunks(fd_, size_, tables_, chunks));
    checked_ = true;
    return Ok{};
  }

  static PartChunks chunks_of_part(const Imf::Header& header) {
    const Window data(header.dataWindow());
    const bool opaque = !chunks_are_unpacked_here(header.compression());
    if (!is_tiled(header)) {
      const std::int64_t lines = chunk_lines(header.compression());
      return {static_cast<std::uint64_t>((data.height() + lines - 1) / lines), false, opaque};
    }
    const Imf::TileDescription& tiles = header.tileDescription();
    const bool apart = tiles.mode == Imf::RIPMAP_LEVELS;
    PartChunks part{0, true, opaque};
    const auto add = [&](int x, int y) {
      const BlockGrid grid{reduced(data.width(), x, tiles.roundingMode), reduced(data.height(), y, tiles.roundingMode),
                           tiles.xSize, tiles.ySize};
      part.count += static_cast<std::uint64_t>(grid.count());
    };
    const int levels = level_count(tiles, data.width(), apart ? data.width() : data.height());
    const int down = apart ? level_count(tiles, data.height(), data.height()) : 1;
    for (int y = 0; y < down; ++y) {
      for (int x = 0; x < levels; ++x) add(x, apart ? y : x);
    }
    return part;
  }

  // Whole tiles, or whole blocks of lines from the data window's first on; and several for each thread.
  int band_of(const PictureSpec& picture, const Part& part, const Imf::Header& header) const {
    constexpr int kMostLines = 32;  // of a block, but for DWAB
    const bool dwab = header.compression() == Imf::DWAB_COMPRESSION;
    const std::int64_t side = part.tiled ? header.tileDescription().ySize : dwab ? 256 : kMostLines;
    if (side >= picture.height) return 0;
    const int block = static_cast<int>(side);
    return band_rows(picture, block, part.tiled ? block : block * std::max(1, threads_));
  }

  // How the pixels of a part lie in the file; nothing where OpenEXR must unpack them.
  std::optional<ChunkGrid> chunks_of(int picture) const {
    const Imf::Header& header = file_->header(picture);
    const Part& part = parts_[static_cast<std::size_t>(picture)];
    const Imf::Compression compression = header.compression();
    if (!chunks_are_unpacked_here(compression)) return {};
    ChunkGrid grid;
    grid.fd = fd_;
    grid.file_size = size_;
    grid.multi_part = is_multi_part(fd_);
    grid.part = picture;
    for (auto it = header.channels().begin(); it != header.channels().end(); ++it) {
      const Imf::Channel& channel = it.channel();
      if (channel.xSampling != 1 || channel.ySampling != 1) return {};
      const auto wanted = std::find(part.stored.begin(), part.stored.end(), it.name());
      grid.channels.push_back(
          {type_of(channel.type), wanted == part.stored.end() ? -1 : static_cast<int>(wanted - part.stored.begin())});
    }
    grid.tiled = part.tiled;
    grid.compression = compression;
    grid.level = part.level;
    grid.top = part.data.y0;
    grid.width = part.data.width(), grid.height = part.data.height();
    grid.block_width = grid.width, grid.block_height = chunk_lines(compression);
    std::uint64_t before = 0;  // chunks whose offsets come first
    for (int earlier = 0; earlier < picture; ++earlier) {
      before += static_cast<std::uint64_t>(std::max(file_->header(earlier).chunkCount(), 0));
    }
    if (part.tiled) {
      const Imf::TileDescription& tiles = header.tileDescription();
      grid.block_width = tiles.xSize, grid.block_height = tiles.ySize;
      for (int level = 0; level < part.level; ++level) {
        const BlockGrid larger{reduced(part.full_width, level, tiles.roundingMode),
                               reduced(part.full_height, level, tiles.roundingMode), tiles.xSize, tiles.ySize};
        before += static_cast<std::uint64_t>(larger.count());
      }
    }
    if (grid.largest_chunk() > std::numeric_limits<std::int32_t>::max()) return {};
    grid.table = tables_ + before * 8;
    return grid;
  }

  static Imf::FrameBuffer frame_buffer(const Part& part, float* base, std::int64_t x0, std::int64_t y0,
                                       std::size_t width, std::size_t channels) {
    Imf::FrameBuffer frame;
    const std::size_t x_stride = channels * sizeof(float), y_stride = width * x_stride;
    // OpenEXR adds coordinates times strides, modulo 2^64: the same arithmetic takes the origin off again.
    const std::uint64_t origin = static_cast<std::uint64_t>(x0) * x_stride + static_cast<std::uint64_t>(y0) * y_stride;
    for (std::size_t c = 0; c < part.stored.size(); ++c) {
      char* slice = reinterpret_cast<char*>(reinterpret_cast<std::uintptr_t>(base + c) - origin);
      frame.insert(part.stored[c], Imf::Slice(Imf::FLOAT, slice, x_stride, y_stride));
    }
    return frame;
  }

  Result<Ok> add(int index, const DecoderOptions& options) {
    const Imf::Header& header = file_->header(index);
    if (Imf::isDeepData(header.type())) return bad_input("deep images are not environment maps");
    if (header.type() != Imf::TILEDIMAGE && header.type() != Imf::SCANLINEIMAGE)
      return bad_input("a part of type " + printable(header.type().substr(0, 64)) + ", which is not known");
    Window data(header.dataWindow());
    const Window display(header.displayWindow());
    if (data.width() < 1 || data.height() < 1) return bad_input("an empty image");
    PictureSpec picture;
    Part part{data, {}, is_tiled(header), 0, data.x0, data.y0};
    std::int64_t width = data.width(), height = data.height();
    const bool same_size = width == display.width() && height == display.height();
    const bool ours = header.find("envconv:layout") != header.end();
    const bool contains =
        data.x0 <= display.x0 && data.y0 <= display.y0 && data.x1 >= display.x1 && data.y1 >= display.y1;
    // The same size elsewhere is the same picture; a part of it there, and a part beside it, may be not.
    const bool overlaps =
        data.x0 <= display.x1 && data.x1 >= display.x0 && data.y0 <= display.y1 && data.y1 >= display.y0;
    if (same_size && !contains && overlaps) {
      spec_.warnings.push_back("the data window (" + data.text() + ") is shifted against the display window (" +
                               display.text() + "): its pixels are taken for all of the picture");
    }
    // The parts of a file must share one display window, so faces of several sizes do not fill theirs.
    if (!same_size && !(ours && file_->parts() > 1)) {
      if (!contains || display.width() < 1 || display.height() < 1) {
        return bad_input("the data window (" + data.text() + ") does not cover the display window (" + display.text() +
                         "): part of the environment is missing");
      }
      width = display.width();
      height = display.height();
      part.origin_x = display.x0;
      part.origin_y = display.y0;
      spec_.warnings.push_back("overscan cropped: the data window is " + data.text() + ", the display window " +
                               display.text());
    }
    if (width > std::numeric_limits<int>::max() || height > std::numeric_limits<int>::max() ||
        width > options.max_pixels / height || data.width() > options.max_pixels / height) {
      return too_many_pixels(std::max(width, data.width()), height, options.max_pixels);
    }
    ENVCONV_TRY(Pick pick, pick_channels(header.channels()));
    if (part.tiled) {
      const Imf::TileDescription& tiles = header.tileDescription();
      const auto limit =
          std::max<std::uint64_t>(std::uint64_t{1} << 24, static_cast<std::uint64_t>(width * height) * 4);
      if (tiles.xSize == 0 || tiles.ySize == 0 || tiles.ySize > limit / tiles.xSize) {
        return bad_input("truncated or damaged: it claims tiles of " + std::to_string(tiles.xSize) + "x" +
                         std::to_string(tiles.ySize) + " texels");
      }
      const int levels = level_count(tiles, data.width(), data.height());
      // The largest part's: smaller ones repeat their last.
      spec_.levels = std::max(spec_.levels, levels);
      part.level = std::clamp(options.level, 0, levels - 1);
      if (part.level > 0 && !part.reduce(tiles, width, height))
        return bad_input("its levels have overscan, or are halved along each axis apart, which is not supported");
    }
    if (!pick.left_out.empty()) {
      std::string list;
      std::size_t shown = 0;
      for (const std::string& name : pick.left_out) {
        if (++shown > 8) {
          list += " and " + std::to_string(pick.left_out.size() - 8) + " more";
          break;
        }
        list += (list.empty() ? "" : ", ") + name.substr(0, 64);
      }
      spec_.warnings.push_back("channels left out: " + list);
    }
    picture.name = header.hasName() ? header.name() : "";
    picture.width = static_cast<int>(width);
    picture.height = static_cast<int>(height);
    picture.channels = pick.channels;
    picture.type = type_of(header.channels()[pick.stored.front().c_str()].type);
    part.stored = pick.stored;
    picture.band = band_of(picture, part, header);
    if (index == 0) {
      for (const CompressionName& compression : kCompressions) {
        if (compression.value == header.compression()) spec_.compression = compression.name;
      }
      for (auto it = header.begin(); it != header.end(); ++it) {
        const auto* text = dynamic_cast<const Imf::StringAttribute*>(&it.attribute());
        if (text && std::strncmp(it.name(), "envconv:", 8) == 0) spec_.metadata[it.name()] = text->value();
      }
      // Linear light, of the primaries that are told or of Rec. 709 (the OpenEXR file format's default).
      if (Imf::hasChromaticities(header)) {
        const Imf::Chromaticities& c = Imf::chromaticities(header);
        spec_.primaries =
            usable_primaries({c.red.x, c.red.y, c.green.x, c.green.y, c.blue.x, c.blue.y, c.white.x, c.white.y});
        if (spec_.primaries) spec_.color_how = "chromaticities";
      }
      if (const auto* envmap = header.findTypedAttribute<Imf::EnvmapAttribute>("envmap")) {
        switch (envmap->value()) {
          case Imf::ENVMAP_LATLONG: spec_.metadata["envmap"] = "latlong"; break;
          case Imf::ENVMAP_CUBE: spec_.metadata["envmap"] = "cube"; break;
          default:
            // The layout may still be said by other means; whoever recognises it decides.
            spec_.metadata["envmap"] = "unknown " + std::to_string(static_cast<int>(envmap->value()));
        }
      }
    }
    spec_.pictures.push_back(std::move(picture));
    parts_.push_back(std::move(part));
    return Ok{};
  }

  int fd_;
  FileStream stream_;
  std::uint64_t size_, tables_ = 0;
  int threads_ = 0;
  std::vector<ChunkBuffers> buffers_;  // of each thread
  bool checked_ = false;
  std::unique_ptr<Imf::MultiPartInputFile> file_;
  FileSpec spec_;
  std::vector<Part> parts_;
};

}  // namespace

Result<std::unique_ptr<Decoder>> open_exr(int fd, const DecoderOptions& options) {
  struct stat info {};
  if (::fstat(fd, &info) != 0) return bad_input(std::strerror(errno));
  auto decoder = std::make_unique<ExrDecoder>(fd, static_cast<std::uint64_t>(info.st_size));
  ENVCONV_CHECK(decoder->open(options));
  return std::unique_ptr<Decoder>(std::move(decoder));
}

int exr_pool_threads() { return Imf::globalThreadCount(); }

void set_exr_pool_threads(int count) {
  // The pool is the process's: it only grows here, so that files written at the same time keep what they started with.
  static std::mutex mutex;
  const std::lock_guard lock(mutex);
  if (count > Imf::globalThreadCount() || count == 0) Imf::setGlobalThreadCount(count);
}

}  // namespace envconv
