// SPDX-License-Identifier: Apache-2.0
#include "texel_figures.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "image.h"
#include "solid_angle.h"

namespace envconv {
namespace {

// Of some rows; sums are combined in order.
struct Partial {
  std::int64_t used = 0;
  double smallest = std::numeric_limits<double>::infinity(), largest = 0;
  double distance = 0, weight = 0, largest_distance = 0;

  void add_distance(double angle, double share) {
    distance += share * angle;
    weight += share;
    largest_distance = std::max(largest_distance, angle);
  }
  void add(const Partial& other) {
    used += other.used;
    smallest = std::min(smallest, other.smallest);
    largest = std::max(largest, other.largest);
    distance += other.distance;
    weight += other.weight;
    largest_distance = std::max(largest_distance, other.largest_distance);
  }
};

// One face's texels.
struct Grid {
  const Layout& layout;
  int height;  // of face 0
  int face;
  Size size;
  Placement placement;

  Grid(const Layout& l, int h, int f)
      : layout(l), height(h), face(f), size(face_size(l, f, h)), placement(l.info().placement) {}
  double u(double i) const { return u_from_texel(i, size.width, placement); }
  double v(double j) const { return u_from_texel(j, size.height, placement); }
  bool used(int i, int j) const {
    return i >= 0 && j >= 0 && i < size.width && j < size.height && layout.owns(face, u(i), v(j));
  }
  // The layout owns all of the texel: a disc is convex, and a seam that cuts it leaves a corner or an edge's middle
  // out.
  bool whole(int i, int j) const {
    if (layout.info().domain == Domain::square) return true;
    for (int k = 0; k < 9; ++k)
      if (!layout.owns(face, std::clamp(u(i + 0.5 * (k % 3 - 1)), 0.0, 1.0),
                       std::clamp(v(j + 0.5 * (k / 3 - 1)), 0.0, 1.0)))
        return false;
    return true;
  }
  Vec3 centre(int i, int j) const { return layout.direction(face, u(i), v(j)); }
};

// The centre of the used texel over the seam, one step from a texel: where the formula, which goes on smoothly, leads.
std::optional<Vec3> over_seam(const Grid& grid, int i, int j, int di, int dj) {
  const Location at = grid.layout.locate(grid.layout.direction(grid.face, grid.u(i + di), grid.v(j + dj)));
  const Grid other(grid.layout, grid.height, at.face);
  const auto texel = [&](double place, int n) {
    return std::clamp(static_cast<int>(std::lround(texel_from_u(place, n, other.placement))), 0, n - 1);
  };
  const int x = texel(at.u, other.size.width), y = texel(at.v, other.size.height);
  if ((other.face == grid.face && x == i && y == j) || !other.used(x, y)) return std::nullopt;
  return other.centre(x, y);
}

Partial measure_row(const Grid& grid, int j) {
  Partial row;
  const auto width = static_cast<std::size_t>(grid.size.width);
  std::vector<double> solid_angle(width);
  texel_solid_angles(grid.layout, grid.face, grid.size, grid.placement, 0, j, grid.size.width, 1, solid_angle.data());
  constexpr int steps[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
  for (int i = 0; i < grid.size.width; ++i) {
    if (grid.whole(i, j)) {
      const double omega = solid_angle[static_cast<std::size_t>(i)];
      row.smallest = std::min(row.smallest, omega);
      row.largest = std::max(row.largest, omega);
    }
    if (!grid.used(i, j)) continue;
    ++row.used;
    const Vec3 centre = grid.centre(i, j);
    for (int k = 0; k < 4; ++k) {
      const int di = steps[k][0], dj = steps[k][1];
      if (grid.used(i + di, j + dj)) {
        if (k < 2) row.add_distance(angle_between(centre, grid.centre(i + di, j + dj)), 1);
      } else if (const auto other = over_seam(grid, i, j, di, dj)) {
        row.add_distance(angle_between(centre, *other), 0.5);  // the texel over there steps back
      }
    }
  }
  return row;
}

}  // namespace

TexelFigures texel_figures(const Layout& layout, int height) {
  Partial total;
  for (int face = 0; face < layout.face_count(); ++face) {
    const Grid grid(layout, height, face);
    std::vector<Partial> rows(static_cast<std::size_t>(grid.size.height));
    tbb::parallel_for(0, grid.size.height, [&](int j) { rows[static_cast<std::size_t>(j)] = measure_row(grid, j); });
    for (const Partial& row : rows) total.add(row);
  }
  TexelFigures figures;
  figures.stored = texel_count(layout, height);
  figures.used = total.used;
  if (total.largest > 0) figures.smallest = total.smallest, figures.largest = total.largest;
  if (total.weight > 0) figures.mean_distance = total.distance / total.weight;
  figures.largest_distance = total.largest_distance;
  return figures;
}

}  // namespace envconv
