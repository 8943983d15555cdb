// SPDX-License-Identifier: Apache-2.0
#include "imageio_loader.h"

#include <dlfcn.h>
#include <sys/auxv.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <climits>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <mutex>
#include <span>
#include <vector>

#include "block_damage.h"
#include "color_encoding.h"
#include "embedded_metadata.h"
#include "output_file.h"
#include "png_color.h"
#include "png_damage.h"
#include "texture_file.h"
#include "tiff_damage.h"

namespace envconv {
namespace {

constexpr char kFile[] = "libenvconv_imageio.so";

std::string folder_of(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return slash == std::string::npos ? "." : path.substr(0, slash);
}

std::string real_path(const char* path) {
  char* resolved = ::realpath(path, nullptr);
  std::string result = resolved ? resolved : "";
  std::free(resolved);
  return result;
}

std::vector<std::string> candidates() {
  std::vector<std::string> files;
  if (const char* path = std::getenv("ENVCONV_MODULE_PATH"); path && *path) {
    struct stat info {};
    const bool folder = ::stat(path, &info) == 0 && S_ISDIR(info.st_mode);
    files.push_back(folder ? std::string(path) + "/" + kFile : path);
  }
  std::vector<std::string> roots;
  Dl_info info{};
  if (::dladdr(reinterpret_cast<const void*>(&load_imageio), &info) != 0 && info.dli_fname) {
    roots.push_back(folder_of(real_path(info.dli_fname)));
  }
  roots.push_back(folder_of(real_path("/proc/self/exe")));
  // Where /proc is not mounted: the program's path as it was started.
  if (const auto* path = reinterpret_cast<const char*>(::getauxval(AT_EXECFN))) {
    roots.push_back(folder_of(real_path(path)));
  }
  for (const std::string& root : roots) {
    if (root.empty() || root == ".") continue;
    files.push_back(root + "/" + kFile);
    files.push_back(root + "/envconv/" + kFile);  // the library's own folder
    files.push_back(root + "/../" + kFile);       // a build's folder of tests or tools
    for (const char* lib : {
           "lib", "lib64",
#if defined(__x86_64__)
               "lib/x86_64-linux-gnu",
#elif defined(__aarch64__)
                            "lib/aarch64-linux-gnu",
#endif
         }) {
      files.push_back(root + "/../" + lib + "/envconv/" + kFile);
    }
#ifdef ENVCONV_LIB_FROM_BIN
    files.push_back(root + "/" ENVCONV_LIB_FROM_BIN "/envconv/" + kFile);
#endif
  }
#ifdef ENVCONV_MODULE_FOLDER
  // The library may be part of a program that lies anywhere.
  files.push_back(std::string(ENVCONV_MODULE_FOLDER) + "/" + kFile);
#endif
  return files;
}

Result<const EnvconvImageio*> load() {
  std::string why;
  for (const std::string& file : candidates()) {
    if (::access(file.c_str(), R_OK) != 0) continue;
    // Local: the image library's 260 dependencies must not lend their names to the program.
    void* handle = ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!handle) {
      const char* text = ::dlerror();
      why = text ? text : "it cannot be loaded";
      continue;
    }
    const auto* table = static_cast<const EnvconvImageio*>(::dlsym(handle, "envconv_imageio"));
    if (table && table->abi == kEnvconvImageioAbi) {
      table->prepare();
      return table;
    }
    why = file + " belongs to another version of envconv";
    ::dlclose(handle);
  }
  if (why.empty()) why = std::string(kFile) + " was not found (set ENVCONV_MODULE_PATH to its folder)";
  return Error{ErrorCode::unsupported, "this format needs the image library's module: " + why};
}

class ModuleDecoder final : public Decoder {
 public:
  /// The descriptor, of a file of that format, outlives it; `level` is what `handle` reads.
  ModuleDecoder(const EnvconvImageio& module, void* handle, FileSpec spec, std::string format, int fd, int level)
      : module_(module), handle_(handle), spec_(std::move(spec)), format_(std::move(format)), fd_(fd), level_(level) {}
  ~ModuleDecoder() override { module_.close(handle_); }

  const FileSpec& spec() const override { return spec_; }
  Result<Ok> decode(int, void* pixels) override {
    ENVCONV_CHECK(check_damage());
    const PictureSpec& p = spec_.pictures.front();
    const std::size_t bytes = bytes_of_rows(p, p.height);
    char error[1024] = "";
    if (module_.read(handle_, pixels, bytes, error, sizeof error)) return Ok{};
    return Error{ErrorCode::input, std::string("truncated or damaged: ") + error};
  }

 private:
  // What the image library would pass over.
  Result<Ok> check_damage() const {
    if (format_ == "png") return check_png(fd_);
    if (format_ == "tiff") return check_tiff(fd_, level_, true);
    if (format_ == "gif") return check_gif(fd_);
    if (format_ == "targa") return check_targa(fd_);
    if (format_ == "bmp") return check_bmp(fd_);
    if (format_ == "sgi") return check_sgi(fd_);
    if (format_ == "jpeg2000") return check_jpeg2000(fd_);
    return Ok{};
  }

  const EnvconvImageio& module_;
  void* handle_;
  FileSpec spec_;
  std::string format_;
  int fd_, level_;
};

std::string text_of(const char* text, std::size_t size) { return {text, ::strnlen(text, size)}; }

}  // namespace

namespace {

void take_png_color(const PngColor& color, FileSpec& spec) {
  spec.color_how = color.how;
  spec.primaries = color.primaries;
  if (color.transfer == Transfer::unknown) {
    spec.warnings.push_back("stored along " + color.note + ", which is not supported: read as sRGB");
    spec.transfer = Transfer::srgb;
    return;
  }
  spec.transfer = color.transfer;
  spec.gamma = static_cast<float>(color.gamma);
}

void take_profile(const EnvconvImageioSpec& raw, FileSpec& spec) {
  const std::string name = text_of(raw.profile, sizeof raw.profile);
  const std::span profile(static_cast<const std::uint8_t*>(raw.profile_data), raw.profile_size);
  if (!take_icc_profile(profile, static_cast<PixelType>(raw.type), spec) && name.find("sRGB") == std::string::npos) {
    spec.warnings.push_back("its ICC profile \"" + printable(name) +
                            "\" is no matrix with a simple curve, and not applied (--in-colorspace says what it is)");
  }
}

}  // namespace

bool needs_imageio(const std::string& format) {
  return format != "openexr" && format != "hdr" && !is_texture_file(format);
}

Result<const EnvconvImageio*> load_imageio() {
  static std::mutex mutex;
  static const EnvconvImageio* loaded = nullptr;
  const std::lock_guard lock(mutex);
  if (!loaded) {
    ENVCONV_TRY(loaded, load());
  }
  return loaded;
}

Result<std::unique_ptr<Decoder>> open_imageio(const std::string& format, int fd, const DecoderOptions& options) {
  ENVCONV_TRY(const EnvconvImageio* module, load_imageio());
  auto raw = std::make_unique<EnvconvImageioSpec>();
  void* handle = nullptr;
  char error[1024] = "";
  const int opened = module->open(format.c_str(), fd, options.level, raw.get(), &handle, error, sizeof error);
  if (opened != 1) return Error{ErrorCode::input, std::string(opened < 0 ? "" : "truncated or damaged: ") + error};
  struct Close {
    const EnvconvImageio* module;
    void* handle;
    ~Close() {
      if (handle) module->close(handle);
    }
  } close{module, handle};
  if (raw->width < 1 || raw->height < 1) return Error{ErrorCode::input, "an empty image"};
  if (raw->width > std::numeric_limits<int>::max() || raw->height > std::numeric_limits<int>::max() ||
      raw->width > options.max_pixels / raw->height) {
    return too_many_pixels(raw->width, raw->height, options.max_pixels);
  }
  if (raw->channels < 1 || raw->channels > kMaxChannels) {
    return Error{ErrorCode::input, "has " + std::to_string(raw->channels) + " channels (at most " +
                                       std::to_string(kMaxChannels) + " can be read)"};
  }
  FileSpec spec;
  spec.compression = text_of(raw->compression, sizeof raw->compression);
  spec.transfer = static_cast<Transfer>(raw->transfer);
  spec.gamma = raw->gamma;
  spec.unassociated = raw->unassociated != 0;
  spec.orientation = raw->orientation;
  spec.levels = raw->levels;
  if (raw->transfer_told) spec.color_how = "the file's own";
  if (format == "png") {
    if (const auto color = read_png_color(fd)) take_png_color(*color, spec);
  }
  if (raw->profile_size > 0 && spec.color_how != "cICP") take_profile(*raw, spec);
  if (raw->pictures > 1) spec.warnings.push_back("only the first of several pictures is read");
  PictureSpec picture;
  picture.width = static_cast<int>(raw->width);
  picture.height = static_cast<int>(raw->height);
  picture.type = static_cast<PixelType>(raw->type);
  picture.element = static_cast<PixelType>(raw->element);
  for (int c = 0; c < raw->channels; ++c)
    picture.channels.names.push_back(text_of(raw->names[c], sizeof raw->names[c]));
  picture.channels.alpha = raw->alpha;
  spec.pictures.push_back(std::move(picture));
  spec.metadata["ImageDescription"] = text_of(raw->description, sizeof raw->description);
  close.handle = nullptr;
  const int level = std::clamp(options.level, 0, std::max(spec.levels - 1, 0));
  return std::unique_ptr<Decoder>(std::make_unique<ModuleDecoder>(*module, handle, std::move(spec), format, fd, level));
}

}  // namespace envconv
