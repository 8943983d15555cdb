// SPDX-License-Identifier: Apache-2.0
// Crider's diamonds against the paper: vertices written down a second time, with the standard library's functions, the
// facts that the paper states of them, and equations 1 to 7 in the paper's own form.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <string>
#include <vector>

#include "layout.h"
#include "layout_cases.h"

namespace envconv {
namespace {

constexpr double pi = 3.14159265358979323846;
constexpr double degree = pi / 180;

using Vertices = std::array<Vec3, 4>;

// The direction of height y at azimuth a (0 at +Z, growing towards +X): layouts.md's az.
Vec3 az(double a, double y) { return {std::sqrt(1 - y * y) * std::sin(a), y, std::sqrt(1 - y * y) * std::cos(a)}; }

std::vector<Vertices> tiles_of(int count) {
  const Vec3 N{0, 1, 0}, S{0, -1, 0};
  std::vector<Vertices> tiles;
  if (count <= 10) {
    const int m = count / 2;
    const double k = std::cos(pi / m), c = (std::sqrt(1 + 4 * k * (1 + k)) - 1) / (2 * (1 + k));
    const auto A = [&](int i) { return az(2 * pi * i / m, c); };
    const auto B = [&](int i) { return az(2 * pi * (i + 0.5) / m, -c); };
    for (int i = 0; i < m; ++i) tiles.push_back({N, A(i + 1), B(i), A(i)});
    for (int i = 0; i < m; ++i) tiles.push_back({A(i + 1), B(i + 1), S, B(i)});
  } else if (count == 12) {
    const auto R = [](int i) { return az(pi * i / 2, 0); };
    const auto U = [](int i) { return az(pi * (i + 0.5) / 2, 1 / std::sqrt(3.0)); };
    const auto D = [](int i) { return az(pi * (i + 0.5) / 2, -1 / std::sqrt(3.0)); };
    for (int i = 0; i < 4; ++i) tiles.push_back({N, U(i), R(i), U(i - 1)});
    for (int i = 0; i < 4; ++i) tiles.push_back({R(i), U(i), R(i + 1), D(i)});
    for (int i = 0; i < 4; ++i) tiles.push_back({R(i), D(i), S, D(i - 1)});
  } else {
    const double h = 1 / std::sqrt(5.0);
    const auto U = [&](int i) { return az(2 * pi * i / 5, h); };
    const auto L = [&](int i) { return az(2 * pi * (i + 0.5) / 5, -h); };
    // Here the triangles' third vertices are named, not searched: p1 first.
    const auto tile = [](Vec3 p0, Vec3 third1, Vec3 p2, Vec3 third3) {
      return Vertices{p0, normalize(p0 + p2 + third1), p2, normalize(p0 + p2 + third3)};
    };
    for (int i = 0; i < 5; ++i) tiles.push_back(tile(N, U(i + 1), U(i), U(i - 1)));
    for (int i = 0; i < 5; ++i) tiles.push_back(tile(U(i), N, U(i + 1), L(i)));
    for (int i = 0; i < 5; ++i) {
      tiles.push_back(tile(U(i), U(i + 1), L(i), L(i - 1)));
      tiles.push_back(tile(L(i), U(i), U(i + 1), L(i + 1)));
    }
    for (int i = 0; i < 5; ++i) tiles.push_back(tile(L(i), U(i + 1), L(i + 1), S));
    for (int i = 0; i < 5; ++i) tiles.push_back(tile(L(i), L(i + 1), S, L(i - 1)));
  }
  return tiles;
}

// Angle at vertex a between the geodesics to b and to c.
double angle_at(Vec3 a, Vec3 b, Vec3 c) { return angle_between(cross(a, b), cross(a, c)); }

class Diamonds : public testing::TestWithParam<int> {
 protected:
  int count() const { return GetParam(); }
  const Layout& layout() const { return *find_layout("diamond-" + std::to_string(count())); }
  std::vector<Vertices> tiles() const { return tiles_of(count()); }
};
INSTANTIATE_TEST_SUITE_P(, Diamonds, testing::Values(6, 8, 10, 12, 30), testing::PrintToStringParamName());

TEST_P(Diamonds, CornersOfFacesAreTheVertices) {
  ASSERT_EQ(layout().face_count(), count());
  for (int face = 0; face < count(); ++face) {
    const Vertices p = tiles()[face];
    EXPECT_LT(angle_between(layout().direction(face, 0, 0), p[0]), 1e-14) << face;
    EXPECT_LT(angle_between(layout().direction(face, 1, 0), p[1]), 1e-14) << face;
    EXPECT_LT(angle_between(layout().direction(face, 1, 1), p[2]), 1e-14) << face;
    EXPECT_LT(angle_between(layout().direction(face, 0, 1), p[3]), 1e-14) << face;
  }
}

TEST_P(Diamonds, AllEdgesHaveOneLength) {
  const Vertices first = tiles()[0];
  const double side = angle_between(first[0], first[1]);
  for (const Vertices& p : tiles())
    for (int i = 0; i < 4; ++i) EXPECT_NEAR(angle_between(p[i], p[(i + 1) % 4]), side, 1e-14);
}

TEST_P(Diamonds, VertexAnglesAreThoseOfThePaper) {
  // Small angles: 360 degrees shared by the tiles about a pole.  Large angles: the rest of a vertex with one small and
  // two large ones (first family), or a third of 360 degrees (sets of 6, 12 and 30).
  const std::map<int, std::pair<double, double>> angles = {
      {6, {120, 120}}, {8, {90, 135}}, {10, {72, 144}}, {12, {90, 120}}, {30, {72, 120}}};
  const auto [small, large] = angles.at(count());
  for (const Vertices& p : tiles()) {
    EXPECT_NEAR(angle_at(p[0], p[1], p[3]), small * degree, 1e-14);
    EXPECT_NEAR(angle_at(p[1], p[2], p[0]), large * degree, 1e-14);
    EXPECT_NEAR(angle_at(p[2], p[3], p[1]), small * degree, 1e-14);
    EXPECT_NEAR(angle_at(p[3], p[0], p[2]), large * degree, 1e-14);
  }
}

TEST_P(Diamonds, TilesMeetAtVerticesAsThePaperSays) {
  std::vector<std::pair<Vec3, int>> vertices;
  for (const Vertices& p : tiles())
    for (const Vec3& vertex : p) {
      auto same = std::find_if(vertices.begin(), vertices.end(),
                               [&](const auto& other) { return angle_between(other.first, vertex) < 1e-9; });
      if (same == vertices.end())
        vertices.push_back({vertex, 1});
      else
        ++same->second;
    }
  std::map<int, int> vertices_with;  // so many tiles
  for (const auto& vertex : vertices) ++vertices_with[vertex.second];
  const std::map<int, std::map<int, int>> expected = {
      {6, {{3, 8}}}, {8, {{3, 8}, {4, 2}}}, {10, {{3, 10}, {5, 2}}}, {12, {{3, 8}, {4, 6}}}, {30, {{3, 20}, {5, 12}}}};
  EXPECT_EQ(vertices_with, expected.at(count()));
  if (count() == 10)  // "identical to those of an inscribed regular icosahedron": neighbours, next neighbours, antipode
    for (const auto& a : vertices)
      for (const auto& b : vertices) {
        const double c = dot(a.first, b.first);
        EXPECT_TRUE(std::abs(c - 1) < 1e-14 || std::abs(c + 1) < 1e-14 ||
                    std::abs(std::abs(c) - 1 / std::sqrt(5.0)) < 1e-14)
            << c;
      }
}

// Equations 1 and 2: a point of the edge from a to b.
Vec3 on_edge(Vec3 a, Vec3 b, double t, double S) {
  return (std::sin(S - t * S) / std::sin(S)) * a + (std::sin(t * S) / std::sin(S)) * b;
}
// Equation 3: normals of the geodesic planes of constant u and v.  In a left-handed frame that of v points towards
// smaller v.
Vec3 normal_u(const Vertices& p, double u, double S) {
  return cross(on_edge(p[0], p[1], u, S), on_edge(p[3], p[2], u, S));
}
Vec3 normal_v(const Vertices& p, double v, double S) {
  return cross(on_edge(p[0], p[3], v, S), on_edge(p[1], p[2], v, S));
}

TEST_P(Diamonds, DirectionIsEquation4) {
  const double S = angle_between(tiles()[0][0], tiles()[0][1]);
  for (int face = 0; face < count(); ++face) {
    const Vertices p = tiles()[face];
    for (int j = 0; j < 16; ++j)
      for (int i = 0; i < 16; ++i) {
        const double u = (i + 0.5) / 16, v = (j + 0.5) / 16;
        Vec3 d = cross(normal_u(p, u, S), normal_v(p, v, S));
        if (dot(d, p[0] + p[2]) < 0) d = -1.0 * d;
        EXPECT_LT(angle_between(d, layout().direction(face, u, v)), 1e-14) << face << ' ' << u << ' ' << v;
      }
  }
}

// Equations 6 and 7 for u; v has p1 and p3 interchanged.
double equation_7(const Vertices& p, Vec3 d, double S) {
  const double c = std::cos(S), s = std::sin(S);
  const Vec3 p03 = cross(p[0], p[3]), p02 = cross(p[0], p[2]), p13 = cross(p[1], p[3]), p12 = cross(p[1], p[2]);
  const double qa = dot(c * c * p03 - c * (p02 + p13) + p12, d);
  const double qb = dot(-2 * s * c * p03 + s * (p02 + p13), d);
  const double qc = dot(s * s * p03, d);
  // Either root may be the one between 0 and tan S; the quadratic degenerates where qa is 0.
  const double root = std::sqrt(std::max(qb * qb - 4 * qa * qc, 0.0));
  const double q = -0.5 * (qb + std::copysign(root, qb));
  for (const double t : {qc / q, q / qa}) {
    const double x = std::atan(t) / S;
    if (std::isfinite(t) && x > -1e-9 && x < 1 + 1e-9) return x;
  }
  return NAN;
}

TEST_P(Diamonds, LocateIsEquations5To7) {
  const std::vector<Vertices> tile = tiles();
  const double S = angle_between(tile[0][0], tile[0][1]);
  test::RandomDirections random(20);
  for (int n = 0; n < 20000; ++n) {
    const Vec3 d = random();
    const Location at = layout().locate(d);
    for (int face = 0; face < count(); ++face) {
      const Vertices& p = tile[face];
      const double u0 = dot(normal_u(p, 0, S), d), u1 = dot(normal_u(p, 1, S), d);
      const double v0 = -dot(normal_v(p, 0, S), d), v1 = -dot(normal_v(p, 1, S), d);
      if (std::min({std::abs(u0), std::abs(u1), std::abs(v0), std::abs(v1)}) < 1e-12) continue;  // on an edge's plane
      // Equation 5, with the side of the sphere that it leaves to the reader.
      const bool inside = u0 >= 0 && u1 <= 0 && v0 >= 0 && v1 <= 0 && dot(p[0] + p[2], d) > 0;
      ASSERT_EQ(at.face == face, inside) << "face " << face << ": " << d.x << ' ' << d.y << ' ' << d.z;
    }
    const Vertices p = tile[at.face], exchanged = {p[0], p[3], p[2], p[1]};
    ASSERT_NEAR(at.u, equation_7(p, d, S), 1e-12);
    ASSERT_NEAR(at.v, equation_7(exchanged, d, S), 1e-12);
  }
}

}  // namespace
}  // namespace envconv
