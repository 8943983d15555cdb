// SPDX-License-Identifier: Apache-2.0
// Creases against where the layouts' formulas have them.
#include "creases.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string_view>

namespace envconv {
namespace {

constexpr int size = 256, side = 64;

EnvImage of(const Layout& layout) {
  EnvImage image;
  image.layout = &layout;
  image.placement = layout.info().placement;
  for (int f = 0; f < layout.face_count(); ++f) {
    const Size s = face_size(layout, f, size);
    image.faces.emplace_back(s.width, s.height, 3);
  }
  return image;
}

// visit(face, x, y, near, across) for all texels.
template <class Visit>
void for_each_texel(std::string_view name, const Visit& visit) {
  const EnvImage image = of(*find_layout(name));
  for (int f = 0; f < image.layout->face_count(); ++f) {
    const Image& face = image.faces[static_cast<std::size_t>(f)];
    for (int y = 0; y < face.height(); y += side)
      for (int x = 0; x < face.width(); x += side) {
        const Tile tile{f, x, y, std::min(side, face.width() - x), std::min(side, face.height() - y)};
        const Creases creases = find_creases(image, tile);
        bool any_near = false, any_across = false;
        for (int j = 0; j < tile.height; ++j)
          for (int i = 0; i < tile.width; ++i) {
            const bool near = creases.near.holds(i, j), across = creases.across.holds(i, j);
            EXPECT_TRUE(near || !across);
            any_near = any_near || near, any_across = any_across || across;
            visit(f, x + i, y + j, near, across);
          }
        EXPECT_EQ(creases.near.any, any_near);
        EXPECT_EQ(creases.across.any, any_across);
      }
  }
}

// How far a window about the texel must reach, in texels, to meet one of the lines; x and y from the face's middle.
using Distance = double (*)(double x, double y);
// About points where a crease ends, or is flat.
using Flat = bool (*)(double x, double y);

bool is_near(double x, double y, double to_x, double to_y) {
  return std::max(std::abs(x - to_x), std::abs(y - to_y)) < size / 48.0;
}

void expect_creases_at(std::string_view name, std::span<const int> faces, Distance distance, Flat flat) {
  for_each_texel(name, [&](int face, int x, int y, bool near, bool across) {
    const double a = std::abs(x + 0.5 - size / 2.0), b = std::abs(y + 0.5 - size / 2.0);
    if (flat(a, b)) return;
    const double away = std::ranges::find(faces, face) == faces.end() ? size : distance(a, b);
    const bool unclear = away > grid_reach - 1 && away <= grid_reach + 5, unclear_across = away >= 0.5 && away <= 4;
    EXPECT_TRUE(unclear || near == (away < grid_reach)) << name << " face " << face << " at " << x << ", " << y;
    EXPECT_TRUE(unclear_across || across == (away < 1)) << name << " face " << face << " at " << x << ", " << y;
  });
}

// Praun and Hoppe, section 3: the octahedron's edges are the face's middle lines, the square on its tip, and the rim.
// Seen from the octahedron's centre, edges do not bend at its tips, nor those of the square in their middles.
TEST(Creases, AreTheOctahedronsEdges) {
  for (const std::string_view name : {"octahedral", "octahedral-equal-area"})
    expect_creases_at(
        name, std::array{0},
        [](double x, double y) {
          constexpr double half = size / 2.0;
          return std::min({x, y, half - x, half - y, 0.5 * std::abs(x + y - half)});
        },
        [](double x, double y) {
          constexpr double half = size / 2.0;
          return is_near(x, y, 0, 0) || is_near(x, y, half, half) || is_near(x, y, half / 2, half / 2);
        });
}

// Wan, Wong and Leung, appendix C: the polar faces are divided along their diagonals.
TEST(Creases, AreTheIsocubesDiagonals) {
  expect_creases_at(
      "isocube", std::array{2, 3}, [](double x, double y) { return 0.5 * std::abs(x - y); },
      [](double x, double y) { return is_near(x, y, 0, 0); });
}

TEST(Creases, AreNoneWhereOneFormulaServesAFace) {
  for (const std::string_view name : {"latlong", "cube", "equi-angular-cube", "openexr-cube", "paraboloid",
                                      "dual-equidistant", "tennis-ball", "polar-capped", "diamond-8", "diamond-12"})
    for_each_texel(name, [&](int face, int x, int y, bool near, bool) {
      EXPECT_FALSE(near) << name << " face " << face << " at " << x << ", " << y;
    });
}

}  // namespace
}  // namespace envconv
