// SPDX-License-Identifier: Apache-2.0
// The only file that includes OpenImageIO.  It becomes a module of its own, loaded when a file needs it.
#include "imageio_module.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "bmp_rle.h"
#include "decoder.h"
#include "jpeg_damage.h"
#include "pnm_damage.h"
#include "tiff_bounds.h"

namespace {

using envconv::PixelType;
using envconv::Transfer;
namespace oiio = OIIO;

const std::string kName = "the file";          // in the library's messages
const std::string kFolder = "/proc/self/fd/";  // where open files have names

// The library's text, on one line and without our own name for the file.
void say(char* error, std::size_t size, std::string text) {
  const std::string& prefix = kFolder;
  for (std::size_t at; (at = text.find(prefix)) != std::string::npos;) {
    std::size_t end = at + prefix.size();
    while (end < text.size() && std::isdigit(static_cast<unsigned char>(text[end]))) ++end;
    text.replace(at, end - at, kName);
  }
  const std::size_t line = text.find('\n');
  if (line != std::string::npos) text.resize(line);
  if (text.empty()) text = "the image library gave no reason";
  std::snprintf(error, size, "%s", text.c_str());
}

template <std::size_t N>
void put(char (&to)[N], const std::string& text) {
  std::snprintf(to, N, "%s", text.c_str());
}

struct Type {
  PixelType stored, element;
  oiio::TypeDesc delivered;
};

Type type_of(oiio::TypeDesc format) {
  switch (format.basetype) {
    case oiio::TypeDesc::UINT8: return {PixelType::uint8, PixelType::uint8, oiio::TypeDesc::UINT8};
    case oiio::TypeDesc::UINT16: return {PixelType::uint16, PixelType::uint16, oiio::TypeDesc::UINT16};
    case oiio::TypeDesc::UINT32: return {PixelType::uint32, PixelType::float32, oiio::TypeDesc::FLOAT};
    case oiio::TypeDesc::HALF: return {PixelType::half, PixelType::float32, oiio::TypeDesc::FLOAT};
    case oiio::TypeDesc::FLOAT:
    case oiio::TypeDesc::DOUBLE: return {PixelType::float32, PixelType::float32, oiio::TypeDesc::FLOAT};
    default: return {PixelType::uint16, PixelType::float32, oiio::TypeDesc::FLOAT};  // signed integers
  }
}

// The library's own kind of file, over a descriptor that is open already: it is the file that was recognised, whatever
// its path shows now, it needs no /proc, and it has no extension for the library to believe.  Readers look behind the
// interface (JPEG's takes what is no file for a block of memory), so it must be this kind.
class OpenFile {
 public:
  explicit OpenFile(int fd) {
    const int copy = ::fcntl(fd, F_DUPFD_CLOEXEC, 0);
    if (copy < 0) return;
    ::lseek(copy, 0, SEEK_SET);
    stream_ = ::fdopen(copy, "rb");
    if (!stream_) {
      ::close(copy);
      return;
    }
    proxy_ = std::make_unique<oiio::Filesystem::IOFile>(stream_, oiio::Filesystem::IOProxy::Read);
  }
  ~OpenFile() {
    proxy_.reset();
    if (stream_) std::fclose(stream_);
  }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  oiio::Filesystem::IOProxy* proxy() { return proxy_.get(); }

 private:
  std::FILE* stream_ = nullptr;
  std::unique_ptr<oiio::Filesystem::IOFile> proxy_;
};

struct Input {
  explicit Input(int descriptor) : fd(descriptor), file(descriptor) {}
  int fd;
  OpenFile file;                       // outlives its reader
  std::vector<std::uint8_t> unpacked;  // likewise; what is read instead
  std::unique_ptr<oiio::Filesystem::IOMemReader> memory;
  std::unique_ptr<oiio::ImageInput> in;
  oiio::ImageSpec spec;
  Type type{};
  int level = 0;
};

// Not before a fork: the library makes a thread here and tells it to end, and in a process that is forked before it has
// done so its locks stay locked for ever.
void quiet() {
  static const bool done = [] {
    // The child that decodes is one of many.
    oiio::attribute("threads", 1);
    oiio::attribute("exr_threads", -1);
    oiio::attribute("tiff:half", 1);
    return true;
  }();
  (void)done;
}

void prepare() {
  try {
    (void)oiio::ImageInput::create("png");
    (void)oiio::geterror();
  } catch (...) {
  }
}

int open_file(const char* format, int fd, int level, EnvconvImageioSpec* out, void** handle, char* error,
              std::size_t size) {
  try {
    quiet();
    if (std::string_view(format) == "tiff" && envconv::tiff_fields_cut_off(fd)) {
      say(error, size, "a field lies behind the end of the file");
      return 0;
    }
    auto input = std::make_unique<Input>(fd);
    if (std::string_view(format) == "bmp") {
      auto unpacked = envconv::unpack_bmp(fd);
      if (!unpacked) {
        say(error, size, unpacked.error().message);
        return 0;
      }
      input->unpacked = std::move(*unpacked);
      input->memory = std::make_unique<oiio::Filesystem::IOMemReader>(input->unpacked.data(), input->unpacked.size());
    }
    // By format, never by name: a name would let the library try all its readers.
    input->in = oiio::ImageInput::create(format);
    if (!input->in) {
      say(error, size, oiio::geterror());
      return 0;
    }
    // Two of the readers open names and nothing else.
    std::string name = kName;
    if (!input->unpacked.empty()) {
      input->in->set_ioproxy(input->memory.get());
    } else if (input->in->supports("ioproxy") && input->file.proxy()) {
      input->in->set_ioproxy(input->file.proxy());
    } else {
      name = kFolder + std::to_string(fd);
      if (::access(name.c_str(), R_OK) != 0) {
        say(error, size, "this format can be read only where /proc is mounted");
        return -1;
      }
    }
    oiio::ImageSpec config;
    config.attribute("oiio:UnassociatedAlpha", 1);  // what is stored; association happens in linear light
    config.attribute("oiio:RawColor", 0);
    if (!input->in->open(name, input->spec, config)) {
      say(error, size, input->in->geterror());
      return 0;
    }
    oiio::ImageInput& in = *input->in;
    if (in.has_error()) {
      say(error, size, in.geterror());
      return 0;
    }
    // How many pictures and levels; the answer "no" leaves an error behind.  Formats that hold one are not asked: the
    // WebP reader could not find its way back.
    int levels = 1, pictures = 1;
    const std::string_view kind = format;
    if (kind == "tiff" || kind == "dds" || kind == "psd") {
      if (in.seek_subimage(1, 0)) pictures = 2;
      while (levels < 32 && in.seek_subimage(0, levels)) ++levels;
      input->level = std::clamp(level, 0, levels - 1);
      if (!in.seek_subimage(0, input->level)) {
        say(error, size, in.geterror());
        return 0;
      }
    }
    (void)in.geterror();
    const oiio::ImageSpec& spec = input->spec = in.spec();
    std::memset(static_cast<void*>(out), 0, sizeof *out);
    if (spec.deep || spec.depth > 1) {
      say(error, size, "deep images and volumes are not environment maps");
      return -1;
    }
    input->type = type_of(spec.format);
    out->width = spec.width;
    out->height = spec.height;
    out->channels = spec.nchannels;
    out->alpha = spec.alpha_channel >= 0 && spec.alpha_channel < spec.nchannels ? spec.alpha_channel : -1;
    out->type = static_cast<std::int32_t>(input->type.stored);
    out->element = static_cast<std::int32_t>(input->type.element);
    out->levels = levels;
    out->pictures = pictures;
    for (int c = 0; c < std::min(spec.nchannels, 64); ++c) {
      put(out->names[c], c < static_cast<int>(spec.channelnames.size()) ? spec.channelnames[static_cast<std::size_t>(c)]
                                                                        : "channel" + std::to_string(c));
    }
    if (spec.nchannels <= 2) put(out->names[0], "Y");
    const bool real = input->type.stored == PixelType::float32 || input->type.stored == PixelType::half;
    const std::string space = spec.get_string_attribute("oiio:ColorSpace");
    const float gamma = spec.get_float_attribute("oiio:Gamma", 0.f);
    out->gamma = 1;
    // Some readers name a space that the file does not: JPEG's sRGB, and PNM's the Rec. 709 of its specification.
    out->transfer_told = !real && (gamma > 0 || spec.find_attribute("Exif:ColorSpace") != nullptr);
    put(out->profile, spec.get_string_attribute("ICCProfile:profile_description"));
    if (const oiio::ParamValue* profile = spec.find_attribute("ICCProfile")) {
      out->profile_data = profile->data();
      out->profile_size = profile->type().size();
    }
    if (real || space == "Linear" || space == "linear" || space == "scene_linear") {
      out->transfer = static_cast<std::int32_t>(Transfer::linear);
    } else if (space != "sRGB" && gamma > 0.01f && gamma < 100.f) {
      out->transfer = static_cast<std::int32_t>(gamma == 1 ? Transfer::linear : Transfer::gamma);
      out->gamma = gamma;
    } else {
      out->transfer = static_cast<std::int32_t>(Transfer::srgb);
    }
    // The BMP reader delivers what is stored and does not say that it did.
    out->unassociated = spec.get_int_attribute("oiio:UnassociatedAlpha", 0) != 0 || kind == "bmp";
    out->orientation = std::clamp(spec.get_int_attribute("Orientation", 1), 1, 8);
    put(out->compression, spec.get_string_attribute("compression"));
    for (const char* attribute : {"ImageDescription", "Description", "Comment", "oiio:comment", "Exif:UserComment"}) {
      std::string text = spec.get_string_attribute(attribute);
      if (kind == "targa") {
        // The library cuts it into lines of 81, also in the middle of a word.
        for (std::size_t at = 81; at < text.size() && text[at] == '\n'; at += 81) text.erase(at, 1);
      }
      if (text.find("envconv:") != std::string::npos) {
        put(out->description, text);
        break;
      }
    }
    *handle = input.release();
    return 1;
  } catch (const std::exception& e) {
    say(error, size, e.what());
  } catch (...) {
    say(error, size, "unknown failure");
  }
  return 0;
}

// The TIFF reader forgets errors of whole strips: what was in memory passes for pixels.  Of single rows it reports
// them. Not where planes are apart, whose strips would be unpacked anew for every row.
bool wants_rows(const Input& input) {
  return input.in->format_name() == std::string_view("tiff") && input.spec.tile_width == 0 &&
         input.spec.get_string_attribute("planarconfig") != "separate";
}

bool read_rows(const Input& input, char* pixels) {
  const oiio::ImageSpec& spec = input.spec;
  const std::size_t bytes = static_cast<std::size_t>(spec.width) * static_cast<std::size_t>(spec.nchannels) *
                            envconv::size_of(input.type.element);
  for (int y = 0; y < spec.height; ++y, pixels += bytes) {
    // The level is where open_file() left the reader.  To read several rows, the library would take 64 MB each time.
    if (!input.in->read_scanline(spec.y + y, 0, input.type.delivered, pixels)) return false;
  }
  return true;
}

// What the image library would pass over.
std::string damage_of(const Input& input) {
  const std::string_view format = input.in->format_name();
  return format == "jpeg" ? envconv::damage_of_jpeg(input.fd) : format == "pnm" ? envconv::damage_of_pnm(input.fd) : "";
}

int read_file(void* handle, void* pixels, std::size_t bytes, char* error, std::size_t size) {
  try {
    Input& input = *static_cast<Input*>(handle);
    const oiio::ImageSpec& spec = input.spec;
    const std::size_t need = static_cast<std::size_t>(spec.width) * static_cast<std::size_t>(spec.height) *
                             static_cast<std::size_t>(spec.nchannels) * envconv::size_of(input.type.element);
    if (bytes != need) {
      say(error, size, "the picture changed its size");
      return 0;
    }
    if (const std::string damage = damage_of(input); !damage.empty()) {
      say(error, size, damage);
      return 0;
    }
    const bool read = wants_rows(input)
                          ? read_rows(input, static_cast<char*>(pixels))
                          : input.in->read_image(0, input.level, 0, spec.nchannels, input.type.delivered, pixels);
    // Some readers return success and leave the error for whoever asks.
    std::string text = input.in->geterror();
    const bool closed = input.in->close();
    if (text.empty() && !closed) text = input.in->geterror();
    if (read && closed && text.empty()) return 1;
    say(error, size, text);
  } catch (const std::exception& e) {
    say(error, size, e.what());
  } catch (...) {
    say(error, size, "unknown failure");
  }
  return 0;
}

void close_file(void* handle) {
  try {
    delete static_cast<Input*>(handle);
  } catch (...) {
  }
}

// Hands bytes on.  Everything succeeds, as far as the writer can see.
class Proxy final : public oiio::Filesystem::IOProxy {
 public:
  explicit Proxy(const EnvconvImageioSink& sink) : IOProxy("envconv", Write), sink_(sink) {}
  const char* proxytype() const override { return "envconv"; }
  std::int64_t tell() override { return static_cast<std::int64_t>(sink_.tell(sink_.context)); }
  bool seek(std::int64_t offset) override {
    if (offset < 0) return false;
    sink_.seek(sink_.context, static_cast<std::uint64_t>(offset));
    return true;
  }
  std::size_t read(void* to, std::size_t count) override { return sink_.read(sink_.context, to, count); }
  std::size_t write(const void* from, std::size_t count) override {
    sink_.write(sink_.context, from, count);
    return count;
  }
  std::size_t size() const override { return static_cast<std::size_t>(sink_.size(sink_.context)); }

 private:
  EnvconvImageioSink sink_;
};

int write_file(const char* format, const EnvconvImageioPicture* picture, const EnvconvImageioSink* sink, char* error,
               std::size_t size) {
  try {
    quiet();
    auto out = oiio::ImageOutput::create(format);
    if (!out || !out->supports("ioproxy")) {
      say(error, size, out ? "this format cannot be written safely" : oiio::geterror());
      return 0;
    }
    oiio::TypeDesc type;
    switch (static_cast<PixelType>(picture->element)) {
      case PixelType::uint8: type = oiio::TypeDesc::UINT8; break;
      case PixelType::uint16: type = oiio::TypeDesc::UINT16; break;
      case PixelType::half: type = oiio::TypeDesc::HALF; break;
      default: type = oiio::TypeDesc::FLOAT; break;
    }
    oiio::ImageSpec spec(static_cast<int>(picture->width), static_cast<int>(picture->height), picture->channels, type);
    spec.channelnames.clear();
    for (int c = 0; c < picture->channels; ++c) spec.channelnames.emplace_back(picture->names[c]);
    spec.alpha_channel = picture->alpha;
    // Without a date, writers take the present one.
    spec.attribute("DateTime", "1970:01:01 00:00:00");
    const bool real = type == oiio::TypeDesc::FLOAT || type == oiio::TypeDesc::HALF;
    if (*picture->curve) spec.attribute("oiio:ColorSpace", picture->curve);
    if (!real && picture->alpha >= 0) spec.attribute("oiio:UnassociatedAlpha", 1);
    if (*picture->compression) spec.attribute("Compression", picture->compression);
    if (*picture->description) spec.attribute(picture->attribute, picture->description);
    Proxy proxy(*sink);
    out->set_ioproxy(&proxy);
    const bool good = out->open("envconv", spec) && out->write_image(type, picture->pixels) && out->close();
    const std::string text = out->geterror();
    if (good && out->close()) return 1;
    say(error, size, text);
  } catch (const std::exception& e) {
    say(error, size, e.what());
  } catch (...) {
    say(error, size, "unknown failure");
  }
  return 0;
}

}  // namespace

extern "C" __attribute__((visibility("default"))) const EnvconvImageio envconv_imageio = {
    kEnvconvImageioAbi, OIIO_VERSION_STRING, prepare, open_file, read_file, close_file, write_file};
