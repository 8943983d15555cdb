// SPDX-License-Identifier: Apache-2.0
// Writing OpenEXR files: scan lines, parts, and tiles with MIP levels.
#include <ImfChannelList.h>
#include <ImfEnvmap.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <ImfStringAttribute.h>
#include <ImfThreading.h>
#include <ImfTiledOutputFile.h>
#include <ImfTiledOutputPart.h>
#include <half.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <span>

#include "exr.h"
#include "exr_shared.h"

namespace envconv {
namespace {

class OutputStream final : public Imf::OStream {
 public:
  explicit OutputStream(OutputFile& file) : OStream(kStreamName), file_(file) {}
  void write(const char c[], int n) override { file_.write(c, static_cast<std::size_t>(std::max(n, 0))); }
  std::uint64_t tellp() override { return file_.tell(); }
  void seekp(std::uint64_t position) override { file_.seek(position); }

 private:
  OutputFile& file_;
};

constexpr unsigned tile_side = 64;

struct Compression {
  Imf::Compression value = Imf::ZIP_COMPRESSION;
  bool has_level = false;
  float level = 0;
};

Result<Compression> parse_compression(const std::string& text) {
  Compression result;
  if (text.empty()) return result;
  const std::size_t colon = text.find(':');
  const std::string name = text.substr(0, colon);
  bool known = false;
  for (const CompressionName& entry : kCompressions) {
    if (name == entry.name) {
      result.value = entry.value;
      known = true;
    }
  }
  const bool dwa = result.value == Imf::DWAA_COMPRESSION || result.value == Imf::DWAB_COMPRESSION;
  const bool zip = result.value == Imf::ZIP_COMPRESSION || result.value == Imf::ZIPS_COMPRESSION;
  if (known && colon != std::string::npos) {
    const char* end = text.data() + text.size();
    const auto parsed = std::from_chars(text.data() + colon + 1, end, result.level);
    known = parsed.ec == std::errc() && parsed.ptr == end &&
            ((dwa && result.level >= 0 && result.level <= 1e6f) || (zip && result.level >= 1 && result.level <= 9));
    result.has_level = true;
  }
  if (!known) {
    return Error{ErrorCode::unsupported, "OpenEXR has no compression \"" + printable(text) +
                                             "\" (none rle zip[:1-9] zips[:1-9] piz pxr24 b44 b44a dwaa[:level] "
                                             "dwab[:level])"};
  }
  return result;
}

// The attribute is defined for RGB in linear light.
std::optional<Imf::Chromaticities> chromaticities_of(const ColorEncoding& color, const Channels& channels) {
  if (color.transfer != Transfer::linear || !color.primaries || channels.count() < 3) return {};
  if (channels.names[0] != "R" || channels.names[1] != "G" || channels.names[2] != "B") return {};
  const std::array<double, 8> v = chromaticity_values(*color.primaries);
  std::array<float, 8> f{};
  std::transform(v.begin(), v.end(), f.begin(), [](double x) { return static_cast<float>(x); });
  return Imf::Chromaticities({f[0], f[1]}, {f[2], f[3]}, {f[4], f[5]}, {f[6], f[7]});
}

struct Counts {
  std::atomic<std::int64_t> high{0}, negative{0}, nonfinite{0};
  void add_to(WriteReport& report) const {
    report.clamped_high += high;
    report.clamped_negative += negative;
    report.nonfinite += nonfinite;
  }
};

// One value; counters are the caller's.
Imath::half to_half(float v, std::int64_t& high, std::int64_t& nonfinite) {
  constexpr float kMax = 65504.f;
  if (!(std::abs(v) <= kMax)) {
    if (std::isnan(v)) {
      ++nonfinite;
      return Imath::half(0.f);
    }
    if (std::isinf(v)) {
      ++nonfinite;
    } else if (std::abs(v) >= 65520.f) {
      ++high;  // what is nearer rounds to the largest
    }
    return Imath::half(std::copysign(kMax, v));
  }
  return Imath::half(v);
}

std::uint32_t to_uint32(float v, std::int64_t& high, std::int64_t& negative, std::int64_t& nonfinite) {
  constexpr std::uint32_t kMax = std::numeric_limits<std::uint32_t>::max();
  if (std::isnan(v)) {
    ++nonfinite;
    return 0;
  }
  if (v < 0) {
    ++(std::isinf(v) ? nonfinite : negative);
    return 0;
  }
  if (v >= 4294967296.f) {
    ++(std::isinf(v) ? nonfinite : high);
    return kMax;
  }
  return static_cast<std::uint32_t>(std::min(std::rint(static_cast<double>(v)), static_cast<double>(kMax)));
}

// Values as the file has them; floats are only counted, and `to` may be null.
void convert_values(const float* from, std::size_t count, Imf::PixelType type, char* to, Counts& counts) {
  std::int64_t high = 0, negative = 0, nonfinite = 0;
  if (type == Imf::HALF) {
    auto* halves = reinterpret_cast<Imath::half*>(to);
    for (std::size_t k = 0; k < count; ++k) halves[k] = to_half(from[k], high, nonfinite);
  } else if (type == Imf::UINT) {
    auto* integers = reinterpret_cast<std::uint32_t*>(to);
    for (std::size_t k = 0; k < count; ++k) integers[k] = to_uint32(from[k], high, negative, nonfinite);
  } else {
    for (std::size_t k = 0; k < count; ++k) nonfinite += !std::isfinite(from[k]);
  }
  counts.high += high;
  counts.negative += negative;
  counts.nonfinite += nonfinite;
}

// Lines that are converted and written at a time: a multiple of every codec's block of lines and of a tile's side, and
// enough of them to keep all threads busy.
int band_lines(std::size_t row_values) {
  return std::max(256, static_cast<int>(std::min<std::size_t>(4096, (std::size_t{1} << 22) / row_values))) / 256 * 256;
}

// Rows from `first` on as the file has them, one after the other.
void convert_band(const Image& image, int first, int rows, Imf::PixelType type, char* to, Counts& counts) {
  const std::size_t values = static_cast<std::size_t>(image.width()) * static_cast<std::size_t>(image.channels());
  const std::size_t bytes = values * (type == Imf::HALF ? 2 : 4);
  tbb::parallel_for(0, rows, [&](int row) {
    convert_values(image.row(first + row), values, type, to ? to + static_cast<std::size_t>(row) * bytes : nullptr,
                   counts);
  });
}

// `base` is the first value of line `y`; OpenEXR counts from line 0.
Imf::FrameBuffer frame_of(const Picture& names, const char* base, int y, Imf::PixelType type, std::size_t channels,
                          std::size_t row_values) {
  const std::size_t element = type == Imf::HALF ? 2 : 4, x_stride = channels * element, y_stride = row_values * element;
  Imf::FrameBuffer frame;
  for (std::size_t c = 0; c < channels; ++c) {
    const std::uintptr_t origin =
        reinterpret_cast<std::uintptr_t>(base) + c * element - static_cast<std::uintptr_t>(y) * y_stride;
    frame.insert(names.channels.names[c], Imf::Slice(type, reinterpret_cast<char*>(origin), x_stride, y_stride));
  }
  return frame;
}

Imf::PixelType stored_type(const WriteReport& report) {
  return report.type == PixelType::half ? Imf::HALF : report.type == PixelType::uint32 ? Imf::UINT : Imf::FLOAT;
}

// One header a picture.  With levels: tiles, halved and rounded down.
std::vector<Imf::Header> make_headers(const std::vector<Picture>& pictures, const WriteOptions& options,
                                      const Compression& compression, Imf::PixelType type, bool levels) {
  int width = 1, height = 1;
  for (const Picture& picture : pictures) {
    width = std::max(width, picture.image.width());
    height = std::max(height, picture.image.height());
  }
  std::vector<Imf::Header> headers;
  std::set<std::string> names;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    const Picture& picture = pictures[i];
    // All parts of a file share a display window.
    Imf::Header header(width, height);
    header.dataWindow() = Imath::Box2i({0, 0}, {picture.image.width() - 1, picture.image.height() - 1});
    header.compression() = compression.value;
    if (compression.has_level) {
      const bool dwa = compression.value == Imf::DWAA_COMPRESSION || compression.value == Imf::DWAB_COMPRESSION;
      // DWA deflates too: its level must not become zlib's.
      if (dwa) {
        header.dwaCompressionLevel() = compression.level;
      } else {
        header.zipCompressionLevel() = static_cast<int>(compression.level);
      }
    }
    if (const auto chromaticities = chromaticities_of(options.color, picture.channels)) {
      Imf::addChromaticities(header, *chromaticities);
    }
    for (const std::string& name : picture.channels.names) header.channels().insert(name, Imf::Channel(type));
    for (const auto& [name, value] : options.metadata) {
      if (name == "envmap") {
        Imf::addEnvmap(header, value == "cube" ? Imf::ENVMAP_CUBE : Imf::ENVMAP_LATLONG);
      } else {
        header.insert(name, Imf::StringAttribute(value));
      }
    }
    if (pictures.size() > 1) {
      std::string name = picture.name.empty() ? "part" + std::to_string(i) : picture.name;
      while (!names.insert(name).second) name += "_";
      header.setName(name);
      header.setType(levels ? Imf::TILEDIMAGE : Imf::SCANLINEIMAGE);
    }
    if (levels) header.setTileDescription({tile_side, tile_side, Imf::MIPMAP_LEVELS, Imf::ROUND_DOWN});
    headers.push_back(std::move(header));
  }
  return headers;
}

// Half the size, rounded down: means of 2x2 pixels, as they are.
Image halved(const Image& image) {
  Image out(std::max(1, image.width() / 2), std::max(1, image.height() / 2), image.channels());
  for (int y = 0; y < out.height(); ++y)
    for (int x = 0; x < out.width(); ++x)
      for (int c = 0; c < image.channels(); ++c) {
        float sum = 0;
        for (const int j : {0, 1})
          for (const int i : {0, 1})
            sum += image.at(std::min(2 * x + i, image.width() - 1), std::min(2 * y + j, image.height() - 1))[c];
        out.at(x, y)[c] = 0.25f * sum;
      }
  return out;
}

// Writes one level of a part; `Part` is a tiled file or a tiled part of one.  Rows of tiles that are enough to keep all
// threads busy are converted and written at a time.
template <class Part>
void write_level(Part& part, int level, const Picture& names, const Image& image, Imf::PixelType type, Counts& counts) {
  const auto channels = static_cast<std::size_t>(image.channels());
  const std::size_t row_values = static_cast<std::size_t>(image.width()) * channels;
  const std::size_t element = type == Imf::HALF ? 2 : 4;
  const bool convert = type != Imf::FLOAT;
  const int tile = static_cast<int>(tile_side), band = band_lines(row_values);
  std::vector<char> buffer(convert ? row_values * element * static_cast<std::size_t>(std::min(band, image.height()))
                                   : 0);
  for (int y = 0; y < image.height(); y += band) {
    const int rows = std::min(band, image.height() - y);
    convert_band(image, y, rows, type, convert ? buffer.data() : nullptr, counts);
    const char* base = convert ? buffer.data() : reinterpret_cast<const char*>(image.row(y));
    part.setFrameBuffer(frame_of(names, base, y, type, channels, row_values));
    part.writeTiles(0, part.numXTiles(level) - 1, y / tile, (y + rows - 1) / tile, level);
  }
}

// All levels of one picture.  OpenEXR's chain goes on until the packed image is one texel, which is further than a
// chain of faces beside each other goes: what remains are means of the last level.
template <class Part>
Result<Ok> write_part_levels(Part& part, std::size_t picture, std::span<const std::vector<Picture>> levels,
                             Imf::PixelType type, Counts& counts) {
  Image tail;
  for (int level = 0; level < part.numLevels(); ++level) {
    const auto k = static_cast<std::size_t>(level);
    const bool given = k < levels.size();
    if (!given) tail = halved(tail.empty() ? levels.back()[picture].image : tail);
    const Image& image = given ? levels[k][picture].image : tail;
    if (image.width() != part.levelWidth(level) || image.height() != part.levelHeight(level))
      return Error{ErrorCode::unsupported, "level " + std::to_string(level) + " is " + std::to_string(image.width()) +
                                               "x" + std::to_string(image.height()) + ", where OpenEXR wants " +
                                               std::to_string(part.levelWidth(level)) + "x" +
                                               std::to_string(part.levelHeight(level))};
    write_level(part, level, levels[0][picture], image, type, counts);
  }
  return Ok{};
}

}  // namespace

Result<Ok> check_exr_compression(const std::string& compression) {
  ENVCONV_CHECK(parse_compression(compression));
  return Ok{};
}

bool exr_compression_is_lossy(const std::string& compression, PixelType type) {
  const std::string name = compression.substr(0, compression.find(':'));
  if (name == "pxr24") return type == PixelType::float32;
  return name == "b44" || name == "b44a" || name == "dwaa" || name == "dwab";
}

void floats_to_halves(const float* from, std::size_t count, std::uint16_t* to) {
  std::int64_t ignored = 0;
  for (std::size_t i = 0; i < count; ++i) to[i] = to_half(from[i], ignored, ignored).bits();
}

Result<Ok> write_exr(OutputFile& file, const std::vector<Picture>& pictures, const WriteOptions& options,
                     WriteReport& report) {
  ENVCONV_TRY(const Compression compression, parse_compression(options.compression));
  const Imf::PixelType type = stored_type(report);
  const std::size_t element = type == Imf::HALF ? 2 : 4;
  try {
    const std::vector<Imf::Header> headers = make_headers(pictures, options, compression, type, false);
    OutputStream stream(file);
    std::unique_ptr<Imf::OutputFile> single;
    std::unique_ptr<Imf::MultiPartOutputFile> multi;
    if (pictures.size() == 1) {
      single = std::make_unique<Imf::OutputFile>(stream, headers[0], Imf::globalThreadCount());
    } else {
      multi = std::make_unique<Imf::MultiPartOutputFile>(stream, headers.data(), static_cast<int>(headers.size()),
                                                         false, Imf::globalThreadCount());
    }
    Counts counts;
    std::vector<char> buffer;
    for (std::size_t i = 0; i < pictures.size(); ++i) {
      const Picture& picture = pictures[i];
      const Image& image = picture.image;
      const auto channels = static_cast<std::size_t>(image.channels());
      const std::size_t row_values = static_cast<std::size_t>(image.width()) * channels;
      std::unique_ptr<Imf::OutputPart> part;
      if (multi) part = std::make_unique<Imf::OutputPart>(*multi, static_cast<int>(i));
      const int band = band_lines(row_values);
      const bool convert = type != Imf::FLOAT;
      if (convert) buffer.assign(row_values * element * static_cast<std::size_t>(std::min(band, image.height())), 0);
      int lines = 0;
      for (int y = 0; y < image.height(); y += band) {
        const int rows = std::min(band, image.height() - y);
        convert_band(image, y, rows, type, convert ? buffer.data() : nullptr, counts);
        const char* base = convert ? buffer.data() : reinterpret_cast<const char*>(image.row(y));
        const Imf::FrameBuffer frame = frame_of(picture, base, y, type, channels, row_values);
        if (single) {
          single->setFrameBuffer(frame);
          single->writePixels(rows);
          lines = single->currentScanLine();
        } else {
          part->setFrameBuffer(frame);
          part->writePixels(rows);
          lines = part->currentScanLine();
        }
      }
      // A codec that failed in another thread may leave no more than this behind.
      if (lines != image.height()) return Error{ErrorCode::output, "OpenEXR did not write all lines"};
    }
    single.reset();
    multi.reset();
    counts.add_to(report);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::limit, "not enough memory to write it"};
  } catch (const std::exception& error) {
    return Error{ErrorCode::output, exr_reason(error)};
  }
  return Ok{};
}

Result<Ok> write_exr_levels(OutputFile& file, std::span<const std::vector<Picture>> levels, const WriteOptions& options,
                            WriteReport& report) {
  ENVCONV_TRY(const Compression compression, parse_compression(options.compression));
  const Imf::PixelType type = stored_type(report);
  const std::vector<Picture>& pictures = levels.front();
  try {
    const std::vector<Imf::Header> headers = make_headers(pictures, options, compression, type, true);
    OutputStream stream(file);
    Counts counts;
    if (pictures.size() == 1) {
      Imf::TiledOutputFile single(stream, headers[0], Imf::globalThreadCount());
      ENVCONV_CHECK(write_part_levels(single, 0, levels, type, counts));
    } else {
      Imf::MultiPartOutputFile multi(stream, headers.data(), static_cast<int>(headers.size()), false,
                                     Imf::globalThreadCount());
      for (std::size_t i = 0; i < pictures.size(); ++i) {
        Imf::TiledOutputPart part(multi, static_cast<int>(i));
        ENVCONV_CHECK(write_part_levels(part, i, levels, type, counts));
      }
    }
    counts.add_to(report);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::limit, "not enough memory to write it"};
  } catch (const std::exception& error) {
    return Error{ErrorCode::output, exr_reason(error)};
  }
  return Ok{};
}

}  // namespace envconv
