// SPDX-License-Identifier: Apache-2.0
// Where a layout's map has creases: lines along which its derivatives jump, as where octahedral maps fold.
#pragma once

#include <cstdint>

#include "image.h"
#include "tile_plan.h"

namespace envconv {

/// Texels of a tile within `grid_reach` of a crease: waves of the source are none across it.
struct CreasedTexels {
  std::uint64_t rows[largest_tile] = {};  ///< bit i of row j
  bool any = false;
  bool holds(int i, int j) const { return (rows[j] >> i & 1) != 0; }
};

/// Of a tile inside the layout's domain.  A crease is seen where the derivatives jump by about a tenth and more of
/// themselves: where it is flatter, near some creases' ends or middles, a grid does no harm.
CreasedTexels find_creases(const EnvImage& out, const Tile& tile);

}  // namespace envconv
