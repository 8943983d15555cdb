// SPDX-License-Identifier: Apache-2.0
// What a conversion will take of memory, told from the header alone, and where its images go.
#include <algorithm>
#include <cstdlib>
#include <string_view>
#include <thread>
#include <vector>

#include "convert.h"
#include "memory.h"
#include "scratch.h"
#include "text.h"

namespace envconv::tool {
namespace {

constexpr std::size_t MiB = std::size_t{1} << 20;
constexpr std::size_t huge_page = 2 * MiB;  // of which large images take whole ones

// What a stored value takes while it is decoded or encoded.
std::size_t bytes_of(PixelType type) {
  return type == PixelType::uint8 ? 1 : type == PixelType::half || type == PixelType::uint16 ? 2 : 4;
}

// Of one conversion: no more than there are cores.
std::size_t thread_count(int asked) {
  const std::size_t cores = std::max(1u, std::thread::hardware_concurrency());
  return asked > 0 ? std::min(static_cast<std::size_t>(asked), cores) : cores;
}

// The process itself and its threads (measured: a panorama of 64x32 texels, nearest, on 1 to 4 threads).
std::size_t overhead(int threads) { return 13 * MiB + thread_count(threads) * MiB / 2; }

// The image library and the 260 others that it brings along, once it is loaded (measured: a picture of one texel as
// JPEG against OpenEXR).
constexpr std::size_t image_library = 116 * MiB;

// Of scratch storage: what must be left for pages of images to be worked on, and the part of the memory allowed that
// is left free for what is touched before the next look.
constexpr std::size_t least_room = 24 * MiB;
std::size_t margin_of(std::size_t allowed) { return std::clamp(allowed / 8, 8 * MiB, 256 * MiB); }

// Bytes that are held at one time.
struct Stage {
  std::size_t images = 0;   // pixels, which can be kept in scratch storage
  std::size_t working = 0;  // all else
  std::size_t decoder = 0;  // in the process that decodes
};

// Reading, resampling, making levels, writing and reading back, one after the other.
class Stages {
 public:
  /// `in_files`: images lie in files, which take their whole room from beginning to end.
  Stages(const ConvertPlan& plan, const Job& job, const Shape& shape, const PictureFile& file, bool in_files)
      : plan_(plan), o_(plan.options), job_(job), shape_(shape), file_(file), in_files_(in_files) {}

  std::vector<Stage> all() const { return {reading(), resampling(), making_levels(), writing(), verifying()}; }

 private:
  // Some megabytes of rows arrive at a time, by way of a window that both processes see and in which two bands have
  // room; what is not float and linear already, by way of a band in this one.  What is decoded whole, into memory: the
  // decoder's memory becomes the image's, or is made linear and given back some megabytes at a time.
  Stage reading() const {
    Stage stage;
    const Picture& first = file_.pictures.front();
    const bool streamed = file_.format == "openexr" || file_.format == "hdr";
    const bool direct = streamed && !o_.input.read.drop_alpha;
    std::size_t decoded = streamed ? shape_.source_bytes : shape_.source_bytes / 4 * bytes_of(first.type);
    if (o_.input.read.drop_alpha) decoded = decoded / 3 * 4;
    const std::size_t row = static_cast<std::size_t>(first.image.width()) * static_cast<std::size_t>(shape_.channels) *
                            (streamed ? sizeof(float) : bytes_of(first.type));
    const std::size_t lines = 32 * row * (file_.format == "openexr" ? thread_count(o_.threads) : 1);
    const std::size_t band = std::min(decoded, std::max(4 * MiB, std::min(lines, 64 * MiB)) + 32 * row);
    const bool in_bands = streamed && decoded > band;
    stage.working = MiB + (direct ? 0 : band) + (in_bands ? 2 * band + huge_page : 0);
    // Many formats are decoded whole, and some codecs hold a copy; in this process when the input is trusted.
    const std::size_t codec = streamed ? codec_buffers() : decoded + image_library;
    stage.decoder = codec + (in_bands ? 2 * band : decoded);
    if (o_.input.read.trust_input) {
      stage.working += codec;
      // What was decoded has gone by when there is as much of the image.
      if (!direct && !in_bands) stage.working += in_files_ ? decoded : decoded - std::min(decoded, shape_.source_bytes);
      stage.decoder = 0;
    }
    // One picture with several faces is taken apart, and given back on the way; in files it holds its place.
    const bool apart = shape_.source.layout->face_count() > 1 && file_.pictures.size() == 1;
    stage.images = shape_.source_bytes;
    if (apart) stage.images += std::min(shape_.source_bytes, in_files_ ? shape_.source_bytes : 4 * MiB);
    return stage;
  }

  Stage resampling() const {
    const Picture& first = file_.pictures.front();
    EnvImage image;
    image.layout = shape_.source.layout;
    image.placement = image.layout->info().placement;
    image.consumer_from_world = shape_.source.frame->consumer_from_world;
    image.channels = first.channels;
    for (int face = 0; face < image.layout->face_count(); ++face) {
      const Size size = face_size(*image.layout, face, shape_.source.height);
      image.faces.push_back(Image::without_pixels(size.width, size.height, shape_.channels));
    }
    ResampleOptions options;
    options.layout = o_.layout;
    options.height = shape_.height;
    options.placement = placement_for(*o_.layout, o_.levels.seam);
    options.consumer_from_world = o_.frame->consumer_from_world;
    options.rotation = o_.rotation;
    options.filter = o_.filter;
    options.threads = o_.threads;
    const std::size_t bytes = resample_bytes(image, options, true);
    // What was beside the faces in one image is gone.
    const std::size_t source = image.texel_count() * static_cast<std::size_t>(shape_.channels) * sizeof(float);
    if (bytes == 0) return {source, 0, 0};
    // A copy with four channels, where texels cannot be read in place.
    const bool in_place = shape_.channels == 3 || shape_.channels == 4;
    const std::size_t copy = in_place ? 0 : image.texel_count() * 4 * sizeof(float);
    const std::size_t images = shape_.result_bytes + copy;
    return {source + images, bytes - std::min(bytes, images), 0};
  }

  Stage making_levels() const {
    const LevelBytes bytes = level_bytes(o_.levels, level_place(plan_, job_), shape_.height, shape_.channels);
    return {shape_.result_bytes + bytes.images + bytes.seams, bytes.working, 0};
  }

  // Of those that unpack an EXR file's chunks.
  std::size_t codec_buffers() const { return 4 * MiB * thread_count(o_.threads); }

  // Written and read back without a copy of the picture as it is stored.
  static bool is_streamed(std::string_view path) {
    return path.ends_with(".exr") || path.ends_with(".hdr") || path.ends_with(".pfm");
  }

  // Of what writes it: the image library, or buffers for PNG and TIFF, one more than there are threads, and for JPEG.
  std::size_t encoder(std::string_view path, std::size_t encoded) const {
    const bool ours = path.ends_with(".png") || path.ends_with(".tif") || path.ends_with(".tiff") ||
                      path.ends_with(".jpg") || path.ends_with(".jpeg");
    return ours ? std::min(2 * encoded, (1 + thread_count(o_.threads)) * 4 * MiB) : image_library;
  }

  Stage writing() const {
    Stage stage;
    const LevelBytes levels = level_bytes(o_.levels, level_place(plan_, job_), shape_.height, shape_.channels);
    const std::size_t result = shape_.result_bytes + levels.images;
    stage.images = result + levels.gutters + packing(levels);
    // While names are made there is no path yet, and nobody asks for the writing.
    if (job_.paths.empty()) return stage;
    const std::string_view path = job_.paths.front();
    const bool texture = holds_faces(std::string(path));
    const PixelType type = write_options(plan_, job_, shape_, {}, file_.pictures.front().type).type;
    const std::size_t encoded = shape_.result_bytes / 4 * bytes_of(type);
    if (is_streamed(path)) {
      stage.working = path.ends_with(".exr") ? std::min(encoded, exr_buffers(bytes_of(type))) : 0;
    } else if (texture) {
      // A face at a time; for zlib all of level 0, and the room that it could need.
      stage.working = encoded / static_cast<std::size_t>(pictures_of(plan_));
      const std::string_view compression = o_.write.compression;
      if (compression.find("zlib") != compression.npos) stage.working += 2 * encoded;
      if (compression.find("zstd") != compression.npos) {
        stage.working += std::min(encoded, (1 + thread_count(o_.threads)) * 8 * MiB);
      }
    } else {
      // Floats are the image's own.
      const std::size_t elements = type == PixelType::float32 ? 0 : encoded;
      stage.working =
          encoder(path, encoded) + (o_.packing->name == "files" ? elements / shape_.faces.size() : elements);
    }
    return stage;
  }

  // All that was written, and a level of it as it is read back.
  Stage verifying() const {
    if (!o_.write.verify || job_.paths.empty()) return {};
    const LevelBytes levels = level_bytes(o_.levels, level_place(plan_, job_), shape_.height, shape_.channels);
    const std::size_t written = std::max(packed_bytes(), shape_.result_bytes + levels.gutters);
    Stage stage{levels.images + 2 * written, MiB + codec_buffers(), 0};
    const std::string_view path = job_.paths.front();
    const PixelType type = write_options(plan_, job_, shape_, {}, file_.pictures.front().type).type;
    const std::size_t encoded = shape_.result_bytes / 4 * bytes_of(type);
    if (holds_faces(std::string(path))) {
      // What is not read in bands: a face, or all that was compressed together.
      const bool apart = o_.write.compression.empty();
      stage.working += apart ? encoded / static_cast<std::size_t>(pictures_of(plan_)) : encoded + 16 * MiB;
    } else if (!is_streamed(path)) {
      stage.working += encoder(path, encoded) + std::min(encoded, 16 * MiB);
      stage.decoder = image_library + 2 * encoded;
    }
    return stage;
  }

  // An EXR file's chunks are packed here, one more at a time than there are threads, each of at most 16 lines and in
  // four buffers; or OpenEXR gets bands of some megabytes.
  std::size_t exr_buffers(std::size_t element) const {
    int width = 0;
    for (const Size& face : shape_.faces) width = std::max(width, face.width);
    if (const Result<PackedShape> packed = packed_shape(*o_.layout, *o_.packing, shape_.height)) {
      width = std::max(width, packed->size.width);
    }
    const std::size_t chunk =
        16 * static_cast<std::size_t>(width) * static_cast<std::size_t>(shape_.channels) * element;
    return std::max(8 * MiB, 4 * chunk * (thread_count(o_.threads) + 1));
  }

  // Of the image that faces go into; 0: there is none.
  std::size_t packed_bytes() const {
    if (shape_.faces.size() == 1 || o_.packing->name == "files" || o_.packing->name == "parts") return 0;
    const Result<PackedShape> packed = packed_shape(*o_.layout, *o_.packing, shape_.height);
    if (!packed) return shape_.result_bytes;
    return static_cast<std::size_t>(packed->size.width) * static_cast<std::size_t>(packed->size.height) *
           static_cast<std::size_t>(shape_.channels) * sizeof(float);
  }

  // Faces go into one image, and are given back on the way; but where the image has places without a face, its pixels
  // are all there at once.
  std::size_t packing(const LevelBytes& levels) const {
    const std::size_t all = packed_bytes(), one = shape_.result_bytes + levels.gutters;
    if (all == 0) return 0;
    return in_files_ || all > shape_.result_bytes ? std::max(all, one) : std::min(one, 4 * MiB * shape_.faces.size());
  }

  const ConvertPlan& plan_;
  const ConvertOptions& o_;
  const Job& job_;
  const Shape& shape_;
  const PictureFile& file_;
  const bool in_files_;
};

// A folder on a disk: the output's own, or where that one lies in memory another.
std::string scratch_folder(const Job& job) {
  const char* told = std::getenv("TMPDIR");
  for (const std::string& folder : {folder_of(job.output), std::string(told ? told : ""), std::string("/var/tmp")}) {
    if (!folder.empty() && !Scratch::lies_in_memory(folder)) return folder;
  }
  return "";
}

}  // namespace

MemoryPlan plan_memory(const ConvertPlan& plan, const Job& job, const Shape& shape, const PictureFile& file) {
  MemoryPlan memory;
  std::size_t working = 0, decoder = 0, mapped = 0, in_files = 0;
  for (const Stage& stage : Stages(plan, job, shape, file, false).all()) {
    memory.peak = std::max(memory.peak, stage.images + stage.working);
    working = std::max(working, stage.working);
    decoder = std::max(decoder, stage.decoder);
  }
  for (const Stage& stage : Stages(plan, job, shape, file, true).all()) {
    mapped = std::max(mapped, stage.images + stage.working);
    in_files = std::max(in_files, stage.images);
  }
  const std::size_t always = overhead(plan.options.threads), allowed = static_cast<std::size_t>(plan.options.memory);
  memory.peak += always;
  mapped += always;
  memory.needed = memory.peak;
  // A limit on the address space counts what is mapped, wherever it lies.
  if (mapped > available_address_space() / 4 * 3) {
    memory.needed = mapped;
    return memory;
  }
  if (memory.peak <= allowed) return memory;
  const std::string folder = scratch_folder(job);
  if (folder.empty()) return memory;
  const std::size_t least = always + working + decoder + least_room;
  memory.needed = std::min(memory.needed, least + margin_of(least + margin_of(least)));
  if (memory.needed > allowed) return memory;
  memory.scratch = in_files;
  memory.folder = folder;
  memory.resident = allowed - margin_of(allowed) - decoder;
  memory.peak = allowed - decoder;
  return memory;
}

Result<Ok> check_memory(const ConvertPlan& plan, const Job& job, const Shape& shape) {
  const auto allowed = static_cast<std::size_t>(plan.options.memory);
  if (shape.memory.needed <= allowed) return Ok{};
  return Error{ErrorCode::limit, job.input.name + ": needs about " + megabytes(shape.memory.needed) +
                                     " of memory, and " + megabytes(allowed) +
                                     " are allowed (--memory allows more, a smaller --size needs less)"};
}

}  // namespace envconv::tool
