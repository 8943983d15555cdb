// SPDX-License-Identifier: Apache-2.0
// Writing files: what formats hold, values to elements, and the way to the disk.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <span>

#include "dds.h"
#include "decoder.h"
#include "exr.h"
#include "hdr.h"
#include "imageio_loader.h"
#include "imageio_write.h"
#include "io_shared.h"
#include "jpeg_write.h"
#include "ktx.h"
#include "png_write.h"
#include "tiff_write.h"

namespace envconv {

ColorEncoding stored_color(const WriteOptions& options, PixelType type) {
  ColorEncoding color = options.color;
  if (is_integer(type) && options.encoding == Encoding::srgb) color.transfer = Transfer::srgb;
  return color;
}

namespace {

// --- formats that can be written -----------------------------------------------------------------------------------

constexpr int usual_png_level = 6, usual_jpeg_quality = 98;
constexpr std::string_view level_hint = "write one file a level, with {mip} in its name, or .exr, .tif, .dds or .ktx2";

struct Format {
  const char* extension;
  const char* name;              // the image library's
  std::vector<PixelType> types;  // the first is what it usually holds
  std::vector<int> channels;     // counts; empty: any
  const char* compressions;      // names, or ""
  const char* attribute;         // where our line of metadata goes, or "" when it cannot
  bool lossy;                    // by nature
  bool levels = false;           // holds MIP levels
};

const std::vector<Format>& formats() {
  using enum PixelType;
  static const std::vector<Format>* const table = new std::vector<Format>{
      {"exr", "openexr", {half, float32, uint32}, {}, "", "", false, true},
      {"hdr", "hdr", {float32}, {1, 3}, "rle", "", false},
      {"pic", "hdr", {float32}, {1, 3}, "rle", "", false},
      {"png", "png", {uint8, uint16}, {1, 2, 3, 4}, "0-9", "ImageDescription", false},
      {"tif", "tiff", {float32, half, uint16, uint8}, {}, "none lzw zip packbits", "ImageDescription", false, true},
      {"tiff", "tiff", {float32, half, uint16, uint8}, {}, "none lzw zip packbits", "ImageDescription", false, true},
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
      {"dds", "dds", {half, float32, uint8, r11g11b10f, rgb9e5, bc6h}, {}, "", "", false, true},
      {"ktx2", "ktx2", {half, float32, uint8, r11g11b10f, rgb9e5, bc6h}, {}, "", "", false, true},
      {"ktx", "ktx", {half, float32, uint8, r11g11b10f, rgb9e5, bc6h}, {}, "", "", false, true},
  };
  return *table;
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

// The text for a compression that the format has, the image library's where that writes it.
Result<std::string> compression_for(const std::string& path, const Format& format, PixelType type,
                                    const std::string& asked) {
  if (is_texture_file(format.name)) {
    const auto checked = parse_texture_compression(format.name, type, asked);
    if (!checked) return on(path, checked.error());
    return asked;
  }
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
    return format.name == std::string_view("jpeg") ? text : std::string(format.name) + ":" + text;
  }
  if (is_number && known == "0-9" && number >= 0 && number <= 9) return text;
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

// Rounds a linear value in [0, 1] to the nearest code of the sRGB curve.  The curve is tabulated where codes change, so
// the answer is that of the formula in double precision, at the price of a few comparisons.
class SrgbEncoder {
 public:
  // A range of floats, in which the code is guessed, has `shift` bits.
  explicit SrgbEncoder(int top, int shift) : top_(top), shift_(shift), changes_(static_cast<std::size_t>(top) + 1) {
    for (int code = 0; code < top; ++code) {
      changes_[static_cast<std::size_t>(code)] = static_cast<float>(srgb_to_linear((code + 0.5) / top));
    }
    changes_[static_cast<std::size_t>(top)] = 2;  // a sentinel
    const std::uint32_t last = std::bit_cast<std::uint32_t>(1.f) >> shift_;
    first_ = std::bit_cast<std::uint32_t>(kSmall) >> shift_;
    for (std::uint32_t bin = first_; bin <= last + 1; ++bin) {
      const float value = std::bit_cast<float>(bin << shift_);
      starts_.push_back(
          static_cast<std::uint16_t>(std::upper_bound(changes_.begin(), changes_.end(), value) - changes_.begin()));
    }
  }
  int operator()(float v) const {
    if (v < kSmall) return nearest(v * 12.92f * static_cast<float>(top_));
    const std::uint32_t bits = std::bit_cast<std::uint32_t>(v), bin = (bits >> shift_) - first_;
    const std::uint32_t codes = starts_[bin + 1] - std::uint32_t{starts_[bin]};
    std::size_t code = starts_[bin] + ((bits & ((1u << shift_) - 1)) * codes >> shift_);
    while (v >= changes_[code]) ++code;
    while (code > 0 && v < changes_[code - 1]) --code;
    return static_cast<int>(code);
  }
  // As std::rint(), of which there is no instruction everywhere.
  static int nearest(float v) { return static_cast<int>(std::lrint(v)); }

 private:
  static constexpr float kSmall = 0x1p-13f;
  int top_, shift_;
  std::uint32_t first_ = 0;
  std::vector<float> changes_;         // from code to code + 1
  std::vector<std::uint16_t> starts_;  // the smallest code of a range of floats
};

const SrgbEncoder& srgb_encoder(PixelType type) {
  static const SrgbEncoder eight(255, 13);  // mostly one code a range
  if (type == PixelType::uint8) return eight;
  static const SrgbEncoder sixteen(65535, 11);
  return sixteen;
}

}  // namespace

std::unique_ptr<void, FreeBytes> to_elements(const Picture& picture, PixelType type, Encoding encoding,
                                             WriteReport& report) {
  const Image& image = picture.image;
  const int channels = image.channels(), alpha = picture.channels.alpha;
  std::unique_ptr<void, FreeBytes> elements(std::malloc(std::max<std::size_t>(image.value_count() * size_of(type), 1)));
  if (!elements) throw std::bad_alloc();
  const float top = type == PixelType::uint8 ? 255.f : 65535.f;
  const SrgbEncoder& encoder = srgb_encoder(type);
  const bool as_is = encoding == Encoding::as_is;
  const double beyond = (static_cast<double>(top) + 0.5) / static_cast<double>(top);
  const float too_high = static_cast<float>(as_is ? beyond : srgb_to_linear(beyond));
  const float too_low = -0.5f / (as_is ? 1.f : 12.92f) / top;
  const std::size_t values = static_cast<std::size_t>(image.width()) * static_cast<std::size_t>(channels);
  std::atomic<std::int64_t> high{0}, negative{0}, nonfinite{0};
  tbb::parallel_for(0, image.height(), [&](int y) {
    const float* from = image.row(y);
    const std::size_t at = static_cast<std::size_t>(y) * values;
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
    const auto coded = [&](float v) { return as_is ? SrgbEncoder::nearest(clamped(v) * top) : encoder(clamped(v)); };
    const auto encode_row = [&]<class Element>(Element* to) {
      if (alpha < 0) {
        for (std::size_t i = 0; i < values; ++i) to[i] = static_cast<Element>(coded(from[i]));
        return;
      }
      for (int x = 0; x < image.width(); ++x, from += channels, to += channels) {
        const float a = from[alpha];
        for (int c = 0; c < channels; ++c) {
          // Integer formats keep colour apart from alpha; under no cover at all there is none.
          const float v = a > 0 ? from[c] / a : a == 0 ? 0.f : from[c];
          to[c] = static_cast<Element>(c == alpha ? SrgbEncoder::nearest(clamped(a) * top) : coded(v));
        }
      }
    };
    if (type == PixelType::uint8) {
      encode_row(static_cast<std::uint8_t*>(elements.get()) + at);
    } else {
      encode_row(static_cast<std::uint16_t*>(elements.get()) + at);
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

namespace {

Result<Ok> write_texture(OutputFile& file, std::span<const std::vector<Picture>> levels, const Format& format,
                         const WriteOptions& options, WriteReport& report) {
  const std::string_view name = format.name;
  ENVCONV_TRY(const TextureCompression compression, parse_texture_compression(name, report.type, options.compression));
  if (name == "dds") return write_dds(file, levels, options, compression, report);
  if (name == "ktx") return write_ktx1(file, levels, options, compression, report);
  return write_ktx2(file, levels, options, compression, report);
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

float largest_of(PixelType type, int channel) {
  if (type == PixelType::rgb9e5) return 65408;
  if (type == PixelType::r11g11b10f) return channel == 2 ? 64512 : 65024;
  return 65504;
}

// Pixels as written and as read again: within half a step of the type, or near on average when the codec is lossy.
Result<Ok> compare(const Picture& written, const Picture& read, PixelType type, Encoding encoding, bool rgbe,
                   bool lossy) {
  const Image &a = written.image, &b = read.image;
  if (a.width() != b.width() || a.height() != b.height())
    return Error{ErrorCode::output, "has another size when read back"};
  const int channels = a.channels(), alpha = written.channels.alpha;
  // Where grey became three channels: R, G, B and A have the places of Y and A.
  const int more = b.channels() - channels;
  if (more != 0 && !(more == 2 && channels <= 2)) {
    return Error{ErrorCode::output, "has other channels when read back"};
  }
  const float top = type == PixelType::uint8 ? 255.f : 65535.f;
  const auto coded = [encoding](float v) {
    const float clamped = std::clamp(v, 0.f, 1.f);
    return encoding == Encoding::as_is ? clamped : static_cast<float>(linear_to_srgb(clamped));
  };
  double difference = 0, sum = 0;
  for (int y = 0; y < a.height(); ++y) {
    a.relieve();
    for (int x = 0; x < a.width(); ++x) {
      float peak = 0;
      for (int c = 0; c < channels; ++c) peak = std::max(peak, std::abs(a.at(x, y)[c]));
      for (int c = 0; c < channels; ++c) {
        float v = a.at(x, y)[c];
        const float w = b.at(x, y)[c > 0 ? c + more : 0];
        float error, allowed;
        if (std::isnan(v)) v = type == PixelType::float32 && !rgbe ? v : 0;
        if (rgbe) {
          v = std::clamp(v, 0.f, 0x1.fep126f);
          error = std::abs(v - w);
          allowed = std::min(peak, 0x1.fep126f) * (0.51f / 128) + 1e-38f;
        } else if (type == PixelType::half) {
          v = std::clamp(v, -65504.f, 65504.f);
          error = std::abs(v - w);
          allowed = std::abs(v) * 0x1.1p-11f + 0x1.1p-25f;
        } else if (type == PixelType::r11g11b10f || type == PixelType::rgb9e5 || type == PixelType::bc6h) {
          v = std::clamp(v, 0.f, largest_of(type, c));
          error = std::abs(v - w);
          allowed = type == PixelType::rgb9e5 ? std::min(peak, 65408.f) * 0x1.01p-9f + 0x1p-25f
                    : c == 2                  ? v * 0x1.01p-6f + 0x1p-19f
                                              : v * 0x1.01p-7f + 0x1p-20f;
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

Result<Ok> verify_level(const OutputFile& file, int level, const std::vector<Picture>& pictures,
                        const WriteOptions& options, const Format& format, PixelType type) {
  ReadOptions how;
  how.max_pixels = INT64_MAX / 1024;
  // It is our own; but what a disk made of it may upset a codec, and some print.
  how.trust_input = !needs_imageio(format.name);
  how.as_stored = options.encoding == Encoding::as_is;
  how.threads = options.threads;
  how.level = level;
  how.scratch = pictures.front().image.scratch();
  auto read = read_file(file.temporary(), how);
  if (!read) {
    const ErrorCode code = read.error().code == ErrorCode::limit ? ErrorCode::limit : ErrorCode::output;
    return Error{code, "cannot be read back: " + read.error().message};
  }
  if (read->pictures.size() != pictures.size()) return Error{ErrorCode::output, "has other parts when read back"};
  const bool exr = std::string_view(format.name) == "openexr";
  const bool lossy =
      exr ? exr_compression_is_lossy(options.compression, type) : format.lossy || type == PixelType::bc6h;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    ENVCONV_CHECK(
        compare(pictures[i], read->pictures[i], type, options.encoding, std::string_view(format.name) == "hdr", lossy));
  }
  return Ok{};
}

Result<Ok> verify(const OutputFile& file, std::span<const std::vector<Picture>> levels, const WriteOptions& options,
                  const Format& format, PixelType type) {
  for (std::size_t level = 0; level < levels.size(); ++level) {
    ENVCONV_CHECK(verify_level(file, static_cast<int>(level), levels[level], options, format, type));
  }
  return Ok{};
}

Result<WriteReport> write_file(const std::string& path, std::span<const std::vector<Picture>> levels,
                               WriteOptions options) {
  if (!options.color.space.empty()) options.metadata["envconv:colorspace"] = options.color.space;
  if (levels.empty()) return on(path, ErrorCode::internal, "no level to write");
  const std::vector<Picture>& pictures = levels.front();
  if (pictures.empty()) return on(path, ErrorCode::internal, "no picture to write");
  for (const Picture& picture : pictures) {
    if (picture.image.empty() || picture.image.width() < 1 || picture.image.height() < 1) {
      return on(path, ErrorCode::internal, "a picture without pixels");
    }
    if (picture.channels.count() != picture.image.channels()) {
      return on(path, ErrorCode::internal, "a picture whose channels have no names");
    }
    ENVCONV_CHECK(can_write(path, options, static_cast<int>(pictures.size()), picture.image.channels(),
                            static_cast<int>(levels.size())));
  }
  ENVCONV_TRY(const Format* format, format_of(path));
  WriteReport report;
  ENVCONV_TRY(report.type, type_for(path, *format, options));
  ENVCONV_TRY(const std::string compression, compression_for(path, *format, report.type, options.compression));
  ENVCONV_TRY(OutputFile file, OutputFile::create(path));
  Result<Ok> done = Ok{};
  if (std::string_view(format->name) == "openexr") {
    done = write_exr(file, levels, options, report);
  } else if (std::string_view(format->name) == "hdr") {
    done = write_hdr(file, pictures.front(), options, report);
  } else if (is_texture_file(format->name)) {
    done = write_texture(file, levels, *format, options, report);
  } else if (std::string_view(format->name) == "pfm") {
    write_pfm(file, pictures.front(), options, report);
  } else if (std::string_view(format->name) == "png") {
    done = write_png(file, pictures.front(), compression.empty() ? usual_png_level : std::stoi(compression), options,
                     report);
  } else if (std::string_view(format->name) == "tiff") {
    done = write_tiff(file, levels, compression, options, report);
  } else if (std::string_view(format->name) == "jpeg") {
    done = write_jpeg(file, pictures.front(), compression.empty() ? usual_jpeg_quality : std::stoi(compression),
                      options, report);
  } else {
    done = write_imageio(file, pictures.front(), {format->name, format->extension, format->attribute, compression},
                         options, report);
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
    const auto verified = verify(file, levels, options, *format, report.type);
    if (!verified) return on(path, verified.error());
  }
  if (options.before_commit) ENVCONV_CHECK(options.before_commit());
  ENVCONV_CHECK(file.commit());
  return report;
}

}  // namespace

bool holds_faces(const std::string& path) { return is_texture_file(extension_of(path)); }

Result<Ok> can_write(const std::string& path, const WriteOptions& options, int parts, int channels, int levels) {
  return guarded<Ok>(path, ErrorCode::unsupported, [&]() -> Result<Ok> {
    ENVCONV_TRY(const Format* format, format_of(path));
    const bool texture = is_texture_file(format->name);
    if (parts > 1 && !texture && std::string_view(format->name) != "openexr") {
      return on(path, ErrorCode::unsupported, "only EXR, DDS, KTX and KTX2 hold several pictures in a file");
    }
    if (levels > 1 && !format->levels) {
      return on(path, ErrorCode::unsupported, "the format cannot hold MIP levels (" + std::string(level_hint) + ")");
    }
    ENVCONV_CHECK(check_channels(path, *format, channels));
    ENVCONV_TRY(const PixelType type, type_for(path, *format, options));
    if (texture) {
      const auto checked = check_texture(format->name, type, options.cube, parts, channels);
      if (!checked) return on(path, checked.error());
    }
    ENVCONV_CHECK(compression_for(path, *format, type, options.compression));
    return Ok{};
  });
}

Result<WriteReport> write_pictures(const std::string& path, const std::vector<Picture>& pictures,
                                   const WriteOptions& options) {
  return guarded<WriteReport>(path, ErrorCode::output, [&] { return write_file(path, {&pictures, 1}, options); });
}

Result<WriteReport> write_levels(const std::string& path, std::span<const std::vector<Picture>> levels,
                                 const WriteOptions& options) {
  return guarded<WriteReport>(path, ErrorCode::output, [&] { return write_file(path, levels, options); });
}

}  // namespace envconv
