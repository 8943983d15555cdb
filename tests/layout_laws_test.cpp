// SPDX-License-Identifier: Apache-2.0
// Laws that hold for every layout, in double.  Laws 2 to 4 check that both maps agree with each other; laws 5 to 10 see
// what a round trip cannot: mirrored or turned faces, wrong claims, edges that lead nowhere.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>

#include "layout.h"
#include "layout_cases.h"

namespace envconv {
namespace {

using test::RandomDirections;
using test::Stretch;

constexpr double pi = 3.14159265358979323846;

std::string text(Vec3 d) {
  char buffer[128];
  std::snprintf(buffer, sizeof buffer, "(%.17g, %.17g, %.17g)", d.x, d.y, d.z);
  return buffer;
}
std::string text(int face, double u, double v) {
  char buffer[128];
  std::snprintf(buffer, sizeof buffer, "face %d (%.17g, %.17g)", face, u, v);
  return buffer;
}
bool finite(Vec3 d) { return std::isfinite(d.x) && std::isfinite(d.y) && std::isfinite(d.z); }

// Singular values per unit of height of face 0, in which all texels are squares of one size.
Stretch texel_stretch(const Face& face, const DirectionJet& jet) {
  return test::stretch((1 / (face.aspect * face.scale)) * jet.du, (1 / face.scale) * jet.dv);
}

class Laws : public testing::TestWithParam<const Layout*> {
 protected:
  const Layout& layout() const { return *GetParam(); }
  const LayoutInfo& info() const { return layout().info(); }

  struct Point {
    int face;
    double u, v;
  };
  // `count` random owned points of every face.
  std::vector<Point> owned_points(int count, unsigned seed) const {
    RandomDirections random(seed);
    std::vector<Point> points;
    for (int face = 0; face < layout().face_count(); ++face)
      for (int n = 0; n < count;) {
        const double u = random.uniform(), v = random.uniform();
        if (!layout().owns(face, u, v)) continue;
        points.push_back({face, u, v});
        ++n;
      }
    return points;
  }
};

TEST_P(Laws, L01_DirectionsHaveUnitLength) {
  RandomDirections random(1);
  for (int face = 0; face < layout().face_count(); ++face)
    for (int n = 0; n < 2000; ++n) {
      // Far beyond the edges too: two faces away from the centre.
      const double u = 0.5 + 4 * (random.uniform() - 0.5), v = 0.5 + 4 * (random.uniform() - 0.5);
      const Vec3 d = layout().direction(face, u, v);
      ASSERT_TRUE(finite(d)) << text(face, u, v);
      ASSERT_NEAR(length(d), 1, 1e-14) << text(face, u, v);
    }
  for (int face = 0; face < layout().face_count(); ++face)
    for (const double u : {-1.5, -1.0, -0.5, 0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5})
      for (const double v : {-1.5, -1.0, -0.5, 0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5}) {
        const Vec3 d = layout().direction(face, u, v);
        ASSERT_TRUE(finite(d)) << text(face, u, v);
        ASSERT_NEAR(length(d), 1, 1e-14) << text(face, u, v);
      }
}

TEST_P(Laws, L02_LocateReturnsOwnedPoints) {
  for (const auto& [face, u, v] : owned_points(2000, 2)) {
    const DirectionJet jet = layout().direction_jet(face, u, v);
    const Location back = layout().locate(jet.d);
    ASSERT_EQ(back.face, face) << text(face, u, v);
    // Where the map crowds directions (poles, rims) u and v are only as good as the direction's rounding.
    const double smallest = test::stretch(jet.du, jet.dv).smallest;
    const double tolerance = 1e-12 + 1e-14 / std::max(smallest, 1e-12);
    ASSERT_NEAR(back.u, u, tolerance) << text(face, u, v);
    ASSERT_NEAR(back.v, v, tolerance) << text(face, u, v);
  }
}

TEST_P(Laws, L03_DirectionReturnsLocated) {
  std::vector<Vec3> directions = test::adversarial_directions<double>();
  RandomDirections random(3);
  for (int n = 0; n < 20000; ++n) directions.push_back(std::pow(10.0, 12 * random.uniform() - 6) * random());
  for (const Vec3& d : directions) {
    const Location at = layout().locate(d);
    ASSERT_GE(at.face, 0) << text(d);
    ASSERT_LT(at.face, layout().face_count()) << text(d);
    const double angle = angle_between(layout().direction(at.face, at.u, at.v), d);
    // At a rim of infinite stretch half of the digits of u are all there are.
    double tolerance = 1e-14;
    const DirectionJet jet = layout().direction_jet(at.face, at.u, at.v);
    const double largest = test::stretch(jet.du, jet.dv).largest;
    tolerance += 1e-15 * (std::isfinite(largest) ? std::min(largest, 1e8) : 1e8);
    if (info().domain == Domain::disc && std::hypot(2 * at.u - 1, 2 * at.v - 1) > 1 - 1e-9) tolerance = 1e-7;
    ASSERT_LE(angle, tolerance) << text(d) << " -> " << text(at.face, at.u, at.v);
  }
}

TEST_P(Laws, L04_LocateIsTotal) {
  std::vector<Vec3> directions = test::adversarial_directions<double>();
  RandomDirections random(4);
  for (int n = 0; n < 20000; ++n)  // each component of its own magnitude
    directions.push_back({std::pow(10.0, 12 * random.uniform() - 6) * (random.uniform() < 0.5 ? -1 : 1),
                          std::pow(10.0, 12 * random.uniform() - 6) * (random.uniform() < 0.5 ? -1 : 1),
                          std::pow(10.0, 12 * random.uniform() - 6) * (random.uniform() < 0.5 ? -1 : 1)});
  for (const Vec3& d : directions) {
    const Location at = layout().locate(d);
    ASSERT_TRUE(at.face >= 0 && at.face < layout().face_count()) << text(d);
    ASSERT_TRUE(at.u >= 0 && at.u <= 1 && at.v >= 0 && at.v <= 1) << text(d) << " -> " << text(at.face, at.u, at.v);
  }
}

TEST_P(Laws, L05_RightIsRightOnEveryFace) {
  for (const auto& [face, u, v] : owned_points(200, 5)) {
    const DirectionJet jet = layout().direction_jet(face, u, v);
    ASSERT_LT(dot(cross(jet.du, jet.dv), jet.d), 0) << text(face, u, v);
    const double density = length(cross(jet.du, jet.dv));  // some layouts have a formula of its own for it
    ASSERT_NEAR(layout().density(face, u, v), density, 1e-11 * density) << text(face, u, v);
  }
}

TEST_P(Laws, L06_OwnedPointsCoverTheSphereOnce) {
  // Midpoint rule, n rows a face; its error is of order 1/n^2 for whole squares and, where the border of the owned part
  // runs through cells, about n^-1.5.
  constexpr int n = 300;
  double sum = 0;
  for (int face = 0; face < layout().face_count(); ++face)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        const double u = (i + 0.5) / n, v = (j + 0.5) / n;
        if (!layout().owns(face, u, v)) continue;
        const DirectionJet jet = layout().direction_jet(face, u, v);
        sum += std::abs(dot(cross(jet.du, jet.dv), jet.d)) / (n * n);
      }
  const double tolerance = info().domain == Domain::square ? 1e-4 : 2e-3;
  EXPECT_NEAR(sum / (4 * pi), 1, tolerance);
}

TEST_P(Laws, L07_EqualAreaZonalCongruentAndConformalAsDeclared) {
  double area_min = 1e300, area_max = 0, anisotropy = 0, along_rows = 0;
  for (const auto& [face, u, v] : owned_points(2000, 7)) {
    const DirectionJet jet = layout().direction_jet(face, u, v);
    const Stretch s = texel_stretch(info().faces[face], jet);
    const Stretch beside = texel_stretch(info().faces[face], layout().direction_jet(face, 0.5 * u + 0.25, v));
    along_rows = std::max(along_rows, std::abs(beside.largest * beside.smallest / (s.largest * s.smallest) - 1));
    area_min = std::min(area_min, s.largest * s.smallest);
    area_max = std::max(area_max, s.largest * s.smallest);
    anisotropy = std::max(anisotropy, s.largest / s.smallest);
  }
  if (info().equal_area)
    EXPECT_NEAR(area_max / area_min, 1, 1e-9);
  else
    EXPECT_GT(area_max / area_min, 1.01) << "deserves equal_area";
  if (info().zonal || info().equal_area)
    EXPECT_LT(along_rows, 1e-9);
  else
    EXPECT_GT(along_rows, 0.01) << "deserves zonal";
  double between_faces = 0;
  for (const auto& [face, u, v] : owned_points(500, 8)) {
    const auto density = [&](int f) {
      const DirectionJet jet = layout().direction_jet(f, u, v);
      return length(cross(jet.du, jet.dv));
    };
    for (int f = 0; f < layout().face_count(); ++f) {
      between_faces = std::max(between_faces, std::abs(density(f) / density(face) - 1));
      if (info().congruent) {
        EXPECT_TRUE(layout().owns(f, u, v)) << "face " << f << " at " << u << ", " << v;
      }
    }
  }
  if (info().congruent) {
    EXPECT_LT(between_faces, 1e-9);
  } else if (layout().face_count() > 1) {
    EXPECT_GT(between_faces, 0.01) << "deserves congruent";
  }
  if (info().conformal) {
    EXPECT_NEAR(anisotropy, 1, 1e-6);
  } else {
    EXPECT_GT(anisotropy, 1.01) << "deserves conformal";
  }
}

// The border of a face: point at t in [0,1) of side `side`, displaced outwards by `out` (in units of u and v).
struct BorderPoint {
  double u, v;
};
BorderPoint border_point(Domain domain, int side, double t, double out) {
  if (domain == Domain::disc) {
    const double angle = 0.5 * pi * (side + t), r = 0.5 + out;
    return {0.5 + r * std::cos(angle), 0.5 + r * std::sin(angle)};
  }
  switch (side) {
    case 0: return {-out, t};
    case 1: return {1 + out, t};
    case 2: return {t, -out};
    default: return {t, 1 + out};
  }
}

TEST_P(Laws, L08_EdgesGoOnToTheirNeighbours) {
  constexpr double step = 1e-6;
  RandomDirections random(8);
  for (int face = 0; face < layout().face_count(); ++face)
    for (int side = 0; side < 4; ++side)
      for (int n = 0; n < 200; ++n) {
        const double t = 0.001 + 0.998 * random.uniform();
        const BorderPoint in = border_point(info().domain, side, t, -step);
        const BorderPoint on = border_point(info().domain, side, t, 0);
        const BorderPoint out = border_point(info().domain, side, t, step);
        const Vec3 inside = layout().direction(face, in.u, in.v), edge = layout().direction(face, on.u, on.v),
                   outside = layout().direction(face, out.u, out.v);
        // Continuity.  (At the rim of Lambert's disc a step of s is an angle of order sqrt s.)
        const double reach = angle_between(inside, edge);
        const double bound = info().domain == Domain::disc ? 10 * std::sqrt(step) : 20 * step;
        ASSERT_LT(reach, bound) << text(face, on.u, on.v) << " inside";
        ASSERT_LT(angle_between(edge, outside), bound) << text(face, on.u, on.v) << " outside";
        // The picture moves on, and does not turn back where it came from.
        ASSERT_GT(angle_between(inside, outside), 1.1 * reach) << text(face, on.u, on.v);
        // Who owns the point outside is its neighbour: not a point well inside this face.
        if (info().domain == Domain::square) {
          const Location next = layout().locate(outside);
          const double depth = std::min({next.u, 1 - next.u, next.v, 1 - next.v});
          ASSERT_LT(depth, 20 * step) << text(face, on.u, on.v) << " -> " << text(next.face, next.u, next.v);
        }
      }
}

TEST_P(Laws, L08_ApronIsContinuousForHalfAFace) {
  // Walk outwards from the edge over half a face.  A jump would exceed any multiple of the step.
  constexpr double step = 1e-4;
  for (int face = 0; face < layout().face_count(); ++face)
    for (int side = 0; side < 4; ++side)
      for (int n = 0; n < 16; ++n) {
        const double t = (n + 0.37) / 16;
        const BorderPoint start = border_point(info().domain, side, t, 0);
        Vec3 last = layout().direction(face, start.u, start.v);
        for (double out = step; out <= 0.5; out += step) {
          const BorderPoint p = border_point(info().domain, side, t, out);
          const Vec3 d = layout().direction(face, p.u, p.v);
          const double bound = info().domain == Domain::disc ? 5 * std::sqrt(step) : 25 * step;
          ASSERT_LT(angle_between(last, d), bound) << text(face, p.u, p.v);
          last = d;
        }
      }
}

TEST_P(Laws, L09_TexelsAreSquareAndAgreeAtTheCentres) {
  // Around the centre, not on it: octahedral maps have a crease there.  Both axes get the same set of offsets.
  constexpr double e = 1e-4, f = 0.37e-4;
  double reference = 0;
  for (int face = 0; face < layout().face_count(); ++face) {
    const Face& rectangle = info().faces[face];
    double uu = 0, vv = 0, area = 0;
    for (const double s : {-1.0, 1.0})
      for (const double t : {-1.0, 1.0})
        for (const auto& [a, b] : {std::pair{e, f}, std::pair{f, e}}) {
          const DirectionJet jet = layout().direction_jet(face, 0.5 + s * a / rectangle.aspect, 0.5 + t * b);
          uu += dot(jet.du, jet.du), vv += dot(jet.dv, jet.dv);
          area += length(cross(jet.du, jet.dv));
        }
    // Layouts of equal area must trade the shape for it: texels in the middle of isocube's sides are 3 pi/8 wide.
    const double squareness = info().equal_area ? 3 * pi / 8 - 1 + 1e-3 : 1e-3;
    EXPECT_NEAR(std::sqrt(uu / vv) / rectangle.aspect, 1, squareness) << rectangle.name;
    const double texel = std::sqrt(area / rectangle.aspect) / rectangle.scale;
    if (face == 0) reference = texel;
    EXPECT_NEAR(texel / reference, 1, 1e-3) << rectangle.name;
  }
  EXPECT_EQ(info().faces[0].scale, 1);
}

TEST_P(Laws, L10_DerivativesAreThoseOfTheMap) {
  constexpr double h = 1e-6;
  int wrong = 0, count = 0;
  std::string example;
  for (const auto& [face, u, v] : owned_points(500, 10)) {
    const DirectionJet jet = layout().direction_jet(face, u, v);
    ASSERT_NEAR(length(jet.d - layout().direction(face, u, v)), 0, 1e-14) << text(face, u, v);
    const Vec3 du = (0.5 / h) * (layout().direction(face, u + h, v) - layout().direction(face, u - h, v));
    const Vec3 dv = (0.5 / h) * (layout().direction(face, u, v + h) - layout().direction(face, u, v - h));
    const double tolerance = 1e-5 * (1 + length(jet.du) + length(jet.dv));
    ++count;
    if (length(du - jet.du) > tolerance || length(dv - jet.dv) > tolerance) {
      ++wrong;
      example = text(face, u, v) + ": du " + text(jet.du) + " differences " + text(du) + "; dv " + text(jet.dv) +
                " differences " + text(dv);
    }
  }
  // Differences straddle a crease, or a rim of infinite slope, now and then.
  EXPECT_LE(wrong, count / 200) << example;
}

TEST_P(Laws, L11_InfoIsComplete) {
  const std::string name(layout().name());
  EXPECT_TRUE(std::regex_match(name, std::regex("[a-z0-9]+(-[a-z0-9]+)*"))) << name;
  EXPECT_EQ(find_layout(name), &layout());
  EXPECT_FALSE(info().title.empty());
  EXPECT_FALSE(info().source.empty());
  EXPECT_FALSE(info().notes.empty());
  EXPECT_GT(info().max_error, 0);
  EXPECT_LE(info().max_error, 0.02) << "float kernels are better than that, see kernels.md";
  int in_rows = 0;
  for (const int n : info().rows) in_rows += n;
  EXPECT_EQ(in_rows, layout().face_count()) << "the default packing holds each face once";
  std::set<std::string_view> names;
  for (const Face& face : info().faces) {
    EXPECT_TRUE(names.insert(face.name).second) << face.name;
    EXPECT_GT(face.aspect, 0);
    EXPECT_GT(face.scale, 0);
  }
}

std::vector<const Layout*> layout_pointers() {
  std::vector<const Layout*> pointers;
  for (const Layout& layout : all_layouts()) pointers.push_back(&layout);
  return pointers;
}
INSTANTIATE_TEST_SUITE_P(, Laws, testing::ValuesIn(layout_pointers()),
                         [](const testing::TestParamInfo<const Layout*>& info) {
                           return test::test_name(*info.param);
                         });

TEST(Registry, NamesAreUniqueAndAgreeWithTheFolder) {
  const std::filesystem::path folder = std::filesystem::path(ENVCONV_TESTDATA).parent_path() / "lib" / "layouts";
  std::ifstream registry(folder / "registry.inc");
  ASSERT_TRUE(registry) << folder;
  std::set<std::string> names, files;
  std::size_t index = 0;
  const std::regex pattern(R"re(ENVCONV_LAYOUT\(([a-z0-9_]+), ([a-z0-9_]+), "([a-z0-9-]+)"\))re");
  for (std::string line; std::getline(registry, line);) {
    if (line.rfind("//", 0) == 0 || line.empty()) continue;
    std::smatch words;
    ASSERT_TRUE(std::regex_match(line, words, pattern)) << line;
    std::string name = words[1];
    std::replace(name.begin(), name.end(), '_', '-');
    EXPECT_EQ(name, words[3]) << "the symbol is the name with underscores";
    EXPECT_TRUE(names.insert(name).second) << name << " twice";
    files.insert(words[2].str() + ".cpp");
    ASSERT_LT(index, all_layouts().size());
    EXPECT_EQ(all_layouts()[index++].name(), name) << "the order is the registry's";
  }
  EXPECT_EQ(index, all_layouts().size());
  std::set<std::string> in_folder;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.path().extension() == ".cpp") in_folder.insert(entry.path().filename().string());
  EXPECT_EQ(files, in_folder);
}

TEST(Registry, NearestNameHelpsWithTypos) {
  std::vector<std::string_view> names;
  for (const Layout& layout : all_layouts()) names.push_back(layout.name());
  EXPECT_EQ(nearest_name("latlng", names), "latlong");
  EXPECT_EQ(nearest_name("octohedral", names), "octahedral");
  EXPECT_EQ(nearest_name("something-else", names), "");
  EXPECT_EQ(find_layout("latlng"), nullptr);
}

}  // namespace
}  // namespace envconv
