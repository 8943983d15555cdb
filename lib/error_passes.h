// SPDX-License-Identifier: Apache-2.0
// Sums of errors over the points of a comparison: common texels, one map's texels, points of equal area.
// Internal: not installed.
#pragma once

#include "error_sums.h"
#include "map_pair.h"
#include "map_reader.h"

namespace envconv {

/// Over the texels of a common grid, weighted by owned solid angle.  Precondition: pair.same_grid.
ErrorSums sums_on_common_grid(const MapPair& pair);

/// Over the texels of map `own`, whose values are taken as they are, with `other` read at their directions; weighted by
/// owned solid angle.  Texels whose centre the layout does not own are left out.  With `swapped`, `own` is the pair's
/// b.
ErrorSums sums_on_grid_of(const EnvImage& own, const MapReader& other, bool swapped);

/// Over points of equal area: more of them where the squared error varies, until its integral is known to about 1/1000.
ErrorSums sums_on_sphere(const MapPair& pair, const MapReader& a, const MapReader& b);

/// At the points of S-PSNR, the nearest texels.
ErrorSums sums_at_s_psnr_points(const MapPair& pair);

}  // namespace envconv
