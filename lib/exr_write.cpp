// SPDX-License-Identifier: Apache-2.0
// Writing OpenEXR files: scan lines, parts, and tiles with MIP levels.
#include <IexErrnoExc.h>
#include <ImfChannelList.h>
#include <ImfEnvmap.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <ImfStringAttribute.h>
#include <ImfThreading.h>
#include <ImfTiledOutputFile.h>
#include <ImfTiledOutputPart.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <memory>
#include <optional>
#include <set>
#include <span>

#include "exr.h"
#include "exr_chunk_writer.h"
#include "exr_chunks.h"
#include "exr_output.h"
#include "io_shared.h"

namespace envconv {
namespace {

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
  const bool zip = is_zip(result.value);
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

// Lines that are converted and written at a time: a multiple of every codec's block of lines and of a tile's side, and
// enough of them to keep all threads busy.
int band_lines(std::size_t row_values) {
  return std::max(256, static_cast<int>(std::min<std::size_t>(4096, (std::size_t{1} << 22) / row_values))) / 256 * 256;
}

// Hands out an image to OpenEXR in bands of lines, by a function of a frame that is good for lines from the first on,
// that line and their number.
template <class WriteBand>
void write_bands(const Picture& names, const Image& image, Imf::PixelType type, ExrCounts& counts,
                 WriteBand&& write_band) {
  const auto channels = static_cast<std::size_t>(image.channels());
  const std::size_t row_values = static_cast<std::size_t>(image.width()) * channels, element = size_of(type);
  const std::size_t x_stride = channels * element, y_stride = row_values * element;
  const bool convert = type != Imf::FLOAT;
  const int band = band_lines(row_values);
  std::vector<char> buffer(convert ? y_stride * static_cast<std::size_t>(std::min(band, image.height())) : 0);
  for (int y = 0; y < image.height(); y += band) {
    const int rows = std::min(band, image.height() - y);
    tbb::parallel_for(0, rows, [&](int row) {
      char* to = convert ? buffer.data() + static_cast<std::size_t>(row) * y_stride : nullptr;
      convert_values(image.row(y + row), row_values, type, to, counts);
    });
    const char* base = convert ? buffer.data() : reinterpret_cast<const char*>(image.row(y));
    Imf::FrameBuffer frame;
    for (std::size_t c = 0; c < channels; ++c) {
      // OpenEXR counts from line 0.
      const std::uintptr_t origin =
          reinterpret_cast<std::uintptr_t>(base) + c * element - static_cast<std::uintptr_t>(y) * y_stride;
      frame.insert(names.channels.names[c], Imf::Slice(type, reinterpret_cast<char*>(origin), x_stride, y_stride));
    }
    write_band(frame, y, rows);
  }
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
    // That of ZIP is ours to know.
    if (compression.has_level && !is_zip(compression.value)) header.dwaCompressionLevel() = compression.level;
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

// All levels of one picture, by a function of a level's number and image.  OpenEXR's chain goes on until the packed
// image is one texel, which is further than a chain of faces beside each other goes: what remains are means of the last
// level.
template <class WriteLevel>
Result<Ok> write_levels_of(const Imf::Header& header, std::size_t picture, std::span<const std::vector<Picture>> levels,
                           WriteLevel&& write_level) {
  const Image& largest = levels[0][picture].image;
  const int count =
      header.hasTileDescription() ? level_count(header.tileDescription(), largest.width(), largest.height()) : 1;
  Image tail;
  for (int level = 0; level < count; ++level) {
    const auto k = static_cast<std::size_t>(level);
    const bool given = k < levels.size();
    if (!given) tail = halved(tail.empty() ? levels.back()[picture].image : tail);
    const Image& image = given ? levels[k][picture].image : tail;
    const std::int64_t width = reduced(largest.width(), level, Imf::ROUND_DOWN);
    const std::int64_t height = reduced(largest.height(), level, Imf::ROUND_DOWN);
    if (image.width() != width || image.height() != height)
      return Error{ErrorCode::unsupported, "level " + std::to_string(level) + " is " + std::to_string(image.width()) +
                                               "x" + std::to_string(image.height()) + ", where OpenEXR wants " +
                                               std::to_string(width) + "x" + std::to_string(height)};
    write_level(level, image);
  }
  return Ok{};
}

// A tiled file, or a tiled part of one, whose pixels OpenEXR packs.
template <class Part>
void write_tiles(Part& part, int level, const Picture& names, const Image& image, Imf::PixelType type,
                 ExrCounts& counts) {
  constexpr int side = static_cast<int>(tile_side);
  write_bands(names, image, type, counts, [&](const Imf::FrameBuffer& frame, int y, int rows) {
    part.setFrameBuffer(frame);
    part.writeTiles(0, part.numXTiles(level) - 1, y / side, (y + rows - 1) / side, level);
  });
}

// The same of scan lines.
template <class Part>
Result<Ok> write_lines(Part& part, const Picture& picture, Imf::PixelType type, ExrCounts& counts) {
  write_bands(picture, picture.image, type, counts, [&](const Imf::FrameBuffer& frame, int, int rows) {
    part.setFrameBuffer(frame);
    part.writePixels(rows);
  });
  // A codec that failed in another thread may leave no more than this behind.
  if (part.currentScanLine() != picture.image.height())
    return Error{ErrorCode::output, "OpenEXR did not write all lines"};
  return Ok{};
}

// Files whose chunks are packed here.
Result<Ok> write_chunks(OutputFile& file, const std::vector<Imf::Header>& headers,
                        std::span<const std::vector<Picture>> levels, const Compression& compression,
                        Imf::PixelType type, ExrCounts& counts) {
  ChunkWriter writer(file, headers,
                     compression.has_level ? static_cast<int>(compression.level) : ChunkWriter::usual_level);
  for (std::size_t i = 0; i < headers.size(); ++i) {
    ENVCONV_CHECK(write_levels_of(headers[i], i, levels, [&](int level, const Image& image) {
      writer.write(i, level, image, levels[0][i].channels.names, type, counts);
    }));
  }
  writer.finish();
  return Ok{};
}

// Files whose chunks OpenEXR packs, of one part.
Result<Ok> write_single(Imf::OStream& stream, const Imf::Header& header, std::span<const std::vector<Picture>> levels,
                        Imf::PixelType type, ExrCounts& counts) {
  const Picture& picture = levels[0][0];
  if (!header.hasTileDescription()) {
    Imf::OutputFile lines(stream, header, Imf::globalThreadCount());
    return write_lines(lines, picture, type, counts);
  }
  Imf::TiledOutputFile tiles(stream, header, Imf::globalThreadCount());
  return write_levels_of(header, 0, levels, [&](int level, const Image& image) {
    write_tiles(tiles, level, picture, image, type, counts);
  });
}

// The same of several parts.
Result<Ok> write_parts(Imf::OStream& stream, const std::vector<Imf::Header>& headers,
                       std::span<const std::vector<Picture>> levels, Imf::PixelType type, ExrCounts& counts) {
  Imf::MultiPartOutputFile file(stream, headers.data(), static_cast<int>(headers.size()), false,
                                Imf::globalThreadCount());
  for (std::size_t i = 0; i < headers.size(); ++i) {
    const Picture& picture = levels[0][i];
    if (!headers[i].hasTileDescription()) {
      Imf::OutputPart lines(file, static_cast<int>(i));
      ENVCONV_CHECK(write_lines(lines, picture, type, counts));
      continue;
    }
    Imf::TiledOutputPart tiles(file, static_cast<int>(i));
    ENVCONV_CHECK(write_levels_of(headers[i], i, levels, [&](int level, const Image& image) {
      write_tiles(tiles, level, picture, image, type, counts);
    }));
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

Result<Ok> write_exr(OutputFile& file, std::span<const std::vector<Picture>> levels, const WriteOptions& options,
                     WriteReport& report) {
  ENVCONV_TRY(const Compression compression, parse_compression(options.compression));
  const Imf::PixelType type = stored_type(report);
  try {
    const std::vector<Imf::Header> headers =
        make_headers(levels.front(), options, compression, type, levels.size() > 1);
    ExrCounts counts;
    if (chunks_are_ours(compression.value)) {
      ENVCONV_CHECK(write_chunks(file, headers, levels, compression, type, counts));
    } else {
      std::size_t values = 0;
      for (const Picture& picture : levels.front()) values += picture.image.value_count();
      if (values > (1u << 18)) set_exr_pool_threads(thread_count(options.threads));
      ExrOutput stream(file);
      ENVCONV_CHECK(headers.size() == 1 ? write_single(stream, headers[0], levels, type, counts)
                                        : write_parts(stream, headers, levels, type, counts));
    }
    counts.add_to(report);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::limit, "not enough memory to write it"};
  } catch (const Iex::EnomemExc&) {  // OpenEXR's word for what a stream in memory lacked, which swallows bad_alloc
    return Error{ErrorCode::limit, "not enough memory to write it"};
  } catch (const std::exception& error) {
    return exr_failure(ErrorCode::output, "", error);
  }
  return Ok{};
}

}  // namespace envconv
