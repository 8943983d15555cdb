// SPDX-License-Identifier: Apache-2.0
// Figures against the papers' (facts), against each other and against plain random sampling (laws).
#include "analyze.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <string>

#include "image.h"
#include "layout_cases.h"

namespace envconv {
namespace {

constexpr double pi = std::numbers::pi;
constexpr double infinity = std::numeric_limits<double>::infinity();

const Layout& layout(std::string_view name) { return *find_layout(name); }

struct Fact {
  const char* layout;
  double requirement, anisotropy;
};

class PublishedFigures : public testing::TestWithParam<Fact> {};

// Herron, table 1 (from Snyder & Mitchell 2001), in closed form where the table's digits are few.
INSTANTIATE_TEST_SUITE_P(
    HerronTable1, PublishedFigures,
    testing::Values(
        Fact{"tennis-ball", 1.5 * pi* pi, std::numbers::sqrt2}, Fact{"polar-capped", 1.5 * pi* pi, std::numbers::sqrt2},
        // A Mercator band 2 ln tan(3 pi/8) high and 2 pi long, two squares of side 4 tan(pi/8), stretch 1.
        Fact{"polar-capped-conformal", 4 * pi* std::log(std::tan(3 * pi / 8)) + 32 * std::pow(std::tan(pi / 8), 2), 1},
        Fact{"dual-equidistant", 2 * pi* pi, pi / 2}, Fact{"latlong", 2 * pi* pi, infinity},
        Fact{"cube", 24, std::numbers::sqrt3}, Fact{"paraboloid", 32, 1}, Fact{"sphere-map", infinity, infinity}),
    [](const testing::TestParamInfo<Fact>& info) {
      std::string name = info.param.layout;
      for (char& c : name)
        if (c == '-') c = '_';
      return name;
    });

TEST_P(PublishedFigures, AreReproduced) {
  const Fact& fact = GetParam();
  const LayoutFigures& f = figures(layout(fact.layout));
  if (std::isfinite(fact.requirement))
    EXPECT_NEAR(f.sampling_requirement, fact.requirement, 1e-5 * fact.requirement);
  else
    EXPECT_EQ(f.sampling_requirement, infinity);
  if (std::isfinite(fact.anisotropy))
    EXPECT_NEAR(f.anisotropy, fact.anisotropy, 1e-5 * fact.anisotropy);
  else
    EXPECT_EQ(f.anisotropy, infinity);
}

TEST(Figures, PublishedDigits) {
  const auto requirement = [](const char* name) { return figures(layout(name)).sampling_requirement; };
  EXPECT_NEAR(requirement("cube"), 24.0, 1e-3);
  EXPECT_NEAR(requirement("latlong"), 19.7, 0.05);
  EXPECT_NEAR(requirement("tennis-ball"), 14.80, 0.005);
  EXPECT_NEAR(requirement("polar-capped"), 14.80, 0.005);
  EXPECT_NEAR(requirement("polar-capped-conformal"), 16.5, 0.1);  // the paper cuts 16.57 off
  EXPECT_NEAR(requirement("dual-equidistant"), 19.7, 0.05);
}

// Other closed forms.
TEST(Figures, SolidAngleOfTexels) {
  // Centre over corner of the cube: (1 + 1 + 1)^(3/2).
  EXPECT_NEAR(figures(layout("cube")).texel_ratio, 3 * std::numbers::sqrt3, 1e-4);
  EXPECT_NEAR(figures(layout("equi-angular-cube")).texel_ratio, std::numbers::sqrt2, 1e-4);
  EXPECT_EQ(figures(layout("latlong")).texel_ratio, infinity);
  EXPECT_NEAR(figures(layout("octahedral")).texel_ratio, 3 * std::numbers::sqrt3, 1e-4);
}

class EveryLayout : public testing::TestWithParam<Layout> {};
INSTANTIATE_TEST_SUITE_P(All, EveryLayout, testing::ValuesIn(all_layouts().begin(), all_layouts().end()),
                         [](const auto& info) { return test::test_name(info.param); });

// No owned point exceeds the suprema, and random points come near them.  Points crowd at edges, centres and diagonals,
// where suprema lie.
TEST_P(EveryLayout, FiguresAreTheSupremaOfRandomPoints) {
  const Layout& l = GetParam();
  const LayoutFigures& f = figures(l);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  const auto near_zero = [&] { return std::pow(10, -6 * uniform(random)); };
  const auto anywhere = [&] {
    const double pick = uniform(random);
    if (pick < 0.25) return uniform(random);
    if (pick < 0.5) return 0.5 * near_zero();
    if (pick < 0.75) return 1 - 0.5 * near_zero();
    return 0.5 + (uniform(random) - 0.5) * near_zero();
  };
  double area = 0;
  for (const Face& face : l.info().faces) area += face.aspect * face.scale * face.scale;
  double largest = 0, anisotropy = 0, density = 0, smallest_density = infinity;
  for (int k = 0; k < 60000; ++k) {
    const int face = k % l.face_count();
    const double u = anywhere();
    double v = anywhere();
    if (k % 5 == 0) v = std::clamp((k % 2 == 0 ? u : 1 - u) + 0.01 * near_zero(), 1e-7, 1 - 1e-7);
    if (!l.owns(face, u, v)) continue;
    const Face& info = l.info().faces[static_cast<std::size_t>(face)];
    const Stretch s = stretch(l, face, u, v);
    const double texel = solid_angle_density(l, face, u, v) / (info.aspect * info.scale * info.scale);
    largest = std::max(largest, s.largest / info.scale);
    anisotropy = std::max(anisotropy, s.largest / s.smallest);
    density = std::max(density, texel);
    smallest_density = std::min(smallest_density, texel);
  }
  const auto check = [](double figure, double sampled, const char* what) {
    if (std::isinf(figure)) {
      EXPECT_GT(sampled, 100) << what;
    } else {
      EXPECT_LT(sampled, figure * (1 + 1e-5)) << what;
      EXPECT_GT(sampled, figure * (1 - 5e-3)) << what;
    }
  };
  check(f.sampling_requirement, area * largest * largest, "sampling requirement");
  check(f.anisotropy, anisotropy, "anisotropy");
  check(f.texel_ratio, density / smallest_density, "texel ratio");
}

TEST_P(EveryLayout, ClaimsHold) {
  const Layout& l = GetParam();
  const LayoutFigures& f = figures(l);
  EXPECT_EQ(f.anisotropy < 1 + 1e-5, l.info().conformal) << f.anisotropy;
  EXPECT_EQ(f.texel_ratio < 1 + 1e-5, l.info().equal_area) << f.texel_ratio;
  // A sphere of 4 pi needs no less, even of a map with anisotropy up to sqrt(3) (table 1, theoretical optimum).
  EXPECT_GT(f.sampling_requirement, 10.9);
}

// Where faces differ in size (the contract's rule for --size).
TEST_P(EveryLayout, ScalesAgreeAtTheFacesCentres) {
  const Layout& l = GetParam();
  if (std::ranges::all_of(l.info().faces, [](const Face& face) { return face.scale == 1; })) return;
  const auto texel = [&](int face) {
    return stretch(l, face, 0.5 + 1e-6, 0.5 + 2e-6).largest / l.info().faces[static_cast<std::size_t>(face)].scale;
  };
  for (int face = 1; face < l.face_count(); ++face) EXPECT_NEAR(texel(face), texel(0), 1e-4 * texel(0));
}

TEST_P(EveryLayout, MatchingHeightKeepsTheWorstTexel) {
  const Layout& source = GetParam();
  for (const int height : {1, 2, 17, 512, 4096}) {
    EXPECT_EQ(matching_height(source, height, source), height);
    for (const Layout& target : all_layouts()) {
      const int matched = matching_height(source, height, target);
      EXPECT_GE(matched, 1);
      // More of the source never asks for less of the target, and back again nothing is lost.
      EXPECT_GE(matching_height(source, height + 1, target), matched);
      EXPECT_GE(matching_height(target, matched, source), height) << source.name() << " " << target.name();
    }
  }
}

TEST(MatchingHeight, Facts) {
  // A latlong texel's height is pi/512; a cube's central texel is 2/N.
  EXPECT_EQ(matching_height(layout("latlong"), 512, layout("cube")), 326);
  EXPECT_EQ(matching_height(layout("cube"), 326, layout("latlong")), 513);
  EXPECT_EQ(matching_height(layout("latlong"), 512, layout("equi-angular-cube")), 296);
  // Texel centres on the edges: one texel more for as many steps.
  EXPECT_EQ(matching_height(layout("latlong"), 512, layout("latlong-inclusive")), 513);
  EXPECT_EQ(matching_height(layout("latlong-inclusive"), 513, layout("latlong")), 512);
  EXPECT_EQ(matching_height(layout("cube"), 256, layout("openexr-cube")), 257);
  // An infinite requirement: as fine as in the centre.  The sphere map's diameter is 4, the cube's face 2.
  EXPECT_EQ(matching_height(layout("sphere-map"), 512, layout("cube")), 256);
  EXPECT_EQ(matching_height(layout("cube"), 256, layout("sphere-map")), 512);
  EXPECT_EQ(matching_height(layout("sphere-map"), 512, layout("mirror-ball")), 512);
  EXPECT_EQ(matching_height(layout("latlong"), 512, layout("tennis-ball")), 256);
}

TEST_P(EveryLayout, HeightForTexelsIsTheLargest) {
  const Layout& l = GetParam();
  for (const std::int64_t texels : {1000LL, 65536LL, 1000000LL, 20000000000LL}) {
    const int height = height_for_texels(l, texels);
    EXPECT_LE(texel_count(l, height), texels);
    EXPECT_GT(texel_count(l, height + 1), texels);
  }
  EXPECT_EQ(height_for_texels(l, texel_count(l, 100)), 100);
  EXPECT_EQ(height_for_texels(l, 0), 1);
}

TEST(Stretch, FollowsHerronsEquationFive) {
  // Lat-long: pi radians per height along a meridian, pi cos(latitude) along a parallel.
  const Stretch s = stretch(layout("latlong"), 0, 0.3, 0.25);
  EXPECT_NEAR(s.largest, pi, 1e-12);
  EXPECT_NEAR(s.smallest, pi * std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(solid_angle_density(layout("latlong"), 0, 0.3, 0.25), 2 * pi * pi * std::sqrt(0.5), 1e-12);
  // A cube's face: 2 per face in the centre.
  EXPECT_NEAR(stretch(layout("cube"), 3, 0.5, 0.5).largest, 2, 1e-12);
  EXPECT_NEAR(stretch(layout("cube"), 3, 0.5, 0.5).smallest, 2, 1e-12);
}

}  // namespace
}  // namespace envconv
