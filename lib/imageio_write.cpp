// SPDX-License-Identifier: Apache-2.0
#include "imageio_write.h"

#include <vector>

#include "imageio_loader.h"
#include "stored_pixels.h"

namespace envconv {
namespace {

// The image library's word for the curve, or "".
std::string curve_for_imageio(const ColorEncoding& color) {
  if (color.transfer == Transfer::linear) return "Linear";
  return color.transfer == Transfer::srgb ? "sRGB" : "";
}

EnvconvImageioSink sink_of(OutputFile& file) {
  EnvconvImageioSink sink{};
  sink.context = &file;
  sink.write = [](void* f, const void* data, std::size_t size) { static_cast<OutputFile*>(f)->write(data, size); };
  sink.read = [](void* f, void* data, std::size_t size) { return static_cast<OutputFile*>(f)->read(data, size); };
  sink.seek = [](void* f, std::uint64_t position) { static_cast<OutputFile*>(f)->seek(position); };
  sink.tell = [](void* f) { return static_cast<OutputFile*>(f)->tell(); };
  sink.size = [](void* f) { return static_cast<OutputFile*>(f)->size(); };
  return sink;
}

}  // namespace

Result<Ok> write_imageio(OutputFile& file, const Picture& picture, const ImageioFormat& format,
                         const WriteOptions& options, WriteReport& report) {
  if (!*format.attribute && !join_metadata(options.metadata).empty()) {
    report.warnings.push_back(std::string("the format ") + format.extension +
                              " holds no metadata: the layout is not recorded");
  }
  ENVCONV_TRY(const EnvconvImageio* module, load_imageio());
  const StoredPixels pixels = stored_pixels(picture, options, report);
  std::vector<const char*> names;
  for (const std::string& name : picture.channels.names) names.push_back(name.c_str());
  const std::string description = *format.attribute ? join_metadata(options.metadata) : "";
  const std::string curve = curve_for_imageio(stored_color(options, report.type));
  EnvconvImageioPicture out{};
  out.width = pixels.width;
  out.height = pixels.height;
  out.channels = pixels.channels;
  out.alpha = pixels.alpha;
  out.element = static_cast<std::int32_t>(pixels.type);
  out.names = names.data();
  out.pixels = pixels.data;
  out.compression = format.compression.c_str();
  out.description = description.c_str();
  out.curve = curve.c_str();
  out.attribute = format.attribute;
  const EnvconvImageioSink sink = sink_of(file);
  char error[1024] = "";
  if (!module->write(format.name, &out, &sink, error, sizeof error)) return Error{ErrorCode::output, error};
  return Ok{};
}

}  // namespace envconv
