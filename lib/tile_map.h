// SPDX-License-Identifier: Apache-2.0
// A tile's points in the source by polynomials, so that no layout's formula needs to run for every sample.
#pragma once

#include <optional>

#include "source.h"
#include "tile_plan.h"
#include "window_kernels.h"

namespace envconv {

/// The polynomial of fourth degree in x and in y through a plan's nodes.  Its variables run from -2 to 2 over the tile.
class TilePolynomial {
 public:
  TilePolynomial() = default;
  /// nodes: [row][column], in equal steps from edge to edge.
  explicit TilePolynomial(const double (&nodes)[TilePlan::nodes_y][TilePlan::nodes_x]);
  /// Along the row at t: out[m] is the factor of s^m.
  void row(double t, float (&out)[5]) const;
  double at(double s, double t) const;

 private:
  double c_[5][5] = {};  // [power of t][power of s]
};

/// The variable of a place of a tile, in texels from its edge.
inline double tile_variable(double texels, int side) { return 4 * texels / side - 2; }

/// Where a tile lies in the one face of the source that it sees.
class TileMap {
 public:
  /// Nothing where the tile, or what is up to `reach` texels around it, sees several faces or an edge, or is no such
  /// polynomial to 2e-4 of the source's texels.  plan: the tile's.
  static std::optional<TileMap> find(const Source& source, const EnvImage& out, const Mat3& source_from_out,
                                     const Tile& tile, const TilePlan& plan, double reach);

  int face() const { return face_; }
  /// Of the samples at t, a tile_variable().
  RowMap row(double t) const;

 private:
  int face_ = 0, x_ = 0, y_ = 0;       // padded texel that the polynomials count from
  float left_, right_, top_, bottom_;  // from there, the face's edges
  TilePolynomial to_x_, to_y_;
};

}  // namespace envconv
