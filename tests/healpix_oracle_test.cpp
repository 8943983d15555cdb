// SPDX-License-Identifier: Apache-2.0
// HEALPix against the authors' C library (GPL: linked by this test only).
#include <chealpix.h>
#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "layout.h"
#include "layout_cases.h"

namespace envconv {
namespace {

// The nested index interleaves the bits of x (even bits) and y (odd bits) below the base pixel's number.
struct Nested {
  long base, x, y;
};
Nested split(long index, long side) {
  Nested n{index / (side * side), 0, 0};
  const long within = index % (side * side);
  for (int bit = 0; bit < 24; ++bit) {
    n.x |= ((within >> (2 * bit)) & 1) << bit;
    n.y |= ((within >> (2 * bit + 1)) & 1) << bit;
  }
  return n;
}

TEST(Healpix, TexelCentresAreThePixels) {
  const Layout& layout = *find_layout("healpix");
  for (const long side : {1L, 2L, 8L, 64L})
    for (long index = 0; index < 12 * side * side; ++index) {
      double theta, phi;
      pix2ang_nest(side, index, &theta, &phi);
      const Vec3 theirs{std::sin(theta) * std::sin(phi), std::cos(theta), std::sin(theta) * std::cos(phi)};
      const Nested n = split(index, side);
      const double u = 1 - (n.y + 0.5) / side, v = 1 - (n.x + 0.5) / side;  // x = 1-v, y = 1-u
      const Vec3 ours = layout.direction(static_cast<int>(n.base), u, v);
      ASSERT_LT(angle_between(ours, theirs), 1e-12) << "nside " << side << " pixel " << index;
    }
}

TEST(Healpix, DirectionsBelongToTheSamePixels) {
  const Layout& layout = *find_layout("healpix");
  constexpr long side = 1024;
  test::RandomDirections random(30);
  for (int n = 0; n < 200000; ++n) {
    Vec3 d = random();
    if (n % 4 == 0) d = normalize({d.x * 0.01, d.y, d.z * 0.01});  // a quarter of them about the poles
    long index;
    ang2pix_nest(side, std::atan2(std::hypot(d.x, d.z), d.y), std::atan2(d.x, d.z), &index);
    const Nested theirs = split(index, side);
    const Location at = layout.locate(d);
    const double x = (1 - at.v) * side, y = (1 - at.u) * side;
    // Directions within rounding of a pixel's border may fall on either side.
    if (std::abs(x - std::round(x)) < 1e-6 || std::abs(y - std::round(y)) < 1e-6) continue;
    ASSERT_EQ(at.face, theirs.base) << d.x << ' ' << d.y << ' ' << d.z;
    ASSERT_EQ(static_cast<long>(x), theirs.x) << d.x << ' ' << d.y << ' ' << d.z;
    ASSERT_EQ(static_cast<long>(y), theirs.y) << d.x << ' ' << d.y << ' ' << d.z;
  }
}

TEST(Healpix, TexelsBeyondAnEdgeAreTheNeighbours) {
  // Grids of neighbouring faces align, so an apron of half a face holds whole texels of theirs.
  const Layout& layout = *find_layout("healpix");
  constexpr int side = 8;
  for (int face = 0; face < 12; ++face)
    for (int out = 0; out < side / 2; ++out)
      for (int along = 0; along < side; ++along) {
        const double before = -(out + 0.5) / side, after = 1 + (out + 0.5) / side, t = (along + 0.5) / side;
        for (const auto& [u, v] : {std::pair{before, t}, {after, t}, {t, before}, {t, after}}) {
          const Location at = layout.locate(layout.direction(face, u, v));
          EXPECT_NE(at.face, face) << u << ' ' << v;
          const double i = at.u * side - 0.5, j = at.v * side - 0.5;
          EXPECT_NEAR(i, std::round(i), 1e-12) << face << ' ' << u << ' ' << v;
          EXPECT_NEAR(j, std::round(j), 1e-12) << face << ' ' << u << ' ' << v;
        }
      }
}

TEST(Healpix, PolesAndTheCentreOfTheView) {
  const Layout& layout = *find_layout("healpix");
  for (int face = 0; face < 4; ++face) EXPECT_LT(angle_between(layout.direction(face, 0, 0), {0, 1, 0}), 1e-15);
  for (int face = 8; face < 12; ++face) EXPECT_LT(angle_between(layout.direction(face, 1, 1), {0, -1, 0}), 1e-15);
  EXPECT_LT(angle_between(layout.direction(4, 0.5, 0.5), {0, 0, 1}), 1e-15);
  EXPECT_LT(angle_between(layout.direction(5, 0.5, 0.5), {1, 0, 0}), 1e-15);
}

}  // namespace
}  // namespace envconv
