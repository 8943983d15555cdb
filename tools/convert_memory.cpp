// SPDX-License-Identifier: Apache-2.0
// What a conversion will take of memory, told from the header alone.
#include <algorithm>
#include <string_view>
#include <thread>

#include "convert.h"
#include "text.h"

namespace envconv::tool {
namespace {

// What a stored value takes while it is decoded or encoded.
std::size_t bytes_of(PixelType type) {
  return type == PixelType::uint8 ? 1 : type == PixelType::half || type == PixelType::uint16 ? 2 : 4;
}

// The process itself, its threads and the buffers of codecs.
std::size_t overhead(int threads) {
  const unsigned n = threads > 0 ? static_cast<unsigned>(threads) : std::max(1u, std::thread::hardware_concurrency());
  return (std::size_t{10} << 20) + n * (std::size_t{2} << 20);
}

// The image library and the 260 others that it brings along, once it is loaded for writing (measured: a picture of one
// texel as PNG, TIFF or JPEG against OpenEXR).
constexpr std::size_t image_library = std::size_t{116} << 20;

}  // namespace

std::size_t predicted_peak(const ConvertPlan& plan, const Job& job, const Shape& shape, const PictureFile& file) {
  const ConvertOptions& o = plan.options;
  const Picture& first = file.pictures.front();
  // OpenEXR's and Radiance's values arrive as floats; others are decoded first, and then made linear.
  const bool floats = file.format == "openexr" || file.format == "hdr";
  const std::size_t source = shape.source_bytes, result = shape.result_bytes;
  const std::size_t decoded =
      floats ? (o.input.read.drop_alpha ? source * 4 / 3 : 0) : source / 4 * bytes_of(first.type);
  // One picture with several faces is taken apart.
  const bool apart = shape.source.layout->face_count() > 1 && file.pictures.size() == 1;
  const std::size_t reading = source + std::max(decoded, apart ? source : 0);

  EnvImage image;
  image.layout = shape.source.layout;
  image.placement = image.layout->info().placement;
  image.consumer_from_world = shape.source.frame->consumer_from_world;
  image.channels = first.channels;
  for (int face = 0; face < image.layout->face_count(); ++face) {
    const Size size = face_size(*image.layout, face, shape.source.height);
    image.faces.push_back(Image::without_pixels(size.width, size.height, shape.channels));
  }
  ResampleOptions options;
  options.layout = o.layout;
  options.height = shape.height;
  options.placement = placement_for(*o.layout, o.levels.seam);
  options.consumer_from_world = o.frame->consumer_from_world;
  options.rotation = o.rotation;
  options.filter = o.filter;
  const std::size_t resampling = source + resample_bytes(image, options);

  const bool packed = shape.faces.size() > 1 && o.packing->name != "files" && o.packing->name != "parts";
  // While names are made there is no path yet, and nobody asks for the writing.
  const std::string_view path = job.paths.empty() ? ".exr" : std::string_view(job.paths.front());
  const bool streamed = path.ends_with(".exr") || path.ends_with(".hdr") || path.ends_with(".pfm");
  const std::size_t picture = o.packing->name == "files" ? result / shape.faces.size() : result;  // one at a time
  const std::size_t encoded = picture / 4 * bytes_of(o.write.type_given ? o.write.type : first.type);
  std::size_t writing = result + (streamed ? 0 : encoded + image_library);
  if (o.write.verify) writing += result + result / 2;  // as floats, and as they are stored
  if (packed) writing = std::max(writing, 2 * result);
  writing += level_bytes(o.levels, level_place(plan, job), shape.height, shape.channels);
  return overhead(o.threads) + std::max({reading, resampling, writing});
}

Result<Ok> check_memory(const ConvertPlan& plan, const Job& job, const Shape& shape) {
  const auto allowed = static_cast<std::size_t>(plan.options.memory);
  if (shape.peak_memory <= allowed) return Ok{};
  return Error{ErrorCode::limit, job.input.name + ": needs about " + megabytes(shape.peak_memory) + " of memory, and " +
                                     megabytes(allowed) +
                                     " are allowed (--memory allows more, a smaller --size needs less)"};
}

}  // namespace envconv::tool
