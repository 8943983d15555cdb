// SPDX-License-Identifier: Apache-2.0
// Figures of a layout, measured from its formulas.
#pragma once

#include <cstdint>

#include "geometry.h"
#include "layout.h"

namespace envconv {

/// Largest and smallest stretch of the map from face to sphere at a point (the singular values of its Jacobian), in
/// radians per unit of face height: Herron's equation 5.
struct Stretch {
  double largest = 0, smallest = 0;
};
/// Stretch at a face point, u measured in units of the face's height too (so u spans [0, aspect]).
Stretch stretch(const Layout& layout, int face, double u, double v);

/// Measured figures.
struct LayoutFigures {
  /// Sampling requirement (Snyder & Mitchell 2001; Herron's equation 6): the sum over faces of area x the square of the
  /// largest stretch; proportional to the texels needed for a given worst-case detail.  Infinite for sphere-map.
  /// Areas are of whole rectangles, since those are stored, in texels that agree over all faces; stretches, here and
  /// below, are of the points that the layout owns.
  double sampling_requirement = 0;
  double anisotropy = 0;   ///< largest ratio of the two stretches; infinite for latlong
  double texel_ratio = 0;  ///< largest over smallest solid angle of a texel, in the limit; infinite for latlong
  /// Solid angles, in steradians, of the smallest and the largest texel times the number of texels stored, in the limit
  /// of many: 4 pi both for an equal-area layout whose texels are all used; the smallest is 0 for latlong.
  double smallest_texel = 0, largest_texel = 0;
};
/// Cached after the first call for a layout; thread-safe.  Relative error below 1e-5: values converge to the suprema
/// from below, with steps down to 1e-11 of a face, and closed forms are met that closely.
const LayoutFigures& figures(const Layout& layout);

/// The height of face 0 at which `target` keeps the worst-case detail of `source` at `source_height`: texels in
/// proportion to the two sampling requirements, the smallest whole height that has enough.  Where one of the
/// requirements is infinite, the texels at the two layouts' centres are made equally large instead.
int matching_height(const Layout& source, int source_height, const Layout& target);

/// The largest height of face 0 whose faces together hold at most `texels`; at least 1.
int height_for_texels(const Layout& layout, std::int64_t texels);

}  // namespace envconv
