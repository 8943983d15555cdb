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
//     of differences adds to the error is a quadratic form, so all modes are compared without decoding anything.  So
//     are all the parts of a line that texels could be put on, each region for itself: end points of few bits hit some
//     better than others, and with texels nearly alike nothing else decides.
//  3. The best mode is tried in earnest: end points rounded (the second one to suit the first), indices chosen among
//     all, the error that of a decoder's output bit for bit.  Partitions that do well go on: from several starts that
//     put the texels on a part of the line only, the other way round (differences may reach from one end point and not
//     from the other) or on other lines, with least squares for the indices found.  Two regions do best from different
//     starts, so what each did best with is put together.
//  4. The end points of the best encoding move by small steps as long as that helps.
//
// How far each step goes depends on the effort, and on the block: where one holds much of its neighbourhood's error, a
// miss is what the neighbourhood loses, so such blocks are searched again and harder.
//
// What bounds it: steps 2 to 4 end in local minima.  Against trying all modes and partitions from many starts, each
// followed by a descent (which ends in local minima, too), over 420 crops of 16x16 texels of eleven panoramas, most of
// them picked where the loss was largest: on average 0.1 dB are lost (fast) or 0.5 dB gained (normal).  6 of the crops
// lose more than 0.5 dB (normal), at most 1.0 dB and 1.3 dB where errors are about the rounding of halves.
// tests/bench/BC6H.md has crops that were not picked.
//
// The format is coarse where a block holds black and a sun: 16 levels over up to 30 octaves, or 8 with end points
// rounded to half octaves.  Two or three such blocks moved the mean of a panorama by up to 13 percent in a channel,
// hardly seen in the logarithm.  The mean is what lights a scene, black is what is looked at: so blocks whose sums of
// radiance matter to the image's pay for what these are off, all at one price, and are searched again.  Of eleven
// panoramas the means of channels are off by at most 0.54 percent then (fast: 0.93), 0.12 dB being paid at most (0.03
// on average).
#include "bc6h.h"

#include <half.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <span>
#include <vector>

#include "bc6h_format.h"
#include "bc6h_search.h"

namespace envconv {
namespace {

using bc6h::Block;
using bc6h::Found;
using bc6h::most_blocks;
using bc6h::most_spans;
using bc6h::Settings;
using bc6h::Texels;

// A search of the blocks that have at least this share of the error of some square of 4x4 blocks.
struct Pass {
  double share;
  Settings settings;
};

constexpr Settings quick{.partitions = 4, .spans = {1, 3}, .combined = {20, 20}, .refinements = 1};
constexpr Settings brief{.partitions = 20,
                         .first_spans = 2,
                         .spans = {2, 6},
                         .combined = {60, 28},
                         .refinements = 1,
                         .exchanges = 1,
                         .polish = 1,
                         .reach = 1};
constexpr Settings usual{.partitions = 10,
                         .first_spans = 2,
                         .survivors = 2,
                         .spans = {2, 3},
                         .combined = {60, 28},
                         .refinements = 1,
                         .polish = 1,
                         .reach = 1};
constexpr Settings careful{.partitions = 32,
                           .first_spans = 3,
                           .survivors = 3,
                           .spans = {4, most_spans},
                           .combined = {90, 28},
                           .combined_modes = 2,
                           .refinements = 1,
                           .exchanges = 1,
                           .polish = 1,
                           .reach = 2};
constexpr Settings thorough{.partitions = 32,
                            .first_spans = 3,
                            .survivors = 4,
                            .spans = {most_spans, most_spans},
                            .combined = {60, 40},
                            .combined_modes = 3,
                            .refinements = 2,
                            .exchanges = 1,
                            .other_lines = true,
                            .polish = 2,
                            .reach = 2,
                            .polish_all = true};
constexpr Settings thorough_in(int survivors) {
  Settings settings = thorough;
  settings.survivors = survivors;
  return settings;
}
// Where a block is nearly all of its neighbourhood's error: modes that estimates put behind others, too.
constexpr Settings decisive = [] {
  Settings settings = thorough;
  settings.combined_modes = 4;
  settings.refinements = 4;
  return settings;
}();

// What the image's mean is worth: to have it right by one percent, this percentage of the sum of all errors.
constexpr double price_of_mean = 7;
// Blocks that would pay less for their part of it, of the sum of all errors, are left alone.
constexpr double least_paid = 3e-4;
constexpr Settings balanced = thorough_in(12);

constexpr Pass fast_passes[] = {{0, quick}, {0.25, brief}, {0.6, careful}};
constexpr Pass normal_passes[] = {{0, usual}, {0.2, careful}, {0.35, thorough}, {0.7, decisive}};
constexpr Pass best_passes[] = {{0, thorough_in(6)}};

std::span<const Pass> passes_of(Bc6hEffort effort) {
  switch (effort) {
    case Bc6hEffort::fast: return fast_passes;
    case Bc6hEffort::normal: break;
    case Bc6hEffort::best: return best_passes;
  }
  return normal_passes;
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

// An image's blocks, searched again and again.
class Encoder {
 public:
  Encoder(const Image& image, std::uint8_t* blocks)
      : image_(image),
        blocks_(blocks),
        columns_(blocks_along(image.width())),
        rows_(blocks_along(image.height())),
        errors_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), HUGE_VALF),
        sums_(errors_.size()),
        differences_(errors_.size()) {}

  void run(const Pass& pass) { search_all(chosen_by(pass.share), pass.settings); }

  // Searches the blocks again whose sums' errors matter to the image's sum.
  void balance() {
    set_price();
    std::vector<int> chosen;
    for (std::size_t block = 0; block < errors_.size(); ++block)
      if (paid(block) > least_paid * total_) chosen.push_back(static_cast<int>(block));
    search_all(chosen, balanced);
  }

 private:
  void search_all(const std::vector<int>& chosen, const Settings& settings) {
    const int count = static_cast<int>(chosen.size());
    tbb::parallel_for(0, (count + most_blocks - 1) / most_blocks, [&](int batch) {
      const int first = batch * most_blocks;
      search({&chosen[static_cast<std::size_t>(first)], static_cast<std::size_t>(std::min(most_blocks, count - first))},
             settings);
    });
  }

  // Sets a price on differences of sums.
  void set_price() {
    total_ = std::accumulate(errors_.begin(), errors_.end(), 0.0);
    for (std::size_t c = 0; c < 3; ++c) {
      double sum = 0;
      for (const auto& of_block : sums_) sum += of_block[c];
      price_[c] = sum > 0 ? static_cast<float>(price_of_mean * total_ / 3 / sum) : 0;
    }
  }

  // What a block pays for the differences of its sums.
  float paid(std::size_t block) const {
    float sum = 0;
    for (std::size_t c = 0; c < 3; ++c) sum += price_[c] * std::abs(differences_[block][c]);
    return sum;
  }

  // Keeps what is better than before.
  void search(std::span<const int> chosen, const Settings& settings) {
    Texels texels;
    std::copy(price_.begin(), price_.end(), texels.price);
    for (int i = 0; i < most_blocks; ++i) {
      const int block = chosen[std::min(static_cast<std::size_t>(i), chosen.size() - 1)];
      gather(image_, block % columns_, block / columns_, i, texels);
    }
    std::array<Found, most_blocks> found;
    bc6h::search(texels, static_cast<int>(chosen.size()), settings, found.data());
    for (std::size_t i = 0; i < chosen.size(); ++i) {
      const auto block = static_cast<std::size_t>(chosen[i]);
      const Found& now = found[i];
      if (!(now.error < errors_[block] + paid(block))) continue;
      errors_[block] = now.error;
      std::copy_n(now.sum, 3, sums_[block].begin());
      std::copy_n(now.difference, 3, differences_[block].begin());
      bc6h::pack(now.block, blocks_ + block * 16);
    }
  }

  // Blocks that have so much of the error of any square of 4x4 blocks that they are in.
  std::vector<int> chosen_by(double share) const {
    std::vector<int> chosen;
    const int width = std::min(4, columns_), height = std::min(4, rows_);
    std::vector<float> least(errors_.size(), HUGE_VALF);  // of those squares
    const auto at = [&](int x, int y) {
      return static_cast<std::size_t>(y) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(x);
    };
    for (int top = 0; share > 0 && top + height <= rows_; ++top)
      for (int left = 0; left + width <= columns_; ++left) {
        float sum = 0;
        for (int y = top; y < top + height; ++y)
          for (int x = left; x < left + width; ++x) sum += errors_[at(x, y)];
        for (int y = top; y < top + height; ++y)
          for (int x = left; x < left + width; ++x) least[at(x, y)] = std::min(least[at(x, y)], sum);
      }
    for (std::size_t i = 0; i < errors_.size(); ++i)
      if (share == 0 || (errors_[i] > 0 && errors_[i] >= share * least[i])) chosen.push_back(static_cast<int>(i));
    return chosen;
  }

  const Image& image_;
  std::uint8_t* blocks_;
  int columns_, rows_;
  std::vector<float> errors_;
  double total_ = 0;                                      // of the errors
  std::vector<std::array<float, 3>> sums_, differences_;  // of radiance, by block and channel
  std::array<float, 3> price_{};                          // of a difference of sums, as an error
};

}  // namespace

std::size_t bc6h_bytes(int width, int height) {
  return static_cast<std::size_t>(blocks_along(width)) * static_cast<std::size_t>(blocks_along(height)) * 16;
}

void encode_bc6h(const Image& image, Bc6hEffort effort, int threads, std::uint8_t* blocks) {
  tbb::task_arena arena(threads > 0 ? threads : tbb::task_arena::automatic);
  arena.execute([&] {
    Encoder encoder(image, blocks);
    for (const Pass& pass : passes_of(effort)) encoder.run(pass);
    encoder.balance();
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
