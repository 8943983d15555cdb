// SPDX-License-Identifier: Apache-2.0
// Solid angles of many texels at once.
#pragma once

#include <vector>

#include "image.h"
#include "layout.h"

namespace envconv {

/// Least side of the blocks that texel_solid_angles() works in: smaller rectangles cost more per texel.
inline constexpr int solid_angle_block = 16;

/// Solid angles, in steradians, of the owned parts of nx x ny texels from (x0, y0) of a face; out is [ny][nx].
/// The density is interpolated by bicubic polynomials over blocks where they fit to 1e-7, and integrated texel by texel
/// where they don't (creases, seams).
void texel_solid_angles(const Layout& layout, int face, Size size, Placement placement, int x0, int y0, int nx, int ny,
                        double* out);

/// Means over the sphere of the channels' values and of their magnitudes, weighted by owned solid angle.  [channels]
struct SphereMean {
  std::vector<double> value, magnitude;
};
SphereMean sphere_mean(const EnvImage& image);

}  // namespace envconv
