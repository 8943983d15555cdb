// SPDX-License-Identifier: Apache-2.0
// Reading maps at points of the sphere, for comparisons.  Internal: not installed.
#pragma once

#include <cstddef>
#include <vector>

#include "geometry.h"
#include "image.h"
#include "source.h"
#include "window_kernels.h"

namespace envconv {

/// Directions in the world frame.
struct PointBatch {
  static constexpr int most = 1024;
  static_assert(most <= most_samples);
  int count = 0;
  alignas(64) float x[most + batch_padding], y[most + batch_padding], z[most + batch_padding];
};

/// An environment that is read bilinearly at any direction.  Immutable, for many threads.
class MapReader {
 public:
  /// `image` must outlive the reader.
  explicit MapReader(const EnvImage& image);

  int channels() const { return channels_; }
  /// out: [points.count][channels()].  Entries of the batch's arrays beyond its count are overwritten.
  void read(const PointBatch& points, float* out) const;

 private:
  const Layout* layout_;
  int channels_;
  float layout_from_world_[9];
  std::vector<Source> groups_;  // four channels each
};

/// A square of side x side points of equal area, of the grid of 12 * grid^2 of them that a HEALPix map of that height
/// has, turned by a fixed rotation that no layout's symmetry knows.  Face in [0,12), x and y of the first point.
struct PointSquare {
  static constexpr int side = 32;  // side^2 = PointBatch::most
  int face = 0, grid = 0, x = 0, y = 0;
};
void lay_points(const PointSquare& square, PointBatch& points);
/// All squares of a grid; its height is a multiple of PointSquare::side.
std::vector<PointSquare> point_squares(int grid);

/// A texel.
struct TexelPlace {
  int face = 0, x = 0, y = 0;
  const float* of(const EnvImage& image) const { return image.faces[static_cast<std::size_t>(face)].at(x, y); }
};
/// The texels whose area holds the points: no interpolation.  out: [points.count]
void nearest_texels(const EnvImage& image, const PointBatch& points, TexelPlace* out);

}  // namespace envconv
