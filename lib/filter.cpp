// SPDX-License-Identifier: Apache-2.0
#include "filter.h"

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

const Filter* find_filter(std::string_view name) {
  for (const Filter& f : all_filters())
    if (f.name == name) return &f;
  return nullptr;
}

}  // namespace envconv
