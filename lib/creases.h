// SPDX-License-Identifier: Apache-2.0
// Where a layout's map has creases: lines along which its derivatives jump, as where octahedral maps fold.
#pragma once

#include "image.h"
#include "tile_plan.h"

namespace envconv {

/// Texels of a tile, inside the layout's domain, by creases: lines where derivatives jump by a hundredth of themselves
/// and more.
struct Creases {
  TexelMask near;    ///< within `grid_reach` of one: weights that reach across it see waves that are none
  TexelMask across;  ///< on one, or next to one that is; all of them are near
};
Creases find_creases(const EnvImage& out, const Tile& tile);

}  // namespace envconv
