// SPDX-License-Identifier: Apache-2.0
// BC6H of images.  How a block is encoded (bc6h_search.cpp, bc6h_lanes-inl.h):
//
// A block of 4x4 texels is one line, or two over one of 32 partitions of the texels, in the space of half bit patterns;
// each texel has the index of a point on its line.  What is sought is the mode, the partition, the end points and the
// indices of least error, in the metric that bc6h_lanes-inl.h explains.
//
//  1. The 32 partitions are ranked by the variance across their regions' principal axes, which no index can express.
//  2. In the most promising ones, and with one region, texels are projected on the axes, which gives indices, for which
//     least squares give end points.  With the end points' best values known, what each mode's rounding and its reach
//     of differences adds to the error is a quadratic form, so all modes are compared without decoding anything.
//  3. The best mode is tried in earnest: end points rounded (the second one to suit the first), indices chosen among
//     all, the error that of a decoder's output bit for bit.  Partitions that do well go on: from several starts that
//     put the texels on a part of the line only (coarsely rounded end points hit better from afar), the other way round
//     (differences may reach from one end point and not from the other) or on other lines, with least squares for the
//     indices found.
//  4. The end points of the best encoding move by single steps as long as that helps.
//
// What bounds it: steps 2 to 4 end in local minima.  Against trying all modes and partitions from many starts, each
// followed by a descent, the loss over some 200 blocks of each of six panoramas is at most 0.55 dB and on average 0.3
// (fast), 0.25 and 0.03 dB (normal), 0.05 and -0.07 dB (best: that search has its own local minima).  The format
// itself is coarse where a block holds black and a sun: 16 levels over up to 30 octaves, or 8 with end points rounded
// to half octaves; such blocks alone can move a panorama's mean by some percent.
#include "bc6h.h"

#include <half.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>

#include "bc6h_format.h"
#include "bc6h_search.h"

namespace envconv {
namespace {

using bc6h::Block;
using bc6h::most_blocks;
using bc6h::most_spans;
using bc6h::Settings;
using bc6h::Texels;

Settings settings_of(Bc6hEffort effort) {
  switch (effort) {
    case Bc6hEffort::fast:
      return {.partitions = 8,
              .survivors = 1,
              .spans = most_spans,
              .modes = 1,
              .refinements = 1,
              .polish = 0,
              .reach = 1,
              .other_lines = false};
    case Bc6hEffort::normal: break;
    case Bc6hEffort::best:
      return {.partitions = 32,
              .survivors = 8,
              .spans = most_spans,
              .modes = 3,
              .refinements = 3,
              .polish = 4,
              .reach = 4,
              .other_lines = true};
  }
  return {.partitions = 20,
          .survivors = 3,
          .spans = most_spans,
          .modes = 1,
          .refinements = 1,
          .polish = 1,
          .reach = 2,
          .other_lines = true};
}

// Block (column, row) of the image, its last column and row going on where the image ends.
void gather(const Image& image, int column, int row, int block, Texels& texels) {
  const int step = image.channels() >= 3 ? 1 : 0;
  for (int y = 0; y < 4; ++y) {
    const float* from = image.row(std::min(4 * row + y, image.height() - 1));
    for (int x = 0; x < 4; ++x) {
      const float* texel = from + std::min(4 * column + x, image.width() - 1) * image.channels();
      for (int c = 0; c < 3; ++c) texels.radiance[4 * y + x][c][block] = texel[c * step];
    }
  }
}

int blocks_along(int texels) { return (texels + 3) / 4; }

}  // namespace

std::size_t bc6h_bytes(int width, int height) {
  return static_cast<std::size_t>(blocks_along(width)) * static_cast<std::size_t>(blocks_along(height)) * 16;
}

void encode_bc6h(const Image& image, Bc6hEffort effort, int threads, std::uint8_t* blocks) {
  const int columns = blocks_along(image.width()), count = columns * blocks_along(image.height());
  const Settings settings = settings_of(effort);
  tbb::task_arena arena(threads > 0 ? threads : tbb::task_arena::automatic);
  arena.execute([&] {
    tbb::parallel_for(0, (count + most_blocks - 1) / most_blocks, [&](int batch) {
      const int first = batch * most_blocks, n = std::min(most_blocks, count - first);
      Texels texels;
      for (int i = 0; i < most_blocks; ++i) {
        const int block = first + std::min(i, n - 1);
        gather(image, block % columns, block / columns, i, texels);
      }
      std::array<Block, most_blocks> found;
      bc6h::search(texels, n, settings, found.data());
      for (int i = 0; i < n; ++i)
        bc6h::pack(found[static_cast<std::size_t>(i)], blocks + static_cast<std::size_t>(first + i) * 16);
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
