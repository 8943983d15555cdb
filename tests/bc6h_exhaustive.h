// SPDX-License-Identifier: Apache-2.0
// What BC6H can do at all, as near as a search can tell that takes its time: every mode and partition, each from many
// starts, end points by least squares and then by descent.  It shares the format with the encoder and nothing else.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "bc6h_format.h"

namespace envconv::test {

using HalfTexels = std::array<std::array<std::uint16_t, 3>, 16>;  // bit patterns, as bc6h::decode returns them

inline double half_value(int bits) {
  const int exponent = bits >> 10, fraction = bits & 1023;
  return exponent ? std::ldexp(1024 + fraction, exponent - 25) : std::ldexp(fraction, -24);
}

// Bit pattern of the half that is nearest in 0 to 65504.
inline std::uint16_t half_bits(float value) {
  const double x = std::clamp(static_cast<double>(value), 0.0, 65504.0);
  const int exponent = std::max(x > 0 ? std::ilogb(x) : -14, -14);
  return static_cast<std::uint16_t>((exponent + 14) * 1024 + std::nearbyint(std::ldexp(x, 10 - exponent)));
}
// log2(x + 1/1024) by half bit pattern.
inline const std::vector<float>& log_levels() {
  static const std::vector<float> levels = [] {
    std::vector<float> table;
    for (int bits = 0; bits <= 0x7BFF; ++bits)
      table.push_back(static_cast<float>(std::log2(half_value(bits) + 1.0 / 1024)));
    return table;
  }();
  return levels;
}

// Sum of squared differences of levels over a block.
inline double block_error(const HalfTexels& a, const HalfTexels& b) {
  double sum = 0;
  for (std::size_t k = 0; k < 16; ++k)
    for (std::size_t c = 0; c < 3; ++c) {
      const double e = log_levels()[a[k][c]] - log_levels()[b[k][c]];
      sum += e * e;
    }
  return sum;
}

class ExhaustiveSearch {
 public:
  explicit ExhaustiveSearch(const HalfTexels& texels) : texels_(texels) {
    for (const bool descend : {false, true})  // the first time finds out what is worth a descent
      for (int mode = 0; mode < bc6h::mode_count; ++mode)
        for (int partition = 0; partition < (bc6h::modes[at(mode)].regions == 2 ? bc6h::partition_count : 1);
             ++partition)
          try_all_starts(mode, partition, descend);
  }
  double error() const { return error_; }
  const bc6h::Block& block() const { return block_; }

 private:
  using Colour = std::array<double, 3>;  // in the space of interpolation
  struct Line {
    Colour a, b;
  };

  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  static double middle(int half_bits) { return (half_bits + 0.5) * 64 / 31; }
  static int mask_of(const bc6h::Block& block) {
    return bc6h::modes[at(block.mode)].regions == 2 ? bc6h::partition_masks[at(block.partition)] : 0;
  }
  static int quantize(double u, int bits) {
    return std::clamp(static_cast<int>(std::lround(u / (1 << (16 - bits)) - 0.5)), 0, (1 << bits) - 1);
  }

  // Best indices and their error, of the texels whose bit is set.
  double index_region(const bc6h::Mode& mode, int mask, int anchor, const std::array<int, 3>& a,
                      const std::array<int, 3>& b, std::array<std::uint8_t, 16>& index) const {
    const int count = mode.regions == 1 ? 16 : 8;
    float palette[16][3];
    for (std::size_t c = 0; c < 3; ++c) {
      const int p = bc6h::unquantize(a[c], mode.end_bits), q = bc6h::unquantize(b[c], mode.end_bits);
      for (int i = 0; i < count; ++i)
        palette[i][c] = log_levels()[at(bc6h::to_half_bits(bc6h::interpolate(p, q, bc6h::weight(mode.regions, i))))];
    }
    double sum = 0;
    for (int k = 0; k < 16; ++k) {
      if (!(mask >> k & 1)) continue;
      float least = HUGE_VALF;
      for (int i = 0; i < (k == anchor ? count / 2 : count); ++i) {
        float error = 0;
        for (std::size_t c = 0; c < 3; ++c) {
          const float e = palette[i][c] - log_levels()[texels_[at(k)][c]];
          error += e * e;
        }
        if (error < least) {
          least = error;
          index[at(k)] = static_cast<std::uint8_t>(i);
        }
      }
      sum += least;
    }
    return sum;
  }
  double choose_indices(bc6h::Block& block) const {
    const bc6h::Mode& mode = bc6h::modes[at(block.mode)];
    const int mask = mask_of(block);
    double sum = index_region(mode, ~mask & 0xFFFF, 0, block.ends[0], block.ends[1], block.index);
    if (mode.regions == 2)
      sum +=
          index_region(mode, mask, bc6h::second_anchor[at(block.partition)], block.ends[2], block.ends[3], block.index);
    return sum;
  }

  // Pulls end points to where the mode can have them.
  static void make_fit(bc6h::Block& block) {
    const bc6h::Mode& mode = bc6h::modes[at(block.mode)];
    if (!mode.transformed) return;
    for (std::size_t e = 1; e < 2u * mode.regions; ++e)
      for (std::size_t c = 0; c < 3; ++c) {
        const int reach = 1 << (mode.rest_bits[c] - 1), first = block.ends[0][c];
        block.ends[e][c] = std::clamp(block.ends[e][c], std::max(first - reach, 0),
                                      std::min(first + reach - 1, (1 << mode.end_bits) - 1));
      }
  }

  void fit_ends(bc6h::Block& block) const {
    const bc6h::Mode& mode = bc6h::modes[at(block.mode)];
    const int mask = mask_of(block);
    for (int region = 0; region < mode.regions; ++region)
      for (std::size_t c = 0; c < 3; ++c) {
        double aa = 0, ab = 0, bb = 0, au = 0, bu = 0;
        for (int k = 0; k < 16; ++k) {
          if ((mask >> k & 1) != region) continue;
          const int bits = std::min<int>(texels_[at(k)][c], 0x7BFE);
          const double slope = log_levels()[at(bits + 1)] - log_levels()[at(bits)], s = slope * slope;
          const double w = bc6h::weight(mode.regions, block.index[at(k)]) / 64.0, v = 1 - w,
                       u = middle(texels_[at(k)][c]);
          aa += s * v * v, ab += s * v * w, bb += s * w * w, au += s * v * u, bu += s * w * u;
        }
        const double determinant = aa * bb - ab * ab;
        if (determinant < 1e-9 * (aa + bb) * (aa + bb)) continue;
        block.ends[at(2 * region)][c] = quantize((au * bb - bu * ab) / determinant, mode.end_bits);
        block.ends[at(2 * region + 1)][c] = quantize((bu * aa - au * ab) / determinant, mode.end_bits);
      }
    make_fit(block);
  }

  // Moves end points as long as that helps.
  void descend(bc6h::Block& block, double& error) const {
    const bc6h::Mode& mode = bc6h::modes[at(block.mode)];
    const std::size_t ends = 2u * mode.regions;
    bool moved = true;
    const auto attempt = [&](const auto& change) {
      bc6h::Block next = block;
      change(next);
      for (std::size_t e = 0; e < ends; ++e)
        for (const int q : next.ends[e])
          if (q < 0 || q >= 1 << mode.end_bits) return;
      if (!bc6h::fits(next)) return;
      const double now = choose_indices(next);
      if (now < error - 1e-12) {
        error = now;
        block = next;
        moved = true;
      }
    };
    for (int round = 0; moved && round < 30; ++round) {
      moved = false;
      for (const int step : {-4, 4, -2, 2, -1, 1}) {
        for (std::size_t e = 0; e < ends; ++e) {
          for (std::size_t c = 0; c < 3; ++c) {
            attempt([&](bc6h::Block& b) { b.ends[e][c] += step; });
            attempt([&](bc6h::Block& b) { b.ends[e][c] += step, b.ends[e ^ 1][c] += e & 1 ? step : -step; });
          }
          attempt([&](bc6h::Block& b) {
            for (int& q : b.ends[e]) q += step;
          });
        }
        for (std::size_t c = 0; c < 3; ++c)
          attempt([&](bc6h::Block& b) {
            for (auto& end : b.ends) end[c] += step;
          });
      }
    }
  }

  // Principal axis of the region, all of it and cut short; its farthest texels; its bounding box's diagonals.
  std::vector<Line> starts(int mask) const {
    std::vector<Colour> u;
    for (int k = 0; k < 16; ++k)
      if (mask >> k & 1) u.push_back({middle(texels_[at(k)][0]), middle(texels_[at(k)][1]), middle(texels_[at(k)][2])});
    Colour mean{}, low = u[0], high = u[0];
    for (const Colour& x : u)
      for (std::size_t c = 0; c < 3; ++c) {
        mean[c] += x[c] / static_cast<double>(u.size());
        low[c] = std::min(low[c], x[c]);
        high[c] = std::max(high[c], x[c]);
      }
    const auto dot = [](const Colour& x, const Colour& y) { return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]; };
    const auto minus = [](const Colour& x, const Colour& y) { return Colour{x[0] - y[0], x[1] - y[1], x[2] - y[2]}; };
    Colour axis{1, 1.01, 0.99};
    for (int iteration = 0; iteration < 20; ++iteration) {
      Colour next{};
      for (const Colour& x : u) {
        const double p = dot(minus(x, mean), axis);
        for (std::size_t c = 0; c < 3; ++c) next[c] += p * (x[c] - mean[c]);
      }
      const double length = std::sqrt(dot(next, next));
      if (length == 0) break;
      for (std::size_t c = 0; c < 3; ++c) axis[c] = next[c] / length;
    }
    std::vector<double> places;
    for (const Colour& x : u) places.push_back(dot(minus(x, mean), axis) / dot(axis, axis));
    std::sort(places.begin(), places.end());
    std::vector<Line> lines;
    const auto add = [&](double from, double to) {
      Line line;
      for (std::size_t c = 0; c < 3; ++c) line.a[c] = mean[c] + from * axis[c], line.b[c] = mean[c] + to * axis[c];
      lines.push_back(line);
    };
    const double first = places.front(), last = places.back(), margin = (last - first) / 16;
    add(first, last);
    add(first + margin, last - margin);
    if (places.size() > 3) {
      add(places[1], last);
      add(first, places[places.size() - 2]);
    }
    double farthest = -1;
    Line ends{};
    for (const Colour& x : u)
      for (const Colour& y : u)
        if (const double d = dot(minus(x, y), minus(x, y)); d > farthest) farthest = d, ends = {x, y};
    lines.push_back(ends);
    for (int diagonal = 0; diagonal < 4; ++diagonal) {
      Line line{low, high};
      for (std::size_t c = 1; c < 3; ++c)
        if (diagonal >> (c - 1) & 1) std::swap(line.a[c], line.b[c]);
      lines.push_back(line);
    }
    return lines;
  }

  void try_start(bc6h::Block block, bool then_descend) {
    make_fit(block);
    double error = choose_indices(block);
    for (bc6h::Block next = block;;) {
      fit_ends(next);
      const double now = choose_indices(next);
      if (now >= error - 1e-12) break;
      error = now;
      block = next;
    }
    if (then_descend && error < 1.15 * error_) descend(block, error);
    if (error < error_) {
      error_ = error;
      block_ = block;
    }
  }
  void try_all_starts(int mode, int partition, bool then_descend) {
    bc6h::Block block{};
    block.mode = mode;
    block.partition = partition;
    const int mask = mask_of(block), bits = bc6h::modes[at(mode)].end_bits;
    const std::vector<Line> first = starts(~mask & 0xFFFF), second = starts(mask ? mask : 0xFFFF);
    for (std::size_t i = 0; i < std::max(first.size(), second.size()); ++i)
      for (int turn = 0; turn < (mask ? 4 : 2); ++turn) {
        Line x = first[std::min(i, first.size() - 1)], y = second[std::min(i, second.size() - 1)];
        if (turn & 1) std::swap(x.a, x.b);
        if (turn & 2) std::swap(y.a, y.b);
        for (std::size_t c = 0; c < 3; ++c) {
          block.ends[0][c] = quantize(x.a[c], bits);
          block.ends[1][c] = quantize(x.b[c], bits);
          if (mask) block.ends[2][c] = quantize(y.a[c], bits), block.ends[3][c] = quantize(y.b[c], bits);
        }
        try_start(block, then_descend);
      }
  }

  HalfTexels texels_;
  double error_ = HUGE_VAL;
  bc6h::Block block_{};
};

}  // namespace envconv::test
