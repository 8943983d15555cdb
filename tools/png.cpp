// SPDX-License-Identifier: Apache-2.0
// PNG: ISO/IEC 15948.  The image library writes files only, and these pictures never are one.
#include "png.h"

#include <zlib.h>

#include <algorithm>
#include <cmath>

#include "io_shared.h"
#include "output_file.h"

namespace envconv::tool {
namespace {

using Bytes = std::vector<std::uint8_t>;

void put_word(Bytes& out, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) out.push_back(static_cast<std::uint8_t>(value >> shift));
}

void put_chunk(Bytes& out, std::string_view kind, const Bytes& content) {
  put_word(out, static_cast<std::uint32_t>(content.size()));
  const std::size_t start = out.size();
  out.insert(out.end(), kind.begin(), kind.end());
  out.insert(out.end(), content.begin(), content.end());
  put_word(out, static_cast<std::uint32_t>(crc32(0, out.data() + start, static_cast<uInt>(out.size() - start))));
}

std::uint8_t encoded(float linear) {
  const double v = linear > 0 ? std::min(static_cast<double>(linear), 1.0) : 0.0;
  return static_cast<std::uint8_t>(std::lround(255 * linear_to_srgb(v)));
}

// Rows, each after the filter's number: 1, every byte less the one of the pixel on the left.
Bytes filtered_rows(const Image& image) {
  constexpr int channels = 3;
  Bytes rows;
  rows.reserve((static_cast<std::size_t>(image.width()) * channels + 1) * static_cast<std::size_t>(image.height()));
  for (int y = 0; y < image.height(); ++y) {
    rows.push_back(1);
    std::uint8_t left[channels] = {};
    const float* p = image.row(y);
    for (int i = 0; i < image.width() * channels; ++i, ++p) {
      const std::uint8_t value = encoded(*p);
      rows.push_back(static_cast<std::uint8_t>(value - left[i % channels]));
      left[i % channels] = value;
    }
  }
  return rows;
}

}  // namespace

std::vector<std::uint8_t> png_of(const Image& image) {
  ENVCONV_ASSERT(image.channels() == 3);
  Bytes out{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  Bytes head;
  put_word(head, static_cast<std::uint32_t>(image.width()));
  put_word(head, static_cast<std::uint32_t>(image.height()));
  head.insert(head.end(), {8, 2, 0, 0, 0});  // 8 bits, RGB, deflate, filters by row, not interlaced
  put_chunk(out, "IHDR", head);
  put_chunk(out, "sRGB", {0});  // perceptual intent
  const Bytes rows = filtered_rows(image);
  uLongf size = compressBound(static_cast<uLong>(rows.size()));
  Bytes packed(size);
  compress2(packed.data(), &size, rows.data(), static_cast<uLong>(rows.size()), Z_DEFAULT_COMPRESSION);
  packed.resize(size);
  put_chunk(out, "IDAT", packed);
  put_chunk(out, "IEND", {});
  return out;
}

std::string base64(std::span<const std::uint8_t> bytes) {
  constexpr std::string_view letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    const std::size_t n = std::min<std::size_t>(3, bytes.size() - i);
    for (std::size_t k = 0; k < 3; ++k) group = group << 8 | (k < n ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += k <= n ? letters[group >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

Result<Ok> write_text_file(const std::string& path, std::string_view text) {
  ENVCONV_TRY(OutputFile file, OutputFile::create(path));
  file.write(text.data(), text.size());
  return file.commit();
}

}  // namespace envconv::tool
