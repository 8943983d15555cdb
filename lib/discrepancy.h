// SPDX-License-Identifier: Apache-2.0
// How evenly points are spread over the sphere: the generalised discrepancy, with a proven bound of its error.
#pragma once

#include <span>
#include <vector>

#include "geometry.h"
#include "layout.h"

namespace envconv {

/// A generalised discrepancy and the bound of its error.
struct Discrepancy {
  double value = 0;
  double error = 0;  ///< |value - the exact sum's| is at most this; rounding adds about 1e-17 / value
};

/// Generalised discrepancy of points on the unit sphere (Cui & Freeden 1997; Wan, Wong & Leung, equation 11):
///
///   D = 1/(2 sqrt(pi) N) [ sum over i, j of 1 - 2 ln(1 + |p_i - p_j| / 2) ]^(1/2)
///
/// (there sqrt((1 - p_i . p_j) / 2), which is half the distance).  The smaller, the more even; of well spread points it
/// falls as N^(-3/4), of random ones as N^(-1/2).  0 for no points.
///
/// The sum takes O(N log N): points far apart meet by Chebyshev interpolation of the kernel, of an order that a proven
/// bound asks for, and `error` is the sum of the bounds.  It is about `tolerance` of the value, or less, for points as
/// even as any, whose D is N^(-3/4) / 4, and a smaller share for others.  Independent of the thread count.
Discrepancy generalised_discrepancy(std::span<const Vec3> points, double tolerance = 1e-4);

/// Directions of the centres of the texels that the layout owns when face 0 is `height` >= 1 texels high, face by face
/// and row by row.
std::vector<Vec3> texel_centres(const Layout& layout, int height);

}  // namespace envconv
