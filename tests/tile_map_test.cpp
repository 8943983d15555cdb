// SPDX-License-Identifier: Apache-2.0
// Tiles' polynomials against the layouts' formulas.
#include "tile_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

namespace envconv {
namespace {

constexpr int side = 64;
constexpr double reach = grid_reach;

EnvImage of(const Layout& layout, int height) {
  EnvImage image;
  image.layout = &layout;
  image.placement = layout.info().placement;
  image.channels = Channels::standard(3);
  for (int f = 0; f < layout.face_count(); ++f) {
    const Size s = face_size(layout, f, height);
    image.faces.emplace_back(s.width, s.height, 3);
  }
  return image;
}

// The height at which a layout has about as many texels as a cube of faces of `cube`.
int height_like(const Layout& layout, int cube) {
  const double texels = 6.0 * cube * cube / static_cast<double>(texel_count(layout, 256)) * 256 * 256;
  return std::max(1, static_cast<int>(std::sqrt(texels)));
}

// Turned, so that no axis of one layout is one of the other's.
Mat3 turned() {
  const double a = 0.3, b = -0.7;
  Mat3 x, y;
  x.m = {1, 0, 0, 0, std::cos(a), -std::sin(a), 0, std::sin(a), std::cos(a)};
  y.m = {std::cos(b), 0, std::sin(b), 0, 1, 0, -std::sin(b), 0, std::cos(b)};
  return x * y;
}

// Compares every `stride`-th tile's map, where it has one, with the formulas, in places in and around it.  Returns the
// share of tiles that have one.
double compare(const EnvImage& image, const Source& source, const EnvImage& out, const Mat3& source_from_out,
               int stride) {
  const Layout &from = *image.layout, &to = *out.layout;
  int tiles = 0, mapped = 0;
  const std::vector<float> weight(batch_room, 1.0f);
  const auto windows = std::make_unique<Windows>();
  int number = 0;
  for (int f = 0; f < to.face_count(); ++f) {
    const Image& face = out.faces[static_cast<std::size_t>(f)];
    for (int y = 0; y + side <= face.height(); y += side)
      for (int x = 0; x + side <= face.width(); x += side) {
        if (number++ % stride != 0) continue;
        const Tile tile{f, x, y, side, side};
        const TilePlan plan = plan_tile(image, out, source_from_out, all_filters().front(), {}, tile);
        ++tiles;
        const auto map = TileMap::find(source, out, source_from_out, tile, plan, reach);
        if (!map) continue;
        ++mapped;
        const SourceFace& seen = source.faces()[static_cast<std::size_t>(map->face())];
        for (double t = -reach; t <= side + reach; t += 1.7) {
          const RowMap row = map->row(tile_variable(t, side));
          constexpr int n = side + 2 * static_cast<int>(reach);
          const double first = 0.25 - reach;
          make_windows_along(row, Kernel::bilinear, static_cast<float>(tile_variable(first, side)),
                             static_cast<float>(4.0 / side), 0, n, weight.data(), *windows);
          for (int i = 0; i < n; i += 3) {
            const Location at = source.layout().locate(
                source_from_out * to.direction(f, u_from_texel(x - 0.5 + first + i, face.width(), out.placement),
                                               u_from_texel(y - 0.5 + t, face.height(), out.placement)));
            const auto k = static_cast<std::size_t>(i);
            EXPECT_EQ(at.face, map->face()) << from.name() << " to " << to.name() << ", face " << f << " at " << x;
            const double px = texel_from_u(at.u, seen.size.width, source.placement()) + source.apron();
            const double py = texel_from_u(at.v, seen.size.height, source.placement()) + source.apron();
            EXPECT_NEAR(windows->x[k] + static_cast<double>(windows->fx[k]), px, 1e-3)
                << from.name() << " to " << to.name() << ", face " << f << " at " << x << ", " << y;
            EXPECT_NEAR(windows->y[k] + static_cast<double>(windows->fy[k]), py, 1e-3)
                << from.name() << " to " << to.name() << ", face " << f << " at " << x << ", " << y;
          }
        }
      }
  }
  return static_cast<double>(mapped) / tiles;
}

// Whatever the two layouts fold, cut or bend, a tile has no polynomials or right ones.
TEST(TileMap, IsTheFormulaOfEveryPairOfLayouts) {
  for (const Layout& from : all_layouts()) {
    EnvImage image = of(from, height_like(from, 256));
    const Source source(image, &image, 0, all_filters().front());
    for (const Layout& to : all_layouts())
      for (const Mat3& rotation : {Mat3{}, turned()}) compare(image, source, of(to, height_like(to, 256)), rotation, 5);
  }
}

// Where tiles are small on the sphere, most have one: otherwise the test above tells nothing.
TEST(TileMap, IsFoundWhereTilesAreSmall) {
  EnvImage image = of(*find_layout("latlong"), 1024);
  const Source source(image, &image, 0, all_filters().front());
  for (const char* to : {"cube", "isocube", "diamond-12", "healpix"})
    EXPECT_GT(compare(image, source, of(*find_layout(to), height_like(*find_layout(to), 1024)), turned(), 11), 0.5)
        << to;
}

}  // namespace
}  // namespace envconv
