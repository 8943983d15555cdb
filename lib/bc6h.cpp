// SPDX-License-Identifier: Apache-2.0
#include "bc6h.h"

#include <half.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "bc6h_format.h"

namespace envconv {
namespace {

using bc6h::Block;
using Texels = std::array<std::array<int, 3>, 16>;  // half bit patterns

int half_bits(float value) {
  if (!(value > 0)) return 0;  // NaN too
  return Imath::half(std::min(value, 65504.f)).bits();
}

// The block at (4 bx, 4 by), its last column and row continued where the image ends.
Texels gather(const Image& image, int bx, int by) {
  Texels out;
  const int step = image.channels() >= 3 ? 1 : 0;
  for (int t = 0; t < 16; ++t) {
    const float* from =
        image.at(std::min(4 * bx + t % 4, image.width() - 1), std::min(4 * by + t / 4, image.height() - 1));
    for (int c = 0; c < 3; ++c)
      out[static_cast<std::size_t>(t)][static_cast<std::size_t>(c)] = half_bits(from[c * step]);
  }
  return out;
}

constexpr int one_region = 10;  // the mode of 10 bits and one region

// The stored number whose half bit pattern is nearest.
int quantize(int half_bits, int bits) {
  const int top = (1 << bits) - 1;
  return std::clamp((half_bits * 64 / 31 << bits) >> 16, 0, top);
}

// End points at the corners of the bounding box, the diagonal chosen by the correlation with green.
Block encode_one_region(const Texels& texels) {
  Block block{};
  block.mode = one_region;
  const int bits = bc6h::modes[one_region].end_bits;
  std::array<int, 3> low = texels[0], high = texels[0];
  std::array<double, 3> mean{}, with_green{};
  for (const auto& texel : texels)
    for (std::size_t c = 0; c < 3; ++c) {
      low[c] = std::min(low[c], texel[c]);
      high[c] = std::max(high[c], texel[c]);
      mean[c] += texel[c] / 16.0;
    }
  for (const auto& texel : texels)
    for (std::size_t c = 0; c < 3; ++c) with_green[c] += (texel[c] - mean[c]) * (texel[1] - mean[1]);
  std::array<std::array<int, 3>, 2> ends;
  for (std::size_t c = 0; c < 3; ++c) {
    if (with_green[c] < 0) std::swap(low[c], high[c]);
    block.ends[0][c] = quantize(low[c], bits);
    block.ends[1][c] = quantize(high[c], bits);
    for (std::size_t e = 0; e < 2; ++e) ends[e][c] = bc6h::unquantize(block.ends[e][c], bits);
  }
  for (std::size_t t = 0; t < 16; ++t) {
    double least = HUGE_VAL;
    for (int i = 0; i < 16; ++i) {
      double error = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        const double d =
            bc6h::to_half_bits(bc6h::interpolate(ends[0][c], ends[1][c], bc6h::weight(1, i))) - texels[t][c];
        error += d * d;
      }
      if (error < least) {
        least = error;
        block.index[t] = static_cast<std::uint8_t>(i);
      }
    }
  }
  if (block.index[0] >= 8) {  // the first texel's highest bit is not stored
    std::swap(block.ends[0], block.ends[1]);
    for (std::uint8_t& index : block.index) index = static_cast<std::uint8_t>(15 - index);
  }
  return block;
}

int blocks_along(int texels) { return (texels + 3) / 4; }

}  // namespace

std::size_t bc6h_bytes(int width, int height) {
  return static_cast<std::size_t>(blocks_along(width)) * static_cast<std::size_t>(blocks_along(height)) * 16;
}

void encode_bc6h(const Image& image, Bc6hEffort, int threads, std::uint8_t* blocks) {
  const int columns = blocks_along(image.width()), rows = blocks_along(image.height());
  tbb::task_arena arena(threads > 0 ? threads : tbb::task_arena::automatic);
  arena.execute([&] {
    tbb::parallel_for(0, rows, [&](int y) {
      std::uint8_t* to = blocks + static_cast<std::size_t>(y) * static_cast<std::size_t>(columns) * 16;
      for (int x = 0; x < columns; ++x, to += 16) bc6h::pack(encode_one_region(gather(image, x, y)), to);
    });
  });
}

void decode_bc6h(const std::uint8_t* blocks, int width, int height, bool is_signed, float* rgb) {
  for (int by = 0; by < height; by += 4)
    for (int bx = 0; bx < width; bx += 4, blocks += 16) {
      Block block;
      std::array<std::array<std::uint16_t, 3>, 16> texels{};
      if (bc6h::unpack(blocks, is_signed, block)) texels = bc6h::decode(block, is_signed);
      for (int y = 0; y < std::min(4, height - by); ++y)
        for (int x = 0; x < std::min(4, width - bx); ++x) {
          const auto& texel = texels[static_cast<std::size_t>(4 * y + x)];
          float* to = rgb + (static_cast<std::size_t>(by + y) * static_cast<std::size_t>(width) +
                             static_cast<std::size_t>(bx + x)) *
                                3;
          for (std::size_t c = 0; c < 3; ++c) to[c] = Imath::half(Imath::half::FromBits, texel[c]);
        }
    }
}

}  // namespace envconv
