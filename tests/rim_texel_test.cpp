// SPDX-License-Identifier: Apache-2.0
// Integrals over squares that a circle cuts, against those by rows of thin strips.
#include "rim_texel.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "quadrature.h"

namespace envconv {
namespace {

// Of f(x, y), from the square's centre.
template <class F>
double by_chords(const RimTexel& texel, int nodes, const F& f) {
  const Quadrature out = box_quadrature(nodes), aside = box_quadrature(4);
  double sum = 0;
  for (int piece = 0; piece < texel.pieces(); ++piece)
    for (std::size_t k = 0; k < out.offset.size(); ++k) {
      const RimTexel::Node node = texel.node(piece, out.offset[k], out.weight[k]);
      const RimTexel::Chord chord = texel.chord(node.outwards);
      const double length = chord.end - chord.begin;
      for (std::size_t m = 0; m < aside.offset.size(); ++m) {
        const auto [x, y] = texel.place(node.outwards, 0.5 * (chord.begin + chord.end) + length * aside.offset[m]);
        EXPECT_LE(std::max(std::abs(x), std::abs(y)), 0.5 + 1e-12);
        sum += node.weight * length * aside.weight[m] * f(x, y);
      }
    }
  return sum;
}

// The same over strips of constant x, each up to the circle about (-centre_x, -centre_y).
template <class F>
double by_strips(double centre_x, double centre_y, double radius, const F& f) {
  constexpr int strips = 2000, nodes = 100;
  double sum = 0;
  for (int i = 0; i < strips; ++i) {
    const double x = (i + 0.5) / strips - 0.5, square = radius * radius - (centre_x + x) * (centre_x + x);
    if (square <= 0) continue;
    const double low = std::max(-0.5, -std::sqrt(square) - centre_y),
                 high = std::min(0.5, std::sqrt(square) - centre_y);
    for (int j = 0; j < nodes && low < high; ++j)
      sum += (high - low) / nodes / strips * f(x, low + (high - low) * (j + 0.5) / nodes);
  }
  return sum;
}

TEST(RimTexel, IntegratesWhatIsInsideOfTheCircle) {
  constexpr double radius = 200;
  for (const double angle : {0.0, 0.003, 0.4, M_PI / 4, 1.2, M_PI / 2, 2.5, -2.0})
    for (const double inwards : {1.0, 0.5, 0.2, 0.0, -0.3}) {
      const double x = (radius - inwards) * std::cos(angle), y = (radius - inwards) * std::sin(angle);
      const RimTexel texel(x, y, radius);
      const auto one = [](double, double) { return 1.0; };
      const auto mixed = [](double a, double b) { return 1 + a + 2 * b + 3 * a * b + a * a; };
      // A sphere's direction goes as the root of the distance from the rim, so that waves on it do too.
      const auto wave = [&](double a, double b) {
        return std::cos(9 * std::sqrt(std::max(0.0, radius - std::hypot(x + a, y + b))));
      };
      // A chord of length 1 has so much less than its arc at the most, where the circle just touches a side.
      constexpr double bulge = 1 / (24 * radius);
      EXPECT_NEAR(by_chords(texel, 8, one), by_strips(x, y, radius, one), 1.01 * bulge) << angle << ", " << inwards;
      EXPECT_NEAR(by_chords(texel, 8, mixed), by_strips(x, y, radius, mixed), 5e-4) << angle << ", " << inwards;
      EXPECT_NEAR(by_chords(texel, 8, wave), by_strips(x, y, radius, wave), 1e-3) << angle << ", " << inwards;
    }
}

TEST(RimTexel, IsAWholeSquareAwayFromTheRim) {
  for (const double angle : {0.1, 0.7, 3.0}) {
    const RimTexel texel(50 * std::cos(angle), 50 * std::sin(angle), 60);
    EXPECT_NEAR(by_chords(texel, 6, [](double, double) { return 1.0; }), 1, 1e-9);
    EXPECT_NEAR(by_chords(texel, 6, [](double x, double) { return x * x; }), 1.0 / 12, 1e-9);
    EXPECT_NEAR(by_chords(texel, 6, [](double x, double y) { return x * y; }), 0, 1e-9);
  }
}

TEST(RimTexel, HasNoPiecesBeyondTheRim) {
  EXPECT_EQ(RimTexel(21, 0, 20).pieces(), 0);
  EXPECT_EQ(RimTexel(15, 15, 20).pieces(), 0);
  EXPECT_GT(RimTexel(20, 0, 20).pieces(), 0);
}

}  // namespace
}  // namespace envconv
