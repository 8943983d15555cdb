// SPDX-License-Identifier: Apache-2.0
// Solid angles of many texels at once.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "image.h"
#include "layout.h"

namespace envconv {

/// Least side of the blocks that texel_solid_angles() works in: smaller rectangles cost more per texel.
inline constexpr int solid_angle_block = 16;

/// Solid angles, in steradians, of the owned parts of nx x ny texels from (x0, y0) of a face; out is [ny][nx].
/// The density is interpolated by polynomials over blocks where they fit, to 1e-6 of it at points between their nodes,
/// and integrated texel by texel where none does (creases, seams).
void texel_solid_angles(const Layout& layout, int face, Size size, Placement placement, int x0, int y0, int nx, int ny,
                        double* out);

/// The same for the cells of any grid over a face: cell (x, y) spans [u[x], u[x+1]] x [v[y], v[y+1]], bounds ascending;
/// out is [v.size() - 1][u.size() - 1].  With owned_only false seams don't count, and bounds may lie beyond [0,1].
void cell_solid_angles(const Layout& layout, int face, std::span<const double> u, std::span<const double> v,
                       bool owned_only, double* out);

/// Bounds in u of `count` texels from `first` of n along one axis: count + 1 values in [0,1].  Texels centred on an
/// edge end there.
std::vector<double> texel_bounds(int n, Placement placement, int first, int count);
inline std::vector<double> texel_bounds(int n, Placement placement) { return texel_bounds(n, placement, 0, n); }

/// Means over the sphere of the channels' values and of their magnitudes, weighted by owned solid angle.  [channels]
struct SphereMean {
  std::vector<double> value, magnitude;
};
SphereMean sphere_mean(const EnvImage& image);

/// For who walks over the texels anyhow.  Sums over texels: value times owned solid angle by channel, magnitude
/// likewise, and at last solid angle; so many for `channels`.
constexpr std::size_t sphere_sums(int channels) { return 2 * static_cast<std::size_t>(channels) + 1; }
/// Adds nx x ny texels from (x0, y0) of a face to the sums.
void add_to_sums(const EnvImage& image, int face, int x0, int y0, int nx, int ny, double* sums);
/// The means that follow from the sums over all texels.
SphereMean mean_of_sums(std::span<const double> sums);

/// Largest side of the rectangles below, whose corners are at multiples of it.
inline constexpr int visit_side = 64;
/// The same, and calls visit(face, x0, y0, width, height) for rectangles of texels that have just been read, while the
/// cache holds them: all of a face's texels once, from several threads at a time, those of a row from one.
SphereMean sphere_mean(const EnvImage& image, const std::function<void(int, int, int, int, int)>& visit);

}  // namespace envconv
