// SPDX-License-Identifier: Apache-2.0
// Where a layout's map has creases: lines along which its derivatives jump, as where octahedral maps fold.
#pragma once

#include "image.h"
#include "tile_plan.h"

namespace envconv {

/// Texels of a tile, inside the layout's domain, within `grid_reach` of a crease: across it waves of the source are
/// none. A crease is seen where the derivatives jump by about a tenth and more of themselves: where it is flatter, near
/// some creases' ends or middles, a grid does no harm.
TexelMask find_creases(const EnvImage& out, const Tile& tile);

}  // namespace envconv
