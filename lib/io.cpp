// SPDX-License-Identifier: Apache-2.0
// Reading files, and what reading and writing share.
#include "io.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <optional>
#include <thread>

#include "dds.h"
#include "decoder.h"
#include "exr.h"
#include "hdr.h"
#include "imageio_loader.h"
#include "io_shared.h"
#include "isolated_reader.h"
#include "jpeg_read.h"
#include "ktx.h"
#include "texture_file.h"
#include "tiff_read.h"
#include "to_linear.h"

namespace envconv {

std::string_view name_of(PixelType type) {
  switch (type) {
    case PixelType::half: return "half";
    case PixelType::float32: return "float";
    case PixelType::uint8: return "uint8";
    case PixelType::uint16: return "uint16";
    case PixelType::uint32: return "uint32";
    case PixelType::r11g11b10f: return "r11g11b10f";
    case PixelType::rgb9e5: return "rgb9e5";
    case PixelType::bc6h: return "bc6h";
  }
  return "?";
}

void FreeBytes::operator()(void* p) const { std::free(p); }

Error on(const std::string& path, Error error) {
  error.message = printable(path) + ": " + error.message;
  return error;
}

Error on(const std::string& path, ErrorCode code, const std::string& what) { return on(path, Error{code, what}); }

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

bool is_integer(PixelType type) {
  return type == PixelType::uint8 || type == PixelType::uint16 || type == PixelType::uint32;
}

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

double srgb_to_linear(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }
double linear_to_srgb(double v) { return v <= 0.0031308 ? v * 12.92 : 1.055 * std::pow(v, 1 / 2.4) - 0.055; }

Error too_many_pixels(std::int64_t width, std::int64_t height, std::int64_t limit) {
  return {ErrorCode::limit, "claims " + std::to_string(width) + "x" + std::to_string(height) +
                                " texels, more than the limit of " + std::to_string(limit) +
                                " (--max-pixels raises it)"};
}

std::size_t bytes_of_rows(const PictureSpec& picture, int rows) {
  return static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(rows) *
         static_cast<std::size_t>(picture.channels.count()) * size_of(picture.element);
}

int band_rows(const PictureSpec& picture, int multiple, int least) {
  constexpr std::size_t usual = std::size_t{4} << 20, most = 16 * usual;
  const std::size_t row = bytes_of_rows(picture, 1);
  const std::size_t rows = std::max(usual / row, std::min(static_cast<std::size_t>(least), most / row)) + 1;
  const auto block = static_cast<std::size_t>(multiple);
  const std::size_t band = (rows + block - 1) / block * block;
  return band < static_cast<std::size_t>(picture.height) ? static_cast<int>(band) : 0;
}

Error no_memory_for(std::size_t bytes) {
  return {ErrorCode::limit, "not enough memory: the picture needs " + std::to_string(bytes >> 20) + " MB"};
}

Result<MappedMemory> Decoder::pixels(int picture) {
  const std::size_t bytes = bytes_of(spec().pictures[static_cast<std::size_t>(picture)]);
  MappedMemory memory = MappedMemory::zeros(bytes);
  if (!memory.data()) return no_memory_for(bytes);
  ENVCONV_CHECK(decode(picture, memory.data()));
  return memory;
}

bool has_own_reader(std::string_view format) {
  return format == "openexr" || format == "hdr" || format == "jpeg" || format == "tiff" || is_texture_file(format);
}

Result<std::unique_ptr<Decoder>> open_decoder(const std::string& format, int fd, const DecoderOptions& options) {
  if (options.library || !has_own_reader(format)) return open_imageio(format, fd, options);
  if (format == "openexr") return open_exr(fd, options);
  if (format == "jpeg") return open_jpeg(fd, options);
  if (format == "tiff") return open_tiff(fd, options);
  if (format == "hdr") return open_hdr(fd, options);
  if (format == "dds") return open_dds(fd, options);
  if (format == "ktx") return open_ktx1(fd, options);
  return open_ktx2(fd, options);
}

namespace {

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
  if (starts("\xabKTX 11\xbb\r\n\x1a\n"sv)) return std::string("ktx");
  if (starts("\xabKTX 20\xbb\r\n\x1a\n"sv)) return std::string("ktx2");
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
               "psd dds ktx ktx2 heif sgi)"};
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

// --- colour

// Fills in what the file's colours are; the spec's curve becomes what is taken off.
void settle_color(const ReadOptions& options, FileSpec& spec, PictureFile& file) {
  file.color = transfer_text(spec.transfer, static_cast<double>(spec.gamma));
  file.color_encoding.transfer = spec.transfer;
  file.color_encoding.gamma = static_cast<double>(spec.gamma);
  file.color_encoding.primaries = spec.primaries;
  file.color_encoding.space = space_of(file.color_encoding);
  file.color_how = !spec.color_how.empty()             ? spec.color_how
                   : spec.transfer == Transfer::linear ? "assumed for floating point"
                                                       : "assumed for integers";
  // Values of another space than the format has words for were stored as they were.
  const auto record = file.metadata.find("envconv:colorspace");
  file.as_stored = options.as_stored || (record != file.metadata.end() && record->second != file.color_encoding.space);
  if (file.as_stored) spec.transfer = Transfer::linear;
}

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
  // No run-length or Deflate stream packs tighter than this; Zstandard packs a plain colour, of which a block of 128 kB
  // takes 4 bytes, tighter, and PIZ, DWA and the wavelet formats know no bound.
  const std::string& c = spec.compression;
  const bool tight =
      c == "piz" || c == "dwaa" || c == "dwab" || format == "webp" || format == "jpeg2000" || format == "heif";
  const double densest = c == "zstd" ? 1e5 : 1e4;
  if (!options.trust_input && !tight && bytes > 1e6 && bytes > densest * static_cast<double>(file_size)) {
    return Error{ErrorCode::input, "claims " + std::to_string(static_cast<std::int64_t>(bytes / 1e6)) +
                                       " MB of pixels in a file of " + std::to_string(file_size) +
                                       " bytes (--trust-input reads it all the same)"};
  }
  return Ok{};
}

// --- pixels --------------------------------------------------------------------------------------------------------

bool drops_alpha(const PictureSpec& p, const ReadOptions& options) {
  return options.drop_alpha && p.channels.alpha >= 0 && p.channels.count() > 1;
}

Result<std::unique_ptr<PixelSource>> open_source(const std::string& format, int fd, const DecoderOptions& how,
                                                 bool trusted) {
  if (!trusted) return open_isolated(format, fd, how);
  ENVCONV_TRY(std::unique_ptr<Decoder> decoder, open_decoder(format, fd, how));
  if (!decoder) {
    DecoderOptions library = how;
    library.library = true;
    ENVCONV_TRY(decoder, open_decoder(format, fd, library));
  }
  return std::unique_ptr<PixelSource>(std::move(decoder));
}

// The pixels of an image, some megabytes at a time: while these are made linear, a child decodes the next ones.
Result<Ok> decode_bands(PixelSource& source, const PictureSpec& p, int number, bool trusted, const ToLinear* linear,
                        Image& image) {
  const int band = rows_at_a_time(p);
  std::unique_ptr<void, FreeBytes> elements;
  if (linear) {
    elements.reset(std::malloc(bytes_of_rows(p, band)));
    if (!elements) throw std::bad_alloc();
  }
  for (int first = 0; first < p.height; first += band) {
    const int rows = std::min(band, p.height - first);
    image.relieve();
    void* to = linear ? elements.get() : image.row(first);
    // What a damaged chunk leaves out is black, not whatever was in memory.
    if (trusted) std::memset(to, 0, bytes_of_rows(p, rows));
    ENVCONV_CHECK(source.decode_rows(number, first, rows, to));
    if (linear) linear->rows(elements.get(), first, rows, image);
  }
  return Ok{};
}

// Gives the image, which has a size, its pixels.  `spec` is the source's, with its colours settled.
Result<Ok> decode_picture(PixelSource& source, const FileSpec& spec, int number, const ReadOptions& options,
                          Image& image) {
  const PictureSpec& p = spec.pictures[static_cast<std::size_t>(number)];
  const bool drop_alpha = drops_alpha(p, options);
  std::optional<ToLinear> linear;
  if (!ToLinear::is_identity(p, spec, drop_alpha)) linear.emplace(p, spec, drop_alpha);
  if (options.scratch || source.in_bands()) {
    image = Image(image.width(), image.height(), image.channels(), options.scratch);
    return decode_bands(source, p, number, options.trust_input, linear ? &*linear : nullptr, image);
  }
  ENVCONV_TRY(MappedMemory elements, source.pixels(number));
  if (!linear) {
    image = Image::adopt(image.width(), image.height(), image.channels(), std::move(elements));
    return Ok{};
  }
  image = Image(image.width(), image.height(), image.channels());
  // What has become floats is given back, so that there are never two pictures in memory.
  constexpr std::size_t kAtOnce = std::size_t{16} << 20, kPage = 4096;
  const int rows_at_once =
      static_cast<int>(std::min<std::size_t>(kAtOnce / bytes_of_rows(p, 1) + 1, static_cast<std::size_t>(p.height)));
  auto* const bytes = static_cast<char*>(elements.data());
  std::size_t forgotten = 0;
  for (int first = 0; first < p.height; first += rows_at_once) {
    const int rows = std::min(rows_at_once, p.height - first);
    linear->rows(bytes + bytes_of_rows(p, first), first, rows, image);
    const std::size_t done = bytes_of_rows(p, first + rows) / kPage * kPage;
    forget_pages(bytes + forgotten, done - forgotten);
    forgotten = done;
  }
  return Ok{};
}

}  // namespace

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
  how.level = options.level;
  auto opened = open_source(*format, fd.get(), how, options.trust_input);
  if (!opened) return on(path, opened.error());
  PixelSource& source = **opened;
  FileSpec spec = source.spec();
  if (options.level < 0 || options.level >= spec.levels) {
    return on(path, ErrorCode::input,
              "has no level " + std::to_string(options.level) + " (its levels are 0 to " +
                  std::to_string(spec.levels - 1) + ")");
  }
  const auto claims = check_claims(spec, *format, options, info.st_size);
  if (!claims) return on(path, claims.error());

  PictureFile file;
  file.path = path;
  file.format = *format;
  file.compression = spec.compression;
  file.levels = spec.levels;
  file.level = options.level;
  file.metadata = spec.metadata;
  const auto description = file.metadata.find("ImageDescription");
  if (description != file.metadata.end()) {
    const std::string line = description->second;
    file.metadata.erase(description);
    split_metadata(line, file.metadata);
  }
  settle_color(options, spec, file);
  for (const std::string& warning : spec.warnings) file.warnings.push_back(printable(path) + ": " + warning);
  for (const PictureSpec& p : spec.pictures) {
    Picture picture;
    picture.name = p.name;
    picture.channels = p.channels;
    picture.type = p.type;
    if (drops_alpha(p, options)) {
      picture.channels.names.erase(picture.channels.names.begin() + p.channels.alpha);
      picture.channels.alpha = -1;
    }
    const bool turned = spec.orientation >= 5;
    picture.image =
        Image::without_pixels(turned ? p.height : p.width, turned ? p.width : p.height, picture.channels.count());
    file.pictures.push_back(std::move(picture));
  }
  if (options.header_only) return file;
  if (options.accept) ENVCONV_CHECK(options.accept(file));
  for (std::size_t i = 0; i < spec.pictures.size(); ++i) {
    const auto decoded = decode_picture(source, spec, static_cast<int>(i), options, file.pictures[i].image);
    if (!decoded) return on(path, decoded.error());
  }
  return file;
}

Result<PictureFile> read_pictures(const std::string& path, const ReadOptions& options) {
  return guarded<PictureFile>(path, ErrorCode::input, [&] { return read_file(path, options); });
}

}  // namespace envconv
