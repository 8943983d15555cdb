// SPDX-License-Identifier: Apache-2.0
#include "filter.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace envconv {

std::span<const Filter> all_filters() {
  static constexpr Filter filters[] = {
      {.name = "auto",
       .note = "exact footprints of a band-limited reconstruction; highlights without ringing",
       .kernel = Kernel::band_limited,
       .spacing = 1.3,
       .least_samples = 2,
       .limited = true},
      {.name = "nearest", .note = "the nearest texel, one sample", .kernel = Kernel::nearest, .spacing = 0},
      {.name = "bilinear", .note = "bilinear, over the footprint when shrinking", .kernel = Kernel::bilinear},
      {.name = "bicubic", .note = "Catmull-Rom, over the footprint when shrinking", .kernel = Kernel::catmull_rom},
      {.name = "lanczos",
       .note = "windowed sinc of three lobes, over the footprint when shrinking",
       .kernel = Kernel::lanczos3},
      {.name = "box",
       .note = "area average of the source's texels as they are",
       .kernel = Kernel::nearest,
       .spacing = 0.3,
       .least_samples = 4},
      {.name = "gaussian",
       .note = "Gaussian of half a texel's sigma: soft",
       .kernel = Kernel::bilinear,
       .spacing = 1.0,
       .least_samples = 6,
       .window = 3.0,
       .gaussian = true},
  };
  return filters;
}

namespace {

// The mean over the fractions f of sum_j c_j(f) cos(w (j - f)).
double mean_height(double w) {
  constexpr int fractions = 32;
  const auto polynomial = [](const auto& c, double x) {
    double sum = 0;
    for (std::size_t i = std::size(c); i-- > 0;) sum = sum * x + static_cast<double>(c[i]);
    return sum;
  };
  double sum = 0;
  for (int i = 0; i < fractions; ++i) {
    const double f = (i + 0.5) / fractions - 0.5;
    sum += polynomial(drooping::c0, f * f) * std::cos(w * f) + polynomial(drooping::c1, f) * std::cos(w * (1 - f)) +
           polynomial(drooping::c1, -f) * std::cos(w * (1 + f)) + polynomial(drooping::c2, f) * std::cos(w * (2 - f)) +
           polynomial(drooping::c2, -f) * std::cos(w * (2 + f));
  }
  return sum / fractions;
}

}  // namespace

double drooping_height(double w) {
  constexpr int steps = 256;
  static const auto table = [] {
    std::array<double, steps + 2> heights;
    for (std::size_t i = 0; i < heights.size(); ++i) heights[i] = mean_height(M_PI * static_cast<double>(i) / steps);
    return heights;
  }();
  const double x = std::min(std::abs(w) / M_PI, 1.0) * steps;
  const auto i = static_cast<std::size_t>(x);
  return table[i] + (x - static_cast<double>(i)) * (table[i + 1] - table[i]);
}

const Filter* find_filter(std::string_view name) {
  for (const Filter& f : all_filters())
    if (f.name == name) return &f;
  return nullptr;
}

}  // namespace envconv
