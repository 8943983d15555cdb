// SPDX-License-Identifier: Apache-2.0
// The formulas of the patterns.  Internal: not installed.
#pragma once

#include <functional>

#include "pattern.h"

namespace envconv {

/// A point of the output: where it looks, in the pattern's own world axes, and where it lies on its face.
struct PatternPoint {
  Vec3 d;
  int face;
  double u, v;
};

using Radiance = std::array<double, 3>;

/// Radiance at a point, and what its integration needs to know.
struct PatternFormula {
  std::function<Radiance(const PatternPoint&)> radiance;
  bool has_edges = false;  ///< it jumps: many samples instead of good ones
  double bandwidth = 0;    ///< bound of its oscillation, in radians of phase per radian
  /// Whether a crease of the formula may be within `angle` radians of d.  May be empty.
  std::function<bool(Vec3 d, double angle)> crease_near;
};

/// The formula of any kind but the sun.
PatternFormula pattern_formula(const PatternOptions& options);

/// Solid angle of a texel when all are alike, and its side in radians.
double mean_texel_side(const Layout& layout, int height);

/// Fills the faces with a sun; the rest is black.
void draw_sun(const PatternOptions& options, const Mat3& world_from_layout, EnvImage& image);

}  // namespace envconv
