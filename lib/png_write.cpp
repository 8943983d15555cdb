// SPDX-License-Identifier: Apache-2.0
#include "png_write.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdlib>
#include <cstring>

#include "deflate.h"
#include "in_order.h"
#include "png_color.h"
#include "stored_pixels.h"

namespace envconv {
namespace {

// What is deflated on its own, in bytes: enough that little is lost at its beginning, where nothing can be repeated.
constexpr std::size_t band_bytes = std::size_t{1} << 19;

constexpr int filter_count = 5;  // none, sub, up, average, Paeth

// The PNG specification's predictor: of left, above and above left the one that is nearest to a + b - c.
std::uint8_t paeth(int a, int b, int c) {
  const int from_a = std::abs(b - c), from_b = std::abs(a - c), from_c = std::abs(a + b - 2 * c);
  const int b_or_c = from_b <= from_c ? b : c;
  return static_cast<std::uint8_t>(from_a <= from_b && from_a <= from_c ? a : b_or_c);
}

// to[size]: a row's bytes less their predictions.  `row` and `above` have `texel` bytes of 0 in front.
void filter_row(int filter, const std::uint8_t* row, const std::uint8_t* above, std::size_t size, std::size_t texel,
                std::uint8_t* to) {
  const std::uint8_t *left = row - texel, *above_left = above - texel;
  const auto each = [&](auto predicted) {
    for (std::size_t i = 0; i < size; ++i) to[i] = static_cast<std::uint8_t>(row[i] - predicted(i));
  };
  switch (filter) {
    case 0: return each([](std::size_t) { return 0; });
    case 1: return each([=](std::size_t i) { return left[i]; });
    case 2: return each([=](std::size_t i) { return above[i]; });
    case 3: return each([=](std::size_t i) { return (left[i] + above[i]) >> 1; });
    default: return each([=](std::size_t i) { return paeth(left[i], above[i], above_left[i]); });
  }
}

// What the specification recommends as a measure of how well a filter does: bytes as signed numbers.
std::uint64_t sum_of_magnitudes(const std::uint8_t* bytes, std::size_t size) {
  std::uint64_t sum = 0;
  for (std::size_t first = 0; first < size; first += 1 << 16) {
    std::uint32_t part = 0;
    for (std::size_t i = first; i < std::min(size, first + (1 << 16)); ++i)
      part += static_cast<std::uint32_t>(std::abs(static_cast<int>(static_cast<std::int8_t>(bytes[i]))));
    sum += part;
  }
  return sum;
}

// Filters and deflates bands of rows, with buffers that are kept.
class BandPacker {
 public:
  void pack(const StoredPixels& pixels, int first, int rows, int level) {
    const std::size_t texel = pixels.texel_size(), size = pixels.row_size();
    row_.assign(texel + size, 0);
    above_.assign(texel + size, 0);
    bytes_.clear();
    if (first > 0) load(pixels, first - 1, above_.data() + texel, size);
    for (int y = first; y < first + rows; ++y) {
      load(pixels, y, row_.data() + texel, size);
      add(size, texel, level > 0 ? filter_count : 1);
      std::swap(row_, above_);
    }
    sum_ = libdeflate_adler32(1, bytes_.data(), bytes_.size());
    deflater_.part(bytes_, level, first + rows == pixels.height, deflated_);
  }
  std::span<const std::uint8_t> deflated() const { return deflated_; }
  std::size_t size() const { return bytes_.size(); }  // of the rows
  std::uint32_t sum() const { return sum_; }          // likewise, Adler-32

 private:
  // A row's bytes as the file has them.
  static void load(const StoredPixels& pixels, int y, std::uint8_t* to, std::size_t size) {
    const std::uint8_t* from = pixels.row(y);
    static_assert(std::endian::native == std::endian::little);
    if (size_of(pixels.type) == 1) {
      std::memcpy(to, from, size);
    } else {
      for (std::size_t i = 0; i < size; i += 2) to[i] = from[i + 1], to[i + 1] = from[i];
    }
  }

  // The row, by the filter that seems to suit it best.
  void add(std::size_t size, std::size_t texel, int filters) {
    int best = 0;
    std::uint64_t least = ~std::uint64_t{0};
    for (int filter = 0; filter < filters; ++filter) {
      std::vector<std::uint8_t>& filtered = filtered_[static_cast<std::size_t>(filter)];
      filtered.resize(size);
      filter_row(filter, row_.data() + texel, above_.data() + texel, size, texel, filtered.data());
      const std::uint64_t sum = sum_of_magnitudes(filtered.data(), size);
      if (sum < least) least = sum, best = filter;
    }
    const std::vector<std::uint8_t>& filtered = filtered_[static_cast<std::size_t>(best)];
    bytes_.push_back(static_cast<std::uint8_t>(best));
    bytes_.insert(bytes_.end(), filtered.begin(), filtered.end());
  }

  Deflater deflater_;
  std::vector<std::uint8_t> row_, above_, bytes_, deflated_;
  std::array<std::vector<std::uint8_t>, filter_count> filtered_;
  std::uint32_t sum_ = 1;
};

void put(OutputFile& file, const std::string& bytes) { file.write(bytes.data(), bytes.size()); }

std::string header(const StoredPixels& pixels) {
  constexpr char color_types[] = {0, 4, 2, 6};
  std::string data =
      big_endian(static_cast<std::uint32_t>(pixels.width)) + big_endian(static_cast<std::uint32_t>(pixels.height));
  data += static_cast<char>(8 * size_of(pixels.type));
  data += color_types[pixels.channels - 1];
  data.append(3, '\0');  // deflate, the five filters, not interlaced
  return "\x89PNG\r\n\x1a\n" + png_chunk("IHDR", data);
}

}  // namespace

Result<Ok> write_png(OutputFile& file, const Picture& picture, int level, const WriteOptions& options,
                     WriteReport& report) {
  const StoredPixels pixels = stored_pixels(picture, options, report);
  if (pixels.row_size() > 1 << 30) return Error{ErrorCode::unsupported, "rows are too long for PNG"};
  put(file, header(pixels));
  put(file, png_color_chunks(stored_color(options, report.type)));
  const std::string description = join_metadata(options.metadata);
  if (!description.empty()) put(file, png_chunk("tEXt", std::string("Description") + '\0' + description));
  const auto rows = static_cast<int>(
      std::clamp<std::size_t>(band_bytes / pixels.row_size(), 1, static_cast<std::size_t>(pixels.height)));
  const int bands = (pixels.height + rows - 1) / rows;
  uLong sum = 1;  // Adler-32 of all rows
  in_order<BandPacker>(
      bands,
      [&](BandPacker& packer, std::int64_t band) {
        const int first = static_cast<int>(band) * rows;
        packer.pack(pixels, first, std::min(rows, pixels.height - first), level);
      },
      [&](const BandPacker& packer, std::int64_t band) {
        sum = adler32_combine(sum, packer.sum(), static_cast<z_off_t>(packer.size()));
        std::string data = band == 0 ? "\x78\x9c" : "";  // zlib: a window of 32 KiB, the usual level
        data.append(reinterpret_cast<const char*>(packer.deflated().data()), packer.deflated().size());
        if (band + 1 == bands) data += big_endian(static_cast<std::uint32_t>(sum));
        put(file, png_chunk("IDAT", data));
      });
  put(file, png_chunk("IEND", ""));
  return Ok{};
}

}  // namespace envconv
