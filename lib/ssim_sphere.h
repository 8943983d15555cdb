// SPDX-License-Identifier: Apache-2.0
// Structural similarity on the sphere.  Internal: not installed.
#pragma once

#include <vector>

#include "map_reader.h"

namespace envconv {

/// Mean over the sphere of the structural similarity of each channel (Wang, Bovik, Sheikh & Simoncelli, Image Quality
/// Assessment, 2004: K1 = 0.01, K2 = 0.03) between the maps' log-encoded values, whose dynamic range is `range`.
///
/// Around each of 12288 centres of equal area (49152 for steps below 0.01) a window of 11 x 11 points, weighted by a
/// Gaussian of 1.5 steps, lies on the tangent plane; a step is `pitch` (tangent of the angle).  Windows that meet a NaN
/// or infinite value are left out.  [channels]; NaN where no window is left.
std::vector<double> ssim_on_sphere(const MapReader& a, const MapReader& b, double pitch, double range);

}  // namespace envconv
