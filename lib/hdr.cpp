// SPDX-License-Identifier: Apache-2.0
#include "hdr.h"

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
#include <cstring>
#include <limits>
#include <string_view>

namespace envconv {
namespace {

Error bad_input(std::string what) { return {ErrorCode::input, std::move(what)}; }

// Bytes of a file, one after the other.
class Bytes {
 public:
  explicit Bytes(int fd) : fd_(fd), buffer_(1 << 16) {}
  // -1 at the end.
  int get() { return next_ < filled_ || fill() ? buffer_[next_++] : -1; }
  bool get(unsigned char* to, std::size_t count) {
    while (count > 0) {
      if (next_ == filled_ && !fill()) return false;
      const std::size_t part = std::min(count, filled_ - next_);
      std::memcpy(to, buffer_.data() + next_, part);
      next_ += part;
      to += part;
      count -= part;
    }
    return true;
  }
  int error() const { return error_; }

 private:
  bool fill() {
    for (;;) {
      const ssize_t n = ::pread(fd_, buffer_.data(), buffer_.size(), position_);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) error_ = errno;
      next_ = filled_ = 0;
      if (n <= 0) return false;
      filled_ = static_cast<std::size_t>(n);
      position_ += n;
      return true;
    }
  }

  int fd_;
  off_t position_ = 0;
  std::vector<unsigned char> buffer_;
  std::size_t next_ = 0, filled_ = 0;
  int error_ = 0;
};

template <class T>
bool parse(std::string_view& text, T& value) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ec != std::errc()) return false;
  text.remove_prefix(static_cast<std::size_t>(result.ptr - text.data()));
  return true;
}

// 2^(e - 136), the weight of a mantissa's unit; 0 for e = 0, which is black.
const std::array<float, 256>& weights() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> t{};
    for (int e = 1; e < 256; ++e) t[static_cast<std::size_t>(e)] = std::ldexp(1.f, e - 136);
    return t;
  }();
  return table;
}

class HdrDecoder final : public Decoder {
 public:
  explicit HdrDecoder(int fd) : bytes_(fd) {}

  Result<Ok> open(const DecoderOptions& options) {
    std::string line;
    if (!get_line(line) || line.compare(0, 2, "#?") != 0) return bad_input("not a Radiance picture");
    int lines = 0;
    for (;;) {
      if (!get_line(line) || ++lines > 10000) return ended();
      if (line.empty()) break;
      if (line[0] == '#') continue;
      const std::size_t equals = line.find('=');
      if (equals == std::string::npos) continue;
      const std::string name = line.substr(0, equals);
      std::string_view value = std::string_view(line).substr(equals + 1);
      if (name == "FORMAT") {
        if (value.find("32-bit_rle_xyze") != std::string_view::npos) {
          return bad_input(
              "a Radiance picture in XYZ colour, which is not supported (convert it to RGB with ra_xyze -r)");
        }
        if (value.find("32-bit_rle_rgbe") == std::string_view::npos) {
          return bad_input("a Radiance picture of unknown format \"" + printable(std::string(value.substr(0, 64))) +
                           "\"");
        }
      } else if (name == "EXPOSURE" || name == "COLORCORR") {
        // Pixels were multiplied by all of these; a second one comes on top of the first.
        float factor[3] = {1, 1, 1};
        bool good = parse(value, factor[0]);
        if (name == "EXPOSURE") {
          factor[1] = factor[2] = factor[0];
        } else {
          good = good && parse(value, factor[1]) && parse(value, factor[2]);
        }
        for (int c = 0; c < 3 && good; ++c) {
          if (!(factor[c] > 0) || !std::isfinite(factor[c])) good = false;
        }
        if (!good) return bad_input("damaged: a bad " + name + " line");
        for (int c = 0; c < 3; ++c) exposure_[c] *= static_cast<double>(factor[c]);
      } else if (name == "PRIMARIES") {
        // Red, green, blue and white; some programs write zeros.
        std::array<double, 8> xy{};
        bool good = true;
        for (double& v : xy) good = good && parse(value, v);
        spec_.primaries = good ? usable_primaries(xy) : std::nullopt;
        spec_.color_how = spec_.primaries ? "PRIMARIES" : "";
      } else if (name.compare(0, 8, "envconv:") == 0 && spec_.metadata.size() < 64) {
        spec_.metadata[name] = std::string(value);
      }
    }
    if (!get_line(line)) return ended();
    char axis[2] = {}, sign[2] = {};
    std::int64_t size[2] = {};
    std::string_view rest = line;
    for (int k = 0; k < 2; ++k) {
      while (!rest.empty() && rest.front() == ' ') rest.remove_prefix(1);
      if (rest.size() < 3) return bad_input("truncated or damaged: no resolution");
      sign[k] = rest[0];
      axis[k] = rest[1];
      rest.remove_prefix(2);
      if (!parse(rest, size[k])) return bad_input("truncated or damaged: no resolution");
    }
    if (rest.find_first_not_of(' ') != std::string_view::npos) return bad_input("truncated or damaged: no resolution");
    const std::string form{sign[0], axis[0], sign[1], axis[1]};
    // What the first stored row and the first stored column show, as Exif numbers it.
    const std::pair<const char*, int> forms[] = {{"-Y+X", 1}, {"-Y-X", 2}, {"+Y-X", 3}, {"+Y+X", 4},
                                                 {"+X-Y", 5}, {"-X-Y", 6}, {"-X+Y", 7}, {"+X+Y", 8}};
    spec_.orientation = 0;
    for (const auto& [text, orientation] : forms) {
      if (form == text) spec_.orientation = orientation;
    }
    if (spec_.orientation == 0) return bad_input("truncated or damaged: no resolution");
    if (size[0] < 1 || size[1] < 1) return bad_input("an empty image");
    if (size[0] > std::numeric_limits<int>::max() || size[1] > std::numeric_limits<int>::max() ||
        size[0] > options.max_pixels / size[1]) {
      return too_many_pixels(size[1], size[0], options.max_pixels);
    }
    PictureSpec picture;
    picture.width = static_cast<int>(size[1]);
    picture.height = static_cast<int>(size[0]);
    picture.channels = {{"R", "G", "B"}, -1};
    spec_.compression = "rle";
    picture.band = band_rows(picture, 1);
    spec_.pictures.push_back(picture);
    return Ok{};
  }

  const FileSpec& spec() const override { return spec_; }

  Result<Ok> decode(int, void* pixels) override { return decode_rows(0, 0, spec_.pictures[0].height, pixels); }

  Result<Ok> decode_rows(int, int, int count, void* pixels) override {
    const auto width = static_cast<std::size_t>(spec_.pictures[0].width);
    std::vector<unsigned char> row(width * 4);
    auto* to = static_cast<float*>(pixels);
    const std::array<float, 256>& weight = weights();
    const bool plain = exposure_[0] == 1 && exposure_[1] == 1 && exposure_[2] == 1;
    for (int y = 0; y < count; ++y, ++rows_) {
      if (!get_row(row, width)) return ended();
      for (std::size_t x = 0; x < width; ++x, to += 3) {
        const unsigned char* p = row.data() + 4 * x;
        const float w = weight[p[3]];
        for (int c = 0; c < 3; ++c) {
          to[c] = static_cast<float>(p[c]) * w;
          if (!plain) to[c] = static_cast<float>(to[c] / exposure_[c]);
        }
      }
    }
    // Some bytes behind the picture do no harm; a row more tells that the rows are not what they should be.
    if (rows_ == spec_.pictures[0].height && get_row(row, width))
      return bad_input("truncated or damaged: it goes on behind its last row");
    return Ok{};
  }

 private:
  Error ended() const {
    if (bytes_.error() != 0) return bad_input(std::string("cannot be read: ") + std::strerror(bytes_.error()));
    return bad_input("truncated or damaged: it ends or breaks off inside the picture");
  }

  // Lines end with \n or \r\n.
  bool get_line(std::string& line) {
    line.clear();
    for (;;) {
      const int c = bytes_.get();
      if (c < 0 || line.size() > 65536) return false;
      if (c == '\n') break;
      line += static_cast<char>(c);
    }
    if (!line.empty() && line.back() == '\r') line.pop_back();
    return true;
  }

  bool get_row(std::vector<unsigned char>& row, std::size_t width) {
    unsigned char start[4];
    if (!bytes_.get(start, 4)) return false;
    if (width >= 8 && width < 32768 && start[0] == 2 && start[1] == 2 && start[2] < 128) {
      if (static_cast<std::size_t>(start[2]) * 256 + start[3] != width) return false;
      for (std::size_t c = 0; c < 4; ++c) {
        for (std::size_t x = 0; x < width;) {
          int count = bytes_.get();
          if (count < 0) return false;
          const bool run = count > 128;
          if (run) count -= 128;
          if (count == 0 || static_cast<std::size_t>(count) > width - x) return false;
          int value = run ? bytes_.get() : 0;
          for (int k = 0; k < count; ++k, ++x) {
            if (!run) value = bytes_.get();
            if (value < 0) return false;
            row[4 * x + c] = static_cast<unsigned char>(value);
          }
        }
      }
      return true;
    }
    // Flat, with the old kind of runs: (1, 1, 1, n) repeats the pixel before it, a run after a run counts in 256s.
    int shift = 0;
    for (std::size_t x = 0; x < width;) {
      unsigned char pixel[4];
      if (x == 0 && shift == 0) {
        std::memcpy(pixel, start, 4);
      } else if (!bytes_.get(pixel, 4)) {
        return false;
      }
      if (pixel[0] == 1 && pixel[1] == 1 && pixel[2] == 1) {
        if (x == 0 || shift > 16) return false;
        const std::size_t count = static_cast<std::size_t>(pixel[3]) << shift;
        if (count > width - x) return false;
        for (std::size_t k = 0; k < count; ++k, ++x) std::memcpy(&row[4 * x], &row[4 * x - 4], 4);
        shift += 8;
      } else {
        std::memcpy(&row[4 * x], pixel, 4);
        ++x;
        shift = 0;
      }
    }
    return true;
  }

  Bytes bytes_;
  FileSpec spec_;
  int rows_ = 0;  // delivered
  double exposure_[3] = {1, 1, 1};
};

// The largest value of the format: 255 * 2^(255 - 136).
constexpr float kLargest = 255.f * 0x1p119f;

void encode(const float v[3], unsigned char out[4]) {
  const float top = std::max(v[0], std::max(v[1], v[2]));
  if (!(top >= 0x1p-128f)) {
    std::memset(out, 0, 4);
    return;
  }
  // In double precision powers of two are exact, and adding 2^52 rounds to whole numbers, ties to even: what frexp,
  // ldexp and rint would do in a third of the time.
  const auto rounded = [](double x) { return (x + 0x1p52) - 0x1p52; };
  int exponent = static_cast<int>(std::bit_cast<std::uint64_t>(static_cast<double>(top)) >> 52) - 1022;
  const auto unit = [&] { return std::bit_cast<double>(static_cast<std::uint64_t>(1023 + 8 - exponent) << 52); };
  // Rounding to 256 needs the next exponent.
  if (rounded(static_cast<double>(top) * unit()) > 255) ++exponent;
  const double scale = unit();
  for (int c = 0; c < 3; ++c) out[c] = static_cast<unsigned char>(rounded(static_cast<double>(v[c]) * scale));
  out[3] = static_cast<unsigned char>(std::clamp(exponent + 128, 0, 255));
}

void encode_channel(const unsigned char* row, std::size_t width, std::size_t channel, std::vector<unsigned char>& out) {
  const auto at = [&](std::size_t x) { return row[4 * x + channel]; };
  for (std::size_t x = 0; x < width;) {
    // The next run that is worth its two bytes, and the plain bytes before it.
    std::size_t run_start = x, run = 0;
    while (run_start < width) {
      run = 1;
      while (run_start + run < width && run < 127 && at(run_start + run) == at(run_start)) ++run;
      if (run >= 4) break;
      run_start += run;
    }
    while (x < std::min(run_start, width)) {
      const std::size_t count = std::min<std::size_t>(128, std::min(run_start, width) - x);
      out.push_back(static_cast<unsigned char>(count));
      for (std::size_t k = 0; k < count; ++k) out.push_back(at(x + k));
      x += count;
    }
    if (x < width) {
      out.push_back(static_cast<unsigned char>(128 + run));
      out.push_back(at(x));
      x += run;
    }
  }
}

}  // namespace

Result<std::unique_ptr<Decoder>> open_hdr(int fd, const DecoderOptions& options) {
  auto decoder = std::make_unique<HdrDecoder>(fd);
  ENVCONV_CHECK(decoder->open(options));
  return std::unique_ptr<Decoder>(std::move(decoder));
}

Result<Ok> write_hdr(OutputFile& file, const Picture& picture, const WriteOptions& options, WriteReport& report) {
  const Image& image = picture.image;
  const auto width = static_cast<std::size_t>(image.width());
  std::string header = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n";
  for (const auto& [name, value] : options.metadata) {
    if (name.compare(0, 8, "envconv:") == 0) header += name + "=" + printable(value) + "\n";
  }
  if (options.color.transfer == Transfer::linear && options.color.primaries && image.channels() == 3) {
    header += "PRIMARIES=";
    for (const double v : chromaticity_values(*options.color.primaries)) {
      char text[32];
      header.append(text, std::to_chars(text, text + sizeof text, v, std::chars_format::general, 6).ptr) += ' ';
    }
    header.back() = '\n';
  }
  header += "\n-Y " + std::to_string(image.height()) + " +X " + std::to_string(image.width()) + "\n";
  file.write(header.data(), header.size());
  std::atomic<std::int64_t> high{0}, negative{0}, nonfinite{0};
  constexpr int kBand = 64;
  std::array<std::vector<unsigned char>, kBand> rows;
  for (int top = 0; top < image.height(); top += kBand) {
    const int count = std::min(kBand, image.height() - top);
    tbb::parallel_for(0, count, [&](int k) {
      std::vector<unsigned char> row(width * 4);
      const float* from = image.row(top + k);
      std::int64_t too_high = 0, below = 0, odd = 0;
      for (std::size_t x = 0; x < width; ++x, from += image.channels()) {
        float v[3];
        for (int c = 0; c < 3; ++c) {
          v[c] = from[image.channels() == 3 ? c : 0];
          const bool counted = c < image.channels();
          if (!(v[c] >= 0)) {
            (std::isfinite(v[c]) ? below : odd) += counted;
            v[c] = 0;
          } else if (v[c] > kLargest) {
            (std::isfinite(v[c]) ? too_high : odd) += counted;
            v[c] = kLargest;
          }
        }
        encode(v, row.data() + 4 * x);
      }
      high += too_high;
      negative += below;
      nonfinite += odd;
      std::vector<unsigned char>& out = rows[static_cast<std::size_t>(k)];
      out.clear();
      if (width < 8 || width > 32767) {
        // Flat.  No pixel looks like a run, (1, 1, 1, n): the largest mantissa is 128 or more, or all are 0.
        out = std::move(row);
        return;
      }
      out.insert(out.end(), {2, 2, static_cast<unsigned char>(width >> 8), static_cast<unsigned char>(width & 255)});
      for (std::size_t c = 0; c < 4; ++c) encode_channel(row.data(), width, c, out);
    });
    for (int k = 0; k < count; ++k)
      file.write(rows[static_cast<std::size_t>(k)].data(), rows[static_cast<std::size_t>(k)].size());
  }
  report.clamped_high += high;
  report.clamped_negative += negative;
  report.nonfinite += nonfinite;
  return Ok{};
}

}  // namespace envconv
