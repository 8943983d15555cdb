// SPDX-License-Identifier: Apache-2.0
#include "imageio_write.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <new>
#include <string_view>

#include "exr.h"
#include "imageio_loader.h"
#include "io_shared.h"
#include "png_color.h"
#include "row_kernels.h"
#include "tiff_chain.h"

namespace envconv {
namespace {

constexpr int tile_side = 64;  // of levels

// The image library's word for the curve, or "".  PNG's chunks are ours, and TIFF would need an Exif directory for it,
// for which the library reads what it wrote, and not from a proxy: the file comes out broken and it says nothing.
std::string curve_for_imageio(std::string_view format, const ColorEncoding& color) {
  if (format == "png" || format == "tiff") return {};
  if (color.transfer == Transfer::linear) return "Linear";
  return color.transfer == Transfer::srgb ? "sRGB" : "";
}

// Where the image library's bytes go: to the file from `base` on; `insert` comes between the end of a PNG's header and
// the rest.
struct Sink {
  OutputFile& file;
  std::uint64_t base;
  std::string insert;

  void write(const void* data, std::size_t size) {
    const auto* bytes = static_cast<const char*>(data);
    const std::uint64_t at = file.tell();
    if (!insert.empty() && at <= kPngHeaderEnd && at + size >= kPngHeaderEnd) {
      const auto head = static_cast<std::size_t>(kPngHeaderEnd - at);
      file.write(bytes, head);
      file.write(insert.data(), insert.size());
      insert.clear();
      bytes += head;
      size -= head;
    }
    if (size > 0) file.write(bytes, size);
  }
};

EnvconvImageioSink sink_of(Sink& target) {
  EnvconvImageioSink sink{};
  sink.context = &target;
  sink.write = [](void* s, const void* data, std::size_t size) { static_cast<Sink*>(s)->write(data, size); };
  sink.read = [](void* s, void* data, std::size_t size) { return static_cast<Sink*>(s)->file.read(data, size); };
  sink.seek = [](void* s, std::uint64_t position) {
    auto* sink = static_cast<Sink*>(s);
    sink->file.seek(sink->base + position);
  };
  sink.tell = [](void* s) { return static_cast<Sink*>(s)->file.tell() - static_cast<Sink*>(s)->base; };
  sink.size = [](void* s) { return static_cast<Sink*>(s)->file.size() - static_cast<Sink*>(s)->base; };
  return sink;
}

// Values as they will be stored; null: floats, as the image has them.
std::unique_ptr<void, FreeBytes> stored_elements(const Picture& picture, const WriteOptions& options,
                                                 WriteReport& report) {
  const Image& image = picture.image;
  if (is_integer(report.type)) return to_elements(picture, report.type, options.encoding, report);
  HalfCounts odd;
  std::unique_ptr<void, FreeBytes> elements;
  if (report.type == PixelType::half) {
    // The library converts to half itself, without a word about what does not fit.
    elements.reset(std::malloc(image.value_count() * 2));
    if (!elements) throw std::bad_alloc();
    floats_to_halves(image.data(), image.value_count(), static_cast<std::uint16_t*>(elements.get()), odd);
  } else {
    odd.nonfinite =
        std::count_if(image.data(), image.data() + image.value_count(), [](float v) { return !std::isfinite(v); });
  }
  report.nonfinite += odd.nonfinite;
  report.clamped_high += odd.high;
  return elements;
}

// One picture, from `base` of the file on; `tile`: the side of its tiles, 0 for lines.
Result<Ok> write_picture(OutputFile& file, std::uint64_t base, const Picture& picture, int tile,
                         const ImageioFormat& format, const WriteOptions& options, WriteReport& report) {
  ENVCONV_TRY(const EnvconvImageio* module, load_imageio());
  const Image& image = picture.image;
  const auto elements = stored_elements(picture, options, report);
  std::vector<const char*> names;
  for (const std::string& name : picture.channels.names) names.push_back(name.c_str());
  const std::string description = *format.attribute ? join_metadata(options.metadata) : "";
  const ColorEncoding color = stored_color(options, report.type);
  const std::string curve = curve_for_imageio(format.name, color);
  EnvconvImageioPicture out{};
  out.width = image.width();
  out.height = image.height();
  out.channels = image.channels();
  out.alpha = picture.channels.alpha;
  out.element = static_cast<std::int32_t>(report.type);
  out.tile = tile;
  out.names = names.data();
  out.pixels = elements ? elements.get() : image.data();
  out.compression = format.compression.c_str();
  out.description = description.c_str();
  out.curve = curve.c_str();
  out.attribute = format.attribute;
  Sink target{file, base, std::string_view(format.name) == "png" ? png_color_chunks(color) : ""};
  const EnvconvImageioSink sink = sink_of(target);
  file.seek(base);
  char error[1024] = "";
  if (!module->write(format.name, &out, &sink, error, sizeof error)) return Error{ErrorCode::output, error};
  return Ok{};
}

}  // namespace

Result<Ok> write_imageio(OutputFile& file, std::span<const std::vector<Picture>> levels, const ImageioFormat& format,
                         const WriteOptions& options, WriteReport& report) {
  if (!*format.attribute && !join_metadata(options.metadata).empty()) {
    report.warnings.push_back(std::string("the format ") + format.extension +
                              " holds no metadata: the layout is not recorded");
  }
  if (levels.size() == 1) return write_picture(file, 0, levels.front().front(), 0, format, options, report);
  // The library appends a directory by reading the file that it writes, which from a proxy it cannot: each level is a
  // file to it.
  TiffChain chain(file);
  for (const std::vector<Picture>& level : levels) {
    ENVCONV_CHECK(write_picture(file, chain.begin(), level.front(), tile_side, format, options, report));
    ENVCONV_CHECK(chain.end());
  }
  return chain.finish();
}

}  // namespace envconv
