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
#include "texel_figures.h"

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
    const double texel = l.density(face, u, v) / (info.aspect * info.scale * info.scale);
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
  EXPECT_NEAR(layout("latlong").density(0, 0.3, 0.25), 2 * pi * pi * std::sqrt(0.5), 1e-12);
  // A cube's face: 2 per face in the centre.
  EXPECT_NEAR(stretch(layout("cube"), 3, 0.5, 0.5).largest, 2, 1e-12);
  EXPECT_NEAR(stretch(layout("cube"), 3, 0.5, 0.5).smallest, 2, 1e-12);
}

// --- layouts that no paper has figures of: closed forms at the extremal points, and brute force
// --------------------------

// The larger eigenvalue of a symmetric 2x2 matrix with this trace and this determinant.
double larger_eigenvalue(double trace, double determinant) {
  return 0.5 * (trace + std::sqrt(trace * trace - 4 * determinant));
}

// Square of the largest stretch in a diamond's centre.  The great circle through points M and M' of two opposite edges,
// one the other turned about the centre c by half a turn, both moved along by S du, is displaced in c by
// S t / (c . M), t being the edge's tangent at M: its part across the circle is what a step in u means there.
double stretch_in_the_centre(Vec3 p0, Vec3 p1, Vec3 p2, Vec3 p3) {
  const double S = angle_between(p0, p1);
  const Vec3 c = normalize(p0 + p2);
  const auto across = [&](Vec3 a, Vec3 b, double& displacement) {
    const Vec3 M = normalize(a + b), normal = normalize(cross(c, M));
    displacement = S * dot(normalize(b - a), normal) / dot(c, M);
    return normal;
  };
  double by_u, by_v;
  const Vec3 nu = across(p0, p1, by_u), nv = across(p0, p3, by_v);
  // dx . nu = by_u du, dx . nv = by_v dv; with the dual basis, |dual of nu|^2 = 1 / sin^2 and so on.
  const double cosine = dot(nu, nv), sine2 = 1 - cosine * cosine;
  const double E = by_u * by_u / sine2, G = by_v * by_v / sine2, F = -by_u * by_v * cosine / sine2;
  return larger_eigenvalue(E + G, E * G - F * F);
}

Vec3 at_azimuth(double turns, double y) {
  const double r = std::sqrt(1 - y * y);
  return {r * std::sin(2 * pi * turns), y, r * std::cos(2 * pi * turns)};
}

Fact isocube_fact() {
  // At the pole along a diagonal: rows (2P, 0) and (-2Q, 2Q), P^2 = 2/3, Q^2 = pi^2/24.
  const double area = 2 * pi / 3, squared = larger_eigenvalue(8.0 / 3 + pi * pi / 3, area * area);
  return {"isocube", 6 * squared, squared / area};
}
Fact healpix_fact() {
  // At the pole along an edge; half of the isocube's squares, and twice its faces.
  const double area = pi / 3, squared = larger_eigenvalue(4.0 / 3 + pi * pi / 6, area * area);
  return {"healpix", 12 * squared, squared / area};
}
Fact octahedral_equal_area_fact() {
  // On the equator, where it meets a crease: height 1 - r^2 and azimuth (pi/2) w at the radius r = 1.
  const double area = 4 * pi, squared = larger_eigenvalue(32 + pi * pi, area * area);
  return {"octahedral-equal-area", squared, squared / area};
}
Fact diamond_fact(const char* name, int m) {
  // Anisotropy: in the corner of 180 - 180/m degrees two edges of one length meet.
  const double k = std::cos(pi / m), c = (std::sqrt(1 + 4 * k * (1 + k)) - 1) / (2 * (1 + k));
  const Vec3 pole{0, 1, 0}, east = at_azimuth(1.0 / m, c), west = at_azimuth(0, c), below = at_azimuth(0.5 / m, -c);
  const double squared = stretch_in_the_centre(pole, east, below, west);
  // The expression above is twice the edge's square.
  EXPECT_NEAR(squared, 2 * std::pow(angle_between(pole, east), 2), 1e-12);
  return {name, 2 * m * squared, std::tan(pi / 2 - pi / 2 / m)};
}
Fact diamond_12_fact() {
  const double r = 1 / std::numbers::sqrt3;
  return {"diamond-12", 12 * stretch_in_the_centre({1, 0, 0}, {r, r, r}, {0, 1, 0}, {r, r, -r}), std::numbers::sqrt3};
}
Fact diamond_30_fact() {
  const Vec3 north{0, 1, 0};
  const auto ring = [](int i) { return at_azimuth(i / 5.0, 1 / std::sqrt(5.0)); };
  const Vec3 p1 = normalize(north + ring(0) + ring(1)), p3 = normalize(north + ring(0) + ring(4));
  return {"diamond-30", 30 * stretch_in_the_centre(north, p1, ring(0), p3), std::numbers::sqrt3};
}

INSTANTIATE_TEST_SUITE_P(
    ClosedForms, PublishedFigures,
    testing::Values(isocube_fact(), healpix_fact(), octahedral_equal_area_fact(),
                    // Each facet is seen nearest in its centre; where facets meet at +X, its neighbour from the side.
                    Fact{"octahedral", 36, (3 + std::sqrt(5.0)) / 2}, diamond_fact("diamond-6", 3),
                    diamond_fact("diamond-8", 4), diamond_fact("diamond-10", 5), diamond_12_fact(), diamond_30_fact()),
    [](const testing::TestParamInfo<Fact>& info) {
      std::string name = info.param.layout;
      for (char& c : name)
        if (c == '-') c = '_';
      return name;
    });

// Singular values from finite differences of the direction alone, on a grid that is refined around its best point: no
// derivative of the library's has a part in it.
struct GridPoint {
  int face = 0;
  double u = 0.5, v = 0.5, value = -1;
};
test::Stretch difference_stretch(const Layout& l, int face, double u, double v, double step) {
  const Face& f = l.info().faces[static_cast<std::size_t>(face)];
  const auto d = [&](double du, double dv) { return l.direction(face, u + du, v + dv); };
  const double scale = 1 / (2 * step * f.scale);
  return test::stretch((scale / f.aspect) * (d(step, 0) - d(-step, 0)), scale * (d(0, step) - d(0, -step)));
}
// The best texel centres of a grid over a window of a face, one for each of 4x4 blocks.  The grid is not square, so
// that its points keep off diagonals, where creases run.
template <class Measure>
std::vector<GridPoint> best_of_blocks(const Layout& l, const GridPoint& centre, double window, const Measure& measure) {
  constexpr int nu = 24, nv = 28, blocks = 4;
  std::vector<GridPoint> best(blocks * blocks);
  for (int j = 0; j < nv; ++j)
    for (int i = 0; i < nu; ++i) {
      const double u = centre.u + window * ((i + 0.5) / nu - 0.5), v = centre.v + window * ((j + 0.5) / nv - 0.5);
      const double step = 0.05 * window / nv;
      if (u < step || u > 1 - step || v < step || v > 1 - step || !l.owns(centre.face, u, v)) continue;
      GridPoint& block = best[static_cast<std::size_t>(j * blocks / nv * blocks + i * blocks / nu)];
      const double value = measure(difference_stretch(l, centre.face, u, v, step));
      if (value > block.value) block = {centre.face, u, v, value};
    }
  return best;
}
// The best blocks of windows refined again and again: the largest value after each round.
template <class Measure>
std::vector<double> refined(const Layout& l, const std::vector<GridPoint>& centres, double window,
                            const Measure& measure) {
  std::vector<GridPoint> next = centres, points;
  std::vector<double> values;
  for (;; window *= 0.25) {
    points.clear();
    for (const GridPoint& point : next) {
      const std::vector<GridPoint> blocks = best_of_blocks(l, point, window, measure);
      points.insert(points.end(), blocks.begin(), blocks.end());
    }
    std::ranges::sort(points, [](const GridPoint& a, const GridPoint& b) { return a.value > b.value; });
    values.push_back(points.front().value);
    if (values.size() == 8) return values;
    // Symmetric places give the same values again and again.
    next.clear();
    for (const GridPoint& point : points)
      if (point.value > 0 && next.size() < 24 && (next.empty() || point.value < next.back().value * (1 - 3e-3)))
        next.push_back(point);
  }
}
// The supremum's relative error after each round.
template <class Measure>
std::vector<double> errors_of_refinement(const Layout& l, double truth, const Measure& measure) {
  // Where creases meet in a pole, a supremum is approached along one and towards the pole at once: small windows there
  // too, in centres, corners and middles of edges.
  std::vector<GridPoint> faces, poles;
  for (int face = 0; face < l.face_count(); ++face) {
    faces.push_back({face, 0.5, 0.5, -1});
    for (int k = 0; k < 9; ++k) poles.push_back({face, 0.5 * (k % 3), 0.5 * (k / 3), -1});
  }
  const std::vector<double> a = refined(l, faces, 1, measure), b = refined(l, poles, 0.01, measure);
  std::vector<double> errors;
  for (std::size_t i = 0; i < a.size(); ++i) errors.push_back(std::abs(std::max(a[i], b[i]) / truth - 1));
  return errors;
}

TEST(Figures, BruteForceConvergesToThem) {
  for (const char* name : {"isocube", "healpix", "octahedral", "octahedral-equal-area", "diamond-6", "diamond-8",
                           "diamond-10", "diamond-12", "diamond-30", "cube", "equi-angular-cube", "tennis-ball"}) {
    const Layout& l = layout(name);
    double area = 0;
    for (const Face& face : l.info().faces) area += face.aspect * face.scale * face.scale;
    const auto check = [&](const auto& measure, double figure, const char* what) {
      const std::vector<double> errors = errors_of_refinement(l, figure, measure);
      EXPECT_LT(errors[0], 0.15) << name << " " << what;
      EXPECT_LT(errors[3], 0.02) << name << " " << what;
      EXPECT_LT(errors.back(), 5e-5) << name << " " << what;  // four digits
    };
    check([&](const test::Stretch& s) { return area * s.largest * s.largest; }, figures(l).sampling_requirement,
          "sampling requirement");
    check([](const test::Stretch& s) { return s.largest / s.smallest; }, figures(l).anisotropy, "anisotropy");
  }
}

// The texels of one size approach the limit, and add up.
TEST_P(EveryLayout, TexelsApproachTheLimit) {
  const Layout& l = GetParam();
  double last = std::numeric_limits<double>::infinity();
  for (const std::int64_t about : {1000, 8000, 64000}) {
    const int height = height_for_texels(l, about);
    const TexelFigures t = texel_figures(l, height);
    EXPECT_EQ(t.stored, texel_count(l, height));
    EXPECT_LE(t.used, t.stored);
    const double texels = static_cast<double>(t.stored), limit = figures(l).largest_texel;
    // Inclusive placement cuts the outermost texels in half.
    const bool inclusive = l.info().placement == Placement::inclusive;
    // Sizes that are no whole numbers are rounded up.
    const bool rounded = std::ranges::any_of(l.info().faces, [](const Face& f) { return f.scale != 1; });
    if (std::isfinite(limit) && !inclusive && !rounded) {
      EXPECT_LT(t.largest * texels, limit * (1 + 2e-5)) << height;
      EXPECT_GT(t.smallest * texels, figures(l).smallest_texel * (1 - 2e-5)) << height;
      const double missing = limit - t.largest * texels;
      EXPECT_LE(missing, 0.5 * last + 2e-5 * limit) << height;
      last = missing;
    }
    // Neighbours are about a texel's side apart.
    const double side = std::sqrt(4 * pi / static_cast<double>(t.used));
    EXPECT_GT(t.mean_distance, 0.8 * side) << height;
    EXPECT_LT(t.mean_distance, 1.6 * side) << height;
    EXPECT_GE(t.largest_distance, t.mean_distance);
  }
}

TEST(TexelFigures, ClosedForms) {
  // A cube of one texel a face: six centres at right angles, each texel a sixth.
  const TexelFigures one = texel_figures(layout("cube"), 1);
  EXPECT_EQ(one.used, 6);
  EXPECT_NEAR(one.smallest, 4 * pi / 6, 1e-6);
  EXPECT_NEAR(one.largest, 4 * pi / 6, 1e-6);
  EXPECT_NEAR(one.mean_distance, pi / 2, 1e-12);
  EXPECT_NEAR(one.largest_distance, pi / 2, 1e-12);
  // A lat-long of 64x32: solid angles by Archimedes, neighbours along a meridian a step apart, and over the pole one
  // step too.
  const TexelFigures t = texel_figures(layout("latlong"), 32);
  const double step = pi / 32;
  EXPECT_NEAR(t.smallest, step * (1 - std::cos(step)), 1e-9);
  EXPECT_NEAR(t.largest, step * std::sin(step), 1e-9);
  EXPECT_NEAR(t.largest_distance, step, 1e-12);
  // Equal solid angles.
  EXPECT_NEAR(texel_figures(layout("isocube"), 20).smallest, 4 * pi / 2400, 1e-12);
  EXPECT_NEAR(texel_figures(layout("healpix"), 16).largest, 4 * pi / 3072, 1e-12);
  // A disc in its square.
  const TexelFigures disc = texel_figures(layout("sphere-map"), 512);
  EXPECT_NEAR(static_cast<double>(disc.used) / static_cast<double>(disc.stored), pi / 4, 1e-3);
}

}  // namespace
}  // namespace envconv
