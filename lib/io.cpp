// SPDX-License-Identifier: Apache-2.0
#include "io.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <tbb/parallel_for.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <memory>
#include <thread>

#include "decoder.h"
#include "exr.h"
#include "hdr.h"
#include "imageio_loader.h"
#include "isolated_reader.h"
#include "output_file.h"

namespace envconv {

std::string_view name_of(PixelType type) {
  switch (type) {
    case PixelType::half: return "half";
    case PixelType::float32: return "float";
    case PixelType::uint8: return "uint8";
    case PixelType::uint16: return "uint16";
    case PixelType::uint32: return "uint32";
  }
  return "?";
}

Error too_many_pixels(std::int64_t width, std::int64_t height, std::int64_t limit) {
  return {ErrorCode::limit, "claims " + std::to_string(width) + "x" + std::to_string(height) +
                                " texels, more than the limit of " + std::to_string(limit) +
                                " (--max-pixels raises it)"};
}

Result<std::unique_ptr<Decoder>> open_decoder(const std::string& format, int fd, const DecoderOptions& options) {
  if (format == "openexr") return open_exr(fd, options);
  if (format == "hdr") return open_hdr(fd, options);
  return open_imageio(format, fd, options);
}

namespace {

Error on(const std::string& path, Error error) {
  error.message = printable(path) + ": " + error.message;
  return error;
}

Error on(const std::string& path, ErrorCode code, const std::string& what) { return on(path, Error{code, what}); }

class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int get() const { return fd_; }

 private:
  int fd_;
};

std::string extension_of(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  const std::string name = slash == std::string::npos ? path : path.substr(slash + 1);
  const std::size_t dot = name.rfind('.');
  if (dot == std::string::npos || dot + 1 == name.size()) return {};
  std::string extension = name.substr(dot + 1);
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

int thread_count(int asked) {
  return asked > 0 ? std::min(asked, 1024) : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

// --- what a file is ------------------------------------------------------------------------------------------------

// Only pictures, and of those only what someone keeps an environment in: the image library would read films, maps and
// medical volumes as well, with 260 libraries' worth of code.
Result<std::string> sniff(const std::string& head, const std::string& tail, const std::string& path, off_t size) {
  const auto starts = [&](std::string_view magic, std::size_t at = 0) {
    return head.size() >= at + magic.size() && std::string_view(head).substr(at, magic.size()) == magic;
  };
  using namespace std::string_view_literals;
  if (starts("\x76\x2f\x31\x01"sv)) return std::string("openexr");
  if (starts("#?")) return std::string("hdr");
  if (starts("\x89PNG\r\n\x1a\n"sv)) return std::string("png");
  if (starts("II*\0"sv) || starts("MM\0*"sv) || starts("II+\0"sv) || starts("MM\0+"sv)) return std::string("tiff");
  if (starts("\xff\xd8\xff"sv)) return std::string("jpeg");
  if (starts("RIFF") && starts("WEBP", 8)) return std::string("webp");
  if (starts("GIF87a") || starts("GIF89a")) return std::string("gif");
  if (starts("8BPS")) return std::string("psd");
  if (starts("DDS ")) return std::string("dds");
  if (starts("\0\0\0\x0cjP  "sv) || starts("\xff\x4f\xff\x51"sv)) return std::string("jpeg2000");
  if (starts("ftyp", 4)) {
    for (const char* brand : {"heic", "heix", "mif1", "avif"}) {
      if (starts(brand, 8)) return std::string("heif");
    }
  }
  if (starts("\x01\xda"sv)) return std::string("sgi");
  if (head.size() > 2 && head[0] == 'P' && std::strchr("123456Ff", head[1]) &&
      std::isspace(static_cast<unsigned char>(head[2]))) {
    return std::string("pnm");
  }
  if (starts("BM") && head.size() >= 26) return std::string("bmp");
  const std::string_view mark = "TRUEVISION-XFILE.\0"sv;
  if (tail.size() >= mark.size() && std::string_view(tail).substr(tail.size() - mark.size()) == mark) {
    return std::string("targa");
  }
  // The older kind has no mark, only a plausible header.
  const auto at = [&](std::size_t i) { return static_cast<unsigned char>(head[i]); };
  if ((extension_of(path) == "tga" || extension_of(path) == "targa") && head.size() >= 18 && at(1) <= 1 &&
      (at(2) == 1 || at(2) == 2 || at(2) == 3 || at(2) == 9 || at(2) == 10 || at(2) == 11)) {
    return std::string("targa");
  }
  // What else is commonly found in a picture's place.
  if (starts("version https://git-lfs")) {
    return Error{ErrorCode::input, "a Git LFS pointer of " + std::to_string(size) +
                                       " bytes, not the picture itself (fetch it with git lfs pull)"};
  }
  std::string text;
  for (const char c : head) {
    if (text.empty() && (std::isspace(static_cast<unsigned char>(c)) || static_cast<unsigned char>(c) >= 0x80))
      continue;
    text += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  if (text.compare(0, 9, "<!doctype") == 0 || text.compare(0, 5, "<html") == 0) {
    return Error{ErrorCode::input, "an HTML page, not a picture (a download that went wrong?)"};
  }
  if (text.compare(0, 5, "<?xml") == 0 || text.compare(0, 4, "<svg") == 0) {
    return Error{ErrorCode::input, "an XML file, not a picture of pixels"};
  }
  return Error{ErrorCode::input,
               "not a picture of a known format (exr hdr png tiff jpeg webp tga bmp pnm pfm gif jp2 "
               "psd dds heif sgi)"};
}

std::string read_at(int fd, off_t position, std::size_t count) {
  std::string bytes(count, '\0');
  std::size_t done = 0;
  while (done < count) {
    const ssize_t n = ::pread(fd, bytes.data() + done, count - done, position + static_cast<off_t>(done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) break;
    done += static_cast<std::size_t>(n);
  }
  bytes.resize(done);
  return bytes;
}

// --- our attributes in one line ------------------------------------------------------------------------------------

std::string join_metadata(const Metadata& metadata) {
  std::string line;
  for (const auto& [name, value] : metadata) {
    if (name.compare(0, 8, "envconv:") != 0) continue;
    line += (line.empty() ? "" : " ") + name + "=";
    for (const char c : value) {
      const auto byte = static_cast<unsigned char>(c);
      if (byte <= ' ' || byte == '%' || byte >= 0x7F) {
        char code[4];
        std::snprintf(code, sizeof code, "%%%02X", byte);
        line += code;
      } else {
        line += c;
      }
    }
  }
  return line;
}

void split_metadata(const std::string& line, Metadata& metadata) {
  for (std::size_t at = 0; at < line.size();) {
    const std::size_t end = std::min(line.find_first_of(" \t\r\n", at), line.size());
    const std::string word = line.substr(at, end - at);
    at = end + 1;
    const std::size_t equals = word.find('=');
    if (word.compare(0, 8, "envconv:") != 0 || equals == std::string::npos) continue;
    std::string value;
    for (std::size_t i = equals + 1; i < word.size(); ++i) {
      unsigned code = 0;
      if (word[i] == '%' && i + 2 < word.size() &&
          std::from_chars(&word[i + 1], &word[i + 1] + 2, code, 16).ptr == &word[i + 1] + 2) {
        value += static_cast<char>(code);
        i += 2;
      } else {
        value += word[i];
      }
    }
    metadata[word.substr(0, equals)] = value;
  }
}

// --- colour --------------------------------------------------------------------------------------------------------

double srgb_to_linear(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }
double linear_to_srgb(double v) { return v <= 0.0031308 ? v * 12.92 : 1.055 * std::pow(v, 1 / 2.4) - 0.055; }

using Curve = std::function<double(double)>;

Curve curve_of(const FileSpec& spec) {
  switch (spec.transfer) {
    case Transfer::srgb: return srgb_to_linear;
    case Transfer::gamma:
      return [gamma = static_cast<double>(spec.gamma)](double v) { return std::pow(std::max(v, 0.0), gamma); };
    default: return [](double v) { return v; };
  }
}

std::string color_of(const FileSpec& spec) {
  if (spec.transfer == Transfer::linear) return "linear";
  if (spec.transfer == Transfer::srgb) return "sRGB";
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", static_cast<double>(spec.gamma));
  for (char& c : text) {
    if (c == ',') c = '.';  // whatever the host's locale
  }
  return std::string("gamma ") + text;
}

// Rounds a linear value in [0, 1] to the nearest code of the sRGB curve.  The curve is tabulated where codes change, so
// the answer is that of the formula in double precision, at the price of a few comparisons.
class SrgbEncoder {
 public:
  explicit SrgbEncoder(int top, int shift) : top_(top), shift_(shift), changes_(static_cast<std::size_t>(top) + 1) {
    for (int code = 0; code < top; ++code) {
      changes_[static_cast<std::size_t>(code)] = static_cast<float>(srgb_to_linear((code + 0.5) / top));
    }
    changes_[static_cast<std::size_t>(top)] = 2;  // a sentinel
    const std::uint32_t last = std::bit_cast<std::uint32_t>(1.f) >> shift_;
    first_ = std::bit_cast<std::uint32_t>(kSmall) >> shift_;
    for (std::uint32_t bin = first_; bin <= last; ++bin) {
      const float value = std::bit_cast<float>(bin << shift_);
      starts_.push_back(
          static_cast<std::uint16_t>(std::upper_bound(changes_.begin(), changes_.end(), value) - changes_.begin()));
    }
  }
  int operator()(float v) const {
    if (v < kSmall) return static_cast<int>(std::rint(v * 12.92f * static_cast<float>(top_)));
    std::size_t code = starts_[(std::bit_cast<std::uint32_t>(v) >> shift_) - first_];
    while (v >= changes_[code]) ++code;
    return static_cast<int>(code);
  }

 private:
  static constexpr float kSmall = 0x1p-13f;
  int top_, shift_;
  std::uint32_t first_ = 0;
  std::vector<float> changes_;         // from code to code + 1
  std::vector<std::uint16_t> starts_;  // the smallest code of a range of floats
};

const SrgbEncoder& srgb_encoder(PixelType type) {
  static const SrgbEncoder eight(255, 16);
  if (type == PixelType::uint8) return eight;
  static const SrgbEncoder sixteen(65535, 11);
  return sixteen;
}

// --- decoded elements to linear, upright pixels --------------------------------------------------------------------

struct Upright {
  int width, height;  // as shown
  int orientation;

  Upright(const PictureSpec& p, int o)
      : width(o >= 5 ? p.height : p.width), height(o >= 5 ? p.width : p.height), orientation(o) {}
  // Where a stored texel is shown.
  void place(int column, int row, int& x, int& y) const {
    switch (orientation) {
      case 2: x = width - 1 - column, y = row; break;
      case 3: x = width - 1 - column, y = height - 1 - row; break;
      case 4: x = column, y = height - 1 - row; break;
      case 5: x = row, y = column; break;
      case 6: x = width - 1 - row, y = column; break;
      case 7: x = width - 1 - row, y = height - 1 - column; break;
      case 8: x = row, y = height - 1 - column; break;
      default: x = column, y = row;
    }
  }
};

void to_linear(const void* elements, const PictureSpec& picture, const FileSpec& spec, bool drop_alpha, Image& image) {
  const Upright upright(picture, spec.orientation);
  const int channels = picture.channels.count(), alpha = picture.channels.alpha;
  const Curve curve = curve_of(spec);
  // Integers have few values: one table each for colour and alpha.
  std::vector<float> table;
  float scale = 1;
  if (picture.element == PixelType::uint8 || picture.element == PixelType::uint16) {
    const int top = picture.element == PixelType::uint8 ? 255 : 65535;
    scale = 1 / static_cast<float>(top);
    for (int i = 0; i <= top; ++i) table.push_back(static_cast<float>(curve(static_cast<double>(i) / top)));
  }
  const bool curved = spec.transfer != Transfer::linear;
  tbb::parallel_for(0, picture.height, [&](int row) {
    const std::size_t begin =
        static_cast<std::size_t>(row) * static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(channels);
    std::vector<float> value(static_cast<std::size_t>(channels));
    for (int column = 0; column < picture.width; ++column) {
      const std::size_t at = begin + static_cast<std::size_t>(column) * static_cast<std::size_t>(channels);
      int x = 0, y = 0;
      upright.place(column, row, x, y);
      float* to = image.at(x, y);
      const auto raw = [&](int c) -> std::uint32_t {
        return picture.element == PixelType::uint8
                   ? static_cast<const std::uint8_t*>(elements)[at + static_cast<std::size_t>(c)]
                   : static_cast<const std::uint16_t*>(elements)[at + static_cast<std::size_t>(c)];
      };
      const auto fraction = [&](int c) {
        return table.empty() ? static_cast<const float*>(elements)[at + static_cast<std::size_t>(c)]
                             : static_cast<float>(raw(c)) * scale;
      };
      const float a = alpha >= 0 ? fraction(alpha) : 1.f;
      for (int c = 0; c < channels; ++c) {
        if (c == alpha) {
          if (!drop_alpha) *to++ = a;
        } else if (alpha >= 0 && !drop_alpha && !spec.unassociated && curved) {
          // Colour times alpha was put through the curve as a product; take alpha off first.
          *to++ = a > 0 ? static_cast<float>(curve(static_cast<double>(fraction(c)) / a)) * a : 0.f;
        } else {
          const float v = !table.empty() ? table[raw(c)]
                          : curved       ? static_cast<float>(curve(fraction(c)))
                                         : fraction(c);
          *to++ = alpha >= 0 && !drop_alpha && spec.unassociated ? v * a : v;
        }
      }
    }
  });
}

struct FreeBytes {
  void operator()(void* p) const { std::free(p); }
};

// --- checks of what a decoder claims -------------------------------------------------------------------------------

Result<Ok> check_claims(const FileSpec& spec, const std::string& format, const ReadOptions& options, off_t file_size) {
  std::int64_t total = 0;
  double bytes = 0;
  if (spec.pictures.empty() || spec.pictures.size() > kMaxPictures) return Error{ErrorCode::input, "has no pictures"};
  for (const PictureSpec& p : spec.pictures) {
    const int channels = p.channels.count();
    if (p.width < 1 || p.height < 1 || channels < 1) return Error{ErrorCode::input, "an empty image"};
    if (channels > kMaxChannels || p.channels.alpha >= channels)
      return Error{ErrorCode::input, "has too many channels"};
    if (p.width > options.max_pixels / p.height) return too_many_pixels(p.width, p.height, options.max_pixels);
    total += static_cast<std::int64_t>(p.width) * p.height;
    if (total > options.max_pixels) {
      return Error{ErrorCode::limit, "its pictures together claim at least " + std::to_string(total) +
                                         " texels, more than the limit of " + std::to_string(options.max_pixels) +
                                         " (--max-pixels raises it)"};
    }
    bytes += static_cast<double>(p.width) * p.height * channels * static_cast<double>(size_of(p.type));
  }
  if (total > (std::int64_t{1} << 62) / (4 * kMaxChannels))
    return Error{ErrorCode::limit, "too large for this machine"};
  // No run-length or Deflate stream packs tighter than this.  PIZ, DWA and the wavelet formats do, for a plain colour.
  const std::string& c = spec.compression;
  const bool tight =
      c == "piz" || c == "dwaa" || c == "dwab" || format == "webp" || format == "jpeg2000" || format == "heif";
  if (!options.trust_input && !tight && bytes > 1e6 && bytes > 1e4 * static_cast<double>(file_size)) {
    return Error{ErrorCode::input, "claims " + std::to_string(static_cast<std::int64_t>(bytes / 1e6)) +
                                       " MB of pixels in a file of " + std::to_string(file_size) +
                                       " bytes (--trust-input reads it all the same)"};
  }
  return Ok{};
}

Result<PictureFile> read_file(const std::string& path, const ReadOptions& options) {
  if (path.find('\0') != std::string::npos) return on(path, ErrorCode::input, "a name cannot contain a zero byte");
  const Descriptor fd(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC | O_NOCTTY));
  if (fd.get() < 0) {
    return on(path, ErrorCode::input, errno == ENXIO ? "not a regular file" : std::strerror(errno));
  }
  struct stat info {};
  if (::fstat(fd.get(), &info) != 0) return on(path, ErrorCode::input, std::strerror(errno));
  if (S_ISDIR(info.st_mode)) return on(path, ErrorCode::input, "is a directory, not a regular file");
  if (!S_ISREG(info.st_mode)) return on(path, ErrorCode::input, "not a regular file");
  if (info.st_size == 0) return on(path, ErrorCode::input, "an empty file");
  const std::string head = read_at(fd.get(), 0, 512);
  if (head.empty()) return on(path, ErrorCode::input, "cannot be read");
  const auto format = sniff(head, read_at(fd.get(), std::max<off_t>(info.st_size - 18, 0), 18), path, info.st_size);
  if (!format) return on(path, format.error());

  DecoderOptions how;
  how.max_pixels = std::max<std::int64_t>(options.max_pixels, 1);
  // A small file is decoded before a second thread has started.
  how.threads =
      std::min(thread_count(options.threads), static_cast<int>(std::min<off_t>(info.st_size / 200000, 1023)) + 1);
  if (options.header_only) how.threads = 1;
  if (options.trust_input && *format == "openexr" && how.threads > 1) set_exr_pool_threads(how.threads);
  auto opened = options.trust_input ? open_decoder(*format, fd.get(), how) : open_isolated(*format, fd.get(), how);
  if (!opened) return on(path, opened.error());
  Decoder& decoder = **opened;
  const FileSpec& spec = decoder.spec();
  const auto claims = check_claims(spec, *format, options, info.st_size);
  if (!claims) return on(path, claims.error());

  PictureFile file;
  file.path = path;
  file.format = *format;
  file.compression = spec.compression;
  file.color = color_of(spec);
  file.levels = spec.levels;
  file.metadata = spec.metadata;
  const auto description = file.metadata.find("ImageDescription");
  if (description != file.metadata.end()) {
    const std::string line = description->second;
    file.metadata.erase(description);
    split_metadata(line, file.metadata);
  }
  for (const std::string& warning : spec.warnings) file.warnings.push_back(printable(path) + ": " + warning);
  for (std::size_t i = 0; i < spec.pictures.size(); ++i) {
    const PictureSpec& p = spec.pictures[i];
    Picture picture;
    picture.name = p.name;
    picture.channels = p.channels;
    picture.type = p.type;
    const bool drop_alpha = options.drop_alpha && p.channels.alpha >= 0 && p.channels.count() > 1;
    if (drop_alpha) {
      picture.channels.names.erase(picture.channels.names.begin() + p.channels.alpha);
      picture.channels.alpha = -1;
    }
    const int channels = picture.channels.count();
    const Upright upright(p, spec.orientation);
    if (options.header_only) {
      picture.image = Image::without_pixels(upright.width, upright.height, channels);
    } else {
      picture.image = Image(upright.width, upright.height, channels);
      const bool direct = p.element == PixelType::float32 && spec.orientation == 1 && !drop_alpha &&
                          spec.transfer == Transfer::linear && (p.channels.alpha < 0 || !spec.unassociated);
      const std::size_t bytes =
          picture.image.pixel_count() * static_cast<std::size_t>(p.channels.count()) * size_of(p.element);
      std::unique_ptr<void, FreeBytes> elements;
      void* to = picture.image.data();
      if (!direct) {
        elements.reset(std::calloc(bytes, 1));
        if (!elements) throw std::bad_alloc();
        to = elements.get();
      } else if (options.trust_input) {
        // What a damaged chunk leaves out is black, not whatever was in memory.
        std::memset(to, 0, bytes);
      }
      const auto decoded = decoder.decode(static_cast<int>(i), to);
      if (!decoded) return on(path, decoded.error());
      if (!direct) to_linear(elements.get(), p, spec, drop_alpha, picture.image);
    }
    file.pictures.push_back(std::move(picture));
  }
  return file;
}

// --- formats that can be written -----------------------------------------------------------------------------------

struct Format {
  const char* extension;
  const char* name;              // the image library's
  std::vector<PixelType> types;  // the first is what it usually holds
  std::vector<int> channels;     // counts; empty: any
  const char* compressions;      // names, or ""
  const char* attribute;         // where our line of metadata goes, or "" when it cannot
  bool lossy;                    // by nature
};

const std::vector<Format>& formats() {
  using enum PixelType;
  static const std::vector<Format>* const table = new std::vector<Format>{
      {"exr", "openexr", {half, float32, uint32}, {}, "", "", false},
      {"hdr", "hdr", {float32}, {1, 3}, "rle", "", false},
      {"pic", "hdr", {float32}, {1, 3}, "rle", "", false},
      {"png", "png", {uint8, uint16}, {1, 2, 3, 4}, "0-9", "ImageDescription", false},
      {"tif", "tiff", {float32, half, uint16, uint8}, {}, "none lzw zip packbits", "ImageDescription", false},
      {"tiff", "tiff", {float32, half, uint16, uint8}, {}, "none lzw zip packbits", "ImageDescription", false},
      {"jpg", "jpeg", {uint8}, {1, 3}, "1-100", "ImageDescription", true},
      {"jpeg", "jpeg", {uint8}, {1, 3}, "1-100", "ImageDescription", true},
      {"tga", "targa", {uint8}, {1, 3, 4}, "none rle", "ImageDescription", false},
      {"bmp", "bmp", {uint8}, {1, 3, 4}, "", "", false},
      // The WebP writer divides by alpha whatever it is told, so colour under alpha would be wrong.
      {"webp", "webp", {uint8}, {3}, "1-100", "", true},
      {"ppm", "pnm", {uint8}, {3}, "", "", false},
      {"pgm", "pnm", {uint8}, {1}, "", "", false},
      {"pnm", "pnm", {uint8}, {1, 3}, "", "", false},
      {"pfm", "pfm", {float32}, {1, 3}, "", "", false},
  };
  return *table;
}

bool is_integer(PixelType type) {
  return type == PixelType::uint8 || type == PixelType::uint16 || type == PixelType::uint32;
}

Result<const Format*> format_of(const std::string& path) {
  const std::string extension = extension_of(path);
  std::string list;
  for (const Format& format : formats()) {
    if (extension == format.extension) return &format;
    list += (list.empty() ? "" : " ") + std::string(format.extension);
  }
  return on(
      path, ErrorCode::unsupported,
      (extension.empty() ? std::string("has no extension") : "unknown extension \"." + printable(extension) + "\"") +
          " (can be written: " + list + ")");
}

Result<PixelType> type_for(const std::string& path, const Format& format, const WriteOptions& options) {
  const auto has = [&](PixelType type) {
    return std::find(format.types.begin(), format.types.end(), type) != format.types.end();
  };
  // Half in TIFF is known to few programs: only on request.
  const bool wanted = has(options.type) && (options.type_given || format.types.front() == PixelType::half ||
                                            options.type != PixelType::half);
  if (wanted) return options.type;
  if (options.type_given) {
    std::string list;
    for (const PixelType type : format.types) list += (list.empty() ? "" : ", ") + std::string(name_of(type));
    return on(path, ErrorCode::unsupported,
              "the format cannot hold " + std::string(name_of(options.type)) + " (it holds " + list + ")");
  }
  using enum PixelType;
  const std::vector<PixelType> nearest = options.type == uint8    ? std::vector{uint8, half, uint16, float32}
                                         : options.type == uint16 ? std::vector{uint16, float32, uint8, half}
                                         : options.type == uint32 ? std::vector{uint32, float32, uint16, uint8, half}
                                         : options.type == half   ? std::vector{float32, uint8}
                                                                  : std::vector{float32, uint16, uint8};
  for (const PixelType type : nearest) {
    if (has(type)) return type;
  }
  return format.types.front();
}

// The image library's text for a compression that the format has.
Result<std::string> compression_for(const std::string& path, const Format& format, const std::string& asked) {
  if (std::string_view(format.name) == "openexr") {
    const auto checked = check_exr_compression(asked);
    if (!checked) return on(path, checked.error());
    return asked;
  }
  if (asked.empty()) return std::string(std::string_view(format.name) == "tiff" ? "zip" : "");
  std::string text = asked;
  const std::string prefix = std::string(format.name) + ":";
  if (text.compare(0, prefix.size(), prefix) == 0) text = text.substr(prefix.size());
  if (text.compare(0, 8, "quality ") == 0) text = text.substr(8);
  int number = -1;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), number);
  const bool is_number = parsed.ec == std::errc() && parsed.ptr == text.data() + text.size();
  const std::string_view known = format.compressions;
  if (is_number && known.substr(0, 5) == "1-100" && number >= 1 && number <= 100) {
    return std::string(format.name) + ":" + text;
  }
  if (is_number && known == "0-9" && number >= 0 && number <= 9) return std::string("png:") + text;
  for (std::size_t at = 0; at < known.size();) {
    const std::size_t end = std::min(known.find(' ', at), known.size());
    if (known.substr(at, end - at) == text && !is_number) return text;
    at = end + 1;
  }
  return on(path, ErrorCode::unsupported,
            "the format has no compression \"" + printable(asked) + "\"" +
                (known.empty() ? std::string(" (it has only one)") : " (it has " + std::string(known) + ")"));
}

Result<Ok> check_channels(const std::string& path, const Format& format, int channels) {
  if (channels < 1) return on(path, ErrorCode::unsupported, "a picture without channels");
  if (channels > 1023) return on(path, ErrorCode::unsupported, "too many channels");
  if (format.channels.empty()) return Ok{};
  if (std::find(format.channels.begin(), format.channels.end(), channels) != format.channels.end()) return Ok{};
  std::string list;
  for (const int count : format.channels) list += (list.empty() ? "" : ", ") + std::to_string(count);
  std::string hint = "it holds " + list;
  if (channels == 2 || channels == 4) hint += "; --alpha drop leaves alpha out";
  return on(path, ErrorCode::unsupported,
            "the format cannot hold " + std::to_string(channels) + " channels (" + hint + ")");
}

// --- linear pixels to elements -------------------------------------------------------------------------------------

std::unique_ptr<void, FreeBytes> to_elements(const Picture& picture, PixelType type, WriteReport& report) {
  const Image& image = picture.image;
  const int channels = image.channels(), alpha = picture.channels.alpha;
  std::unique_ptr<void, FreeBytes> elements(std::malloc(std::max<std::size_t>(image.value_count() * size_of(type), 1)));
  if (!elements) throw std::bad_alloc();
  const float top = type == PixelType::uint8 ? 255.f : 65535.f;
  const SrgbEncoder& encoder = srgb_encoder(type);
  const float too_high =
      static_cast<float>(srgb_to_linear((static_cast<double>(top) + 0.5) / static_cast<double>(top)));
  const float too_low = -0.5f / 12.92f / top;
  std::atomic<std::int64_t> high{0}, negative{0}, nonfinite{0};
  tbb::parallel_for(0, image.height(), [&](int y) {
    const float* from = image.row(y);
    std::size_t at =
        static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width()) * static_cast<std::size_t>(channels);
    std::int64_t above = 0, below = 0, odd = 0;
    const auto clamped = [&](float v) {
      if (std::isnan(v)) return ++odd, 0.f;
      if (v >= 0 && v <= 1) return v;
      // What is beyond the range by less than a code rounds to its end, and nothing is lost.
      if (std::isinf(v)) {
        ++odd;
      } else if (v > too_high) {
        ++above;
      } else if (v < too_low) {
        ++below;
      }
      return v > 0 ? 1.f : 0.f;
    };
    for (int x = 0; x < image.width(); ++x, from += channels) {
      const float a = alpha >= 0 ? from[alpha] : 1.f;
      for (int c = 0; c < channels; ++c, ++at) {
        int code;
        if (c == alpha) {
          code = static_cast<int>(std::rint(clamped(a) * top));
        } else {
          // Integer formats keep colour apart from alpha; under no cover at all there is none.
          const float v = alpha < 0 ? from[c] : a > 0 ? from[c] / a : a == 0 ? 0.f : from[c];
          code = encoder(clamped(v));
        }
        if (type == PixelType::uint8) {
          static_cast<std::uint8_t*>(elements.get())[at] = static_cast<std::uint8_t>(code);
        } else {
          static_cast<std::uint16_t*>(elements.get())[at] = static_cast<std::uint16_t>(code);
        }
      }
    }
    high += above;
    negative += below;
    nonfinite += odd;
  });
  report.clamped_high += high;
  report.clamped_negative += negative;
  report.nonfinite += nonfinite;
  return elements;
}

Result<Ok> write_module(OutputFile& file, const Picture& picture, const Format& format, const std::string& compression,
                        const WriteOptions& options, WriteReport& report) {
  ENVCONV_TRY(const EnvconvImageio* module, load_imageio());
  const Image& image = picture.image;
  std::unique_ptr<void, FreeBytes> elements;
  EnvconvImageioPicture out{};
  out.width = image.width();
  out.height = image.height();
  out.channels = image.channels();
  out.alpha = picture.channels.alpha;
  out.element = static_cast<std::int32_t>(report.type);
  out.pixels = image.data();
  if (is_integer(report.type)) {
    elements = to_elements(picture, report.type, report);
    out.pixels = elements.get();
  } else {
    // The library converts to half itself, without a word about what does not fit.
    std::int64_t odd = 0, high = 0;
    for (std::size_t i = 0; i < image.value_count(); ++i) {
      odd += !std::isfinite(image.data()[i]);
      high += report.type == PixelType::half && std::isfinite(image.data()[i]) && std::abs(image.data()[i]) >= 65520.f;
    }
    report.nonfinite += odd;
    report.clamped_high += high;
    if (report.type == PixelType::half) {
      elements.reset(std::malloc(image.value_count() * 2));
      if (!elements) throw std::bad_alloc();
      floats_to_halves(image.data(), image.value_count(), static_cast<std::uint16_t*>(elements.get()));
      out.pixels = elements.get();
    }
  }
  std::vector<const char*> names;
  for (const std::string& name : picture.channels.names) names.push_back(name.c_str());
  out.names = names.data();
  out.compression = compression.c_str();
  const std::string description = *format.attribute ? join_metadata(options.metadata) : "";
  out.description = description.c_str();
  out.attribute = format.attribute;
  if (!*format.attribute && !join_metadata(options.metadata).empty()) {
    report.warnings.push_back(std::string("the format ") + format.extension +
                              " holds no metadata: the layout is not recorded");
  }
  EnvconvImageioSink sink{};
  sink.context = &file;
  sink.write = [](void* f, const void* data, std::size_t size) { static_cast<OutputFile*>(f)->write(data, size); };
  sink.read = [](void* f, void* data, std::size_t size) { return static_cast<OutputFile*>(f)->read(data, size); };
  sink.seek = [](void* f, std::uint64_t position) { static_cast<OutputFile*>(f)->seek(position); };
  sink.tell = [](void* f) { return static_cast<OutputFile*>(f)->tell(); };
  sink.size = [](void* f) { return static_cast<OutputFile*>(f)->size(); };
  char error[1024] = "";
  if (!module->write(format.name, &out, &sink, error, sizeof error)) return Error{ErrorCode::output, error};
  return Ok{};
}

// Portable float map: the image library reads it and does not write it.  Rows from the bottom, little-endian.
void write_pfm(OutputFile& file, const Picture& picture, const WriteOptions& options, WriteReport& report) {
  static_assert(std::endian::native == std::endian::little);
  const Image& image = picture.image;
  const std::string header = std::string(image.channels() == 3 ? "PF" : "Pf") + "\n" + std::to_string(image.width()) +
                             " " + std::to_string(image.height()) + "\n-1.0\n";
  file.write(header.data(), header.size());
  const std::size_t row = static_cast<std::size_t>(image.width()) * static_cast<std::size_t>(image.channels());
  for (int y = image.height() - 1; y >= 0; --y) {
    file.write(image.row(y), row * sizeof(float));
    report.nonfinite += std::count_if(image.row(y), image.row(y) + row, [](float v) { return !std::isfinite(v); });
  }
  if (!join_metadata(options.metadata).empty()) {
    report.warnings.push_back("the format pfm holds no metadata: the layout is not recorded");
  }
}

// --- reading back --------------------------------------------------------------------------------------------------

// Pixels as written and as read again: within half a step of the type, or near on average when the codec is lossy.
Result<Ok> compare(const Picture& written, const Picture& read, PixelType type, bool rgbe, bool lossy) {
  const Image &a = written.image, &b = read.image;
  if (a.width() != b.width() || a.height() != b.height())
    return Error{ErrorCode::output, "has another size when read back"};
  const int channels = a.channels(), alpha = written.channels.alpha;
  const bool grey = rgbe && channels == 1;
  if (b.channels() != (grey ? 3 : channels)) return Error{ErrorCode::output, "has other channels when read back"};
  const float top = type == PixelType::uint8 ? 255.f : 65535.f;
  const auto coded = [](float v) { return static_cast<float>(linear_to_srgb(std::clamp(v, 0.f, 1.f))); };
  double difference = 0, sum = 0;
  for (int y = 0; y < a.height(); ++y) {
    for (int x = 0; x < a.width(); ++x) {
      float peak = 0;
      for (int c = 0; c < channels; ++c) peak = std::max(peak, std::abs(a.at(x, y)[c]));
      for (int c = 0; c < channels; ++c) {
        float v = a.at(x, y)[c];
        const float w = b.at(x, y)[c];
        float error, allowed;
        if (std::isnan(v)) v = is_integer(type) || type == PixelType::half || rgbe ? 0 : v;
        if (rgbe) {
          v = std::clamp(v, 0.f, 0x1.fep126f);
          error = std::abs(v - w);
          allowed = std::min(peak, 0x1.fep126f) * (0.51f / 128) + 1e-38f;
        } else if (type == PixelType::half) {
          v = std::clamp(v, -65504.f, 65504.f);
          error = std::abs(v - w);
          allowed = std::abs(v) * 0x1.1p-11f + 0x1.1p-25f;
        } else if (type == PixelType::float32) {
          error = (std::isnan(v) && std::isnan(w)) || v == w ? 0 : std::abs(v - w);
          allowed = 0;
        } else if (type == PixelType::uint32) {
          v = std::clamp(v, 0.f, 4294967295.f);
          error = std::abs(v - w);
          allowed = 0.51f + v * 1e-6f;
        } else if (alpha >= 0) {
          // Rounding of colour and of alpha, at the steepest of the curve.
          error = std::abs(std::clamp(v, 0.f, 1.f) - w);
          allowed = 3.2f / top;
        } else {
          error = std::abs(coded(v) - coded(w));
          allowed = 0.52f / top;
        }
        if (lossy) {
          const bool integer = is_integer(type);
          difference += integer ? std::abs(coded(v) - coded(w)) : error;
          sum += integer ? 1 : std::abs(v);
        } else if (!(error <= allowed)) {
          return Error{ErrorCode::output, "a texel at (" + std::to_string(x) + ", " + std::to_string(y) +
                                              ") differs when read back (a fault of the disk or memory?)"};
        }
      }
    }
  }
  if (lossy && !(difference <= 0.1 * sum + 1e-6))
    return Error{ErrorCode::output, "the pixels differ too much when read back"};
  return Ok{};
}

Result<Ok> verify(const OutputFile& file, const std::vector<Picture>& pictures, const WriteOptions& options,
                  const Format& format, PixelType type) {
  ReadOptions how;
  how.max_pixels = INT64_MAX / 1024;
  // It is our own; but what a disk made of it may upset a codec, and some print.
  how.trust_input = !needs_imageio(format.name);
  how.threads = options.threads;
  auto read = read_file(file.temporary(), how);
  if (!read) return Error{ErrorCode::output, "cannot be read back: " + read.error().message};
  if (read->pictures.size() != pictures.size()) return Error{ErrorCode::output, "has other parts when read back"};
  const bool exr = std::string_view(format.name) == "openexr";
  const bool lossy = exr ? exr_compression_is_lossy(options.compression, type) : format.lossy;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    ENVCONV_CHECK(compare(pictures[i], read->pictures[i], type, std::string_view(format.name) == "hdr", lossy));
  }
  return Ok{};
}

Result<WriteReport> write_file(const std::string& path, const std::vector<Picture>& pictures,
                               const WriteOptions& options) {
  if (pictures.empty()) return on(path, ErrorCode::internal, "no picture to write");
  std::size_t values = 0;
  for (const Picture& picture : pictures) {
    if (picture.image.empty() || picture.image.width() < 1 || picture.image.height() < 1) {
      return on(path, ErrorCode::internal, "a picture without pixels");
    }
    if (picture.channels.count() != picture.image.channels()) {
      return on(path, ErrorCode::internal, "a picture whose channels have no names");
    }
    ENVCONV_CHECK(can_write(path, options, static_cast<int>(pictures.size()), picture.image.channels()));
    values += picture.image.value_count();
  }
  ENVCONV_TRY(const Format* format, format_of(path));
  ENVCONV_TRY(const std::string compression, compression_for(path, *format, options.compression));
  WriteReport report;
  ENVCONV_TRY(report.type, type_for(path, *format, options));
  ENVCONV_TRY(OutputFile file, OutputFile::create(path));
  Result<Ok> done = Ok{};
  if (std::string_view(format->name) == "openexr") {
    if (values > (1u << 18)) set_exr_pool_threads(thread_count(options.threads));
    done = write_exr(file, pictures, options, report);
  } else if (std::string_view(format->name) == "hdr") {
    done = write_hdr(file, pictures.front(), options.metadata, report);
  } else if (std::string_view(format->name) == "pfm") {
    write_pfm(file, pictures.front(), options, report);
  } else {
    done = write_module(file, pictures.front(), *format, compression, options, report);
  }
  if (!done) return on(path, done.error());
  if (file.size() == 0) return on(path, ErrorCode::output, "the writer of this format wrote nothing");
  // Tests damage the file here, to see that verification finds it.
  if (const char* hook = std::getenv("ENVCONV_TEST_WRITER"); hook && std::string_view(hook) == "flip") {
    char byte = 0;
    file.seek(file.size() / 2);
    file.read(&byte, 1);
    byte = static_cast<char>(byte ^ 0x40);
    file.seek(file.size() / 2);
    file.write(&byte, 1);
  }
  ENVCONV_CHECK(file.sync());
  if (options.verify) {
    const auto verified = verify(file, pictures, options, *format, report.type);
    if (!verified) return on(path, verified.error());
  }
  ENVCONV_CHECK(file.commit());
  return report;
}

// The interface throws nothing: what a library below throws becomes an error.
template <class T, class F>
Result<T> guarded(const std::string& path, ErrorCode code, F&& f) {
  try {
    return f();
  } catch (const std::bad_alloc&) {
    return on(path, ErrorCode::limit, "not enough memory");
  } catch (const std::exception& error) {
    return on(path, code, error.what());
  } catch (...) {
    return on(path, code, "unknown failure");
  }
}

}  // namespace

Result<PictureFile> read_pictures(const std::string& path, const ReadOptions& options) {
  return guarded<PictureFile>(path, ErrorCode::input, [&] { return read_file(path, options); });
}

Result<Ok> can_write(const std::string& path, const WriteOptions& options, int parts, int channels) {
  return guarded<Ok>(path, ErrorCode::unsupported, [&]() -> Result<Ok> {
    ENVCONV_TRY(const Format* format, format_of(path));
    if (parts > 1 && std::string_view(format->name) != "openexr") {
      return on(path, ErrorCode::unsupported, "only EXR holds several pictures in a file");
    }
    ENVCONV_CHECK(check_channels(path, *format, channels));
    ENVCONV_CHECK(type_for(path, *format, options));
    ENVCONV_CHECK(compression_for(path, *format, options.compression));
    return Ok{};
  });
}

Result<WriteReport> write_pictures(const std::string& path, const std::vector<Picture>& pictures,
                                   const WriteOptions& options) {
  return guarded<WriteReport>(path, ErrorCode::output, [&] { return write_file(path, pictures, options); });
}

}  // namespace envconv
