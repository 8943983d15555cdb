// SPDX-License-Identifier: Apache-2.0
// Figures of a layout's texels at one size: how large they are, how far apart, and how many are used.
#pragma once

#include <cstdint>

#include "layout.h"

namespace envconv {

/// A texel is used where the layout owns its centre; it is whole where the layout owns all of it.
struct TexelFigures {
  std::int64_t stored = 0, used = 0;  ///< texels of all faces, and those whose centre the layout owns
  /// Solid angles, in steradians, of the smallest and the largest whole texel; 0 where none is whole.
  double smallest = 0, largest = 0;
  /// Angles, in radians, between the centres of used texels that share an edge, over seams too.
  double mean_distance = 0, largest_distance = 0;
};

/// Measures all texels when face 0 is `height` >= 1 texels high.  Independent of the thread count.
TexelFigures texel_figures(const Layout& layout, int height);

}  // namespace envconv
