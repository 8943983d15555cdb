// SPDX-License-Identifier: Apache-2.0
// A rectangle of an output face, and how densely it is to be sampled.
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

#include "filter.h"
#include "image.h"
#include "quadrature.h"
#include "resample.h"
#include "rim_texel.h"

namespace envconv {

inline constexpr int largest_tile = 64;  ///< texels a side

/// In texels of the output's face.
struct Tile {
  int face, x0, y0, width, height;
};

/// Some of a tile's texels.
struct TexelMask {
  std::uint64_t rows[largest_tile] = {};  ///< bit i of row j
  bool any = false;
  bool holds(int i, int j) const { return (rows[j] >> i & 1) != 0; }
  /// Texels [left, right) x [top, bottom), as far as they are among the tile's first width x height.
  void add(int left, int top, int right, int bottom, const Tile& tile);
  void add(const TexelMask& other) {
    for (int j = 0; j < largest_tile; ++j) rows[j] |= other.rows[j];
    any = any || other.any;
  }
  TexelMask without(const TexelMask& other) const {
    TexelMask rest;
    for (int j = 0; j < largest_tile; ++j) rest.any = (rest.rows[j] = rows[j] & ~other.rows[j]) != 0 || rest.any;
    return rest;
  }
};

/// Where a tile looks: a rectangle of a face of the source, in its texels, that may reach beyond it.  No face: at
/// several.
struct SourceView {
  int face = -1;
  double left = 1e30, top = 1e30, right = -1e30, bottom = -1e30;
  void add(double x, double y) {
    left = std::min(left, x), top = std::min(top, y), right = std::max(right, x), bottom = std::max(bottom, y);
  }
};

/// The density relative to neighbours, and the number of samples, over one tile.
struct TilePlan {
  static constexpr int nodes_x = 5, nodes_y = 5;
  double density[nodes_y][nodes_x];  ///< |dd/du x dd/dv| at equal steps from edge to edge; 1 for equal-area layouts
  Vec3 to[nodes_y][nodes_x];         ///< where these look, in the source's axes
  double need_u = 0, need_v = 0;     ///< source texels along a texel's sides, at most
  /// The same of its quarters: [lower][right].
  struct Need {
    double u = 0, v = 0;
  } quarter[2][2];
  double least = 1e30;  ///< source texels that a texel is wide where it is narrowest
  /// A wave of one texel along u, and along v: the waves that it is along the source's texels and across, on average.
  SourceWave wave_u, wave_v;
  SourceView view;       ///< from the tile's edges and its middle
  int ku = 1, kv = 1;    ///< samples a side of each texel, where texels are sampled apart
  bool inside = true;    ///< in the layout's domain, and so are the texels around that a grid's weights reach
  bool smooth = false;   ///< inside, and the density varies little enough to be sampled on a grid
  bool creased = false;  ///< whether the density bends between the nodes
};

/// source_from_out: the output layout's axes to the source layout's.
TilePlan plan_tile(const EnvImage& source, const EnvImage& out, const Mat3& source_from_out, const Filter& filter,
                   const ResampleOptions& options, const Tile& tile);

/// Density relative to neighbours at n equal steps along a row of a tile where it has creases: bilinear between nodes,
/// and on beyond them.  x, step and y in texels, from the tile's corner.
void creased_densities(const TilePlan& plan, const Tile& tile, double x, double step, double y, int n, float* out);

/// The relative change of the density per texel, along both axes, at texels [begin, end) of row j: bilinear between the
/// plan's nodes.  A centre on a singular point has no slope to speak of; elsewhere |slope| <= 2, its value next to a
/// pole.
void density_slopes(const TilePlan& plan, const Tile& tile, int j, int begin, int end, float* gx, float* gy);
/// The same from the density at either side of each texel's centre, for texels near creases, between whose tile's nodes
/// it bends.
void creased_slopes(const EnvImage& out, const Tile& tile, int j, int begin, int end, float* gx, float* gy);

/// What a texel at the rim of a disc is sampled by.
struct RimSamples {
  explicit RimSamples(const RimTexel& rim_texel) : texel(rim_texel) {}
  RimTexel texel;
  int outwards[RimTexel::most_pieces] = {};  ///< nodes of each piece
  int aside = 0;                             ///< and on each chord
};
RimSamples rim_samples(const EnvImage& source, const EnvImage& out, const Mat3& source_from_out, const Filter& filter,
                       int face, int x, int y);

/// Where texels lie in a layout whose domain is a disc; those of others are inside.
enum class RimSide { inside, cut, outside };
RimSide rim_side(const EnvImage& out, const Tile& texels);

}  // namespace envconv
