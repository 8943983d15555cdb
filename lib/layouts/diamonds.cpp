// SPDX-License-Identifier: Apache-2.0
// Tilings of the sphere by 6, 8, 10, 12 or 30 equal diamonds (equilateral spherical quadrilaterals), each one square
// face of texels.
//
//            p0               p0 and p2 are the vertices with the small angles.  Seen from the centre of the sphere the
//           /  \              vertices run clockwise.  u runs along p0->p1 and p3->p2, v along p0->p3 and p1->p2, both
//        v /    \ u           uniformly in arc length; a point is where the geodesic that joins equal u of two opposite
//        p3  e0  p1           edges meets the one that joins equal v of the others.
//          \    /             Frame of a tile: e0 is its centre, e1 points from p0 to p2, e2 from p3 to p1.
//           \  /              S is the length of an edge, alpha the angle e0-p0, beta the angle e0-p1.
//            p2
//
// Source: Crider, Tiling the Sphere with Diamonds for Texture Mapping, equations 1 to 7.  Erratum: section 4 says that
// in the first family a vertex other than a pole has two small angles and one large one; it has two large and one small
// (they sum to a turn only so).
//
// In the tile's frame equation 4 has a short closed form.  With the angles th = (u - 1/2) S and ps = (v - 1/2) S from
// the middles of the edges, and t = tan th, equations 1 and 2 give the edges' points as M + t T, where
//   M = (p, -+sin alpha, +-sin beta) / 2 cos(S/2),  T = (+-q, sin alpha, sin beta) / 2 sin(S/2),
//   p = cos beta + cos alpha,  q = cos beta - cos alpha,
// and equation 3 becomes, for a point d = (c, a, b) of the frame, with A = a / mu and B = b / nu,
//   n_u . d  ~  kappa (B - A) t^2 - 2 c t + (A + B) = 0
//   kappa = (q/p) / tan^2(S/2),  mu = (sin alpha / p) / tan(S/2),  nu = (sin beta / p) / tan(S/2).
// The quadratic of v is the same with -B for B.  Both have the same discriminant, so that equations 6 and 7 come down
// to
//   tan th = (A + B) / r,  tan ps = (A - B) / r,  r = c + sqrt(c^2 + kappa (A^2 - B^2)),
// and solving these for d gives equation 4, multiplied by cos th cos ps:
//   d  ~  e0 (cos th cos ps - kappa sin th sin ps) + e1 mu sin(th + ps) + e2 nu sin(th - ps).
// tests/diamond_facts_test.cpp compares both with the paper's own form.

// g++ 12 believes that Highway's scalar gather reaches far outside of the tables; it does not.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Warray-bounds"
#endif
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "layouts/diamonds.cpp"
#include "layout_kernel-inl.h"

// The tiles: constants computed by the compiler, once for all targets.
#ifndef ENVCONV_DIAMOND_SETS
#define ENVCONV_DIAMOND_SETS
#include <array>

namespace envconv {
namespace diamond_sets {

constexpr Vec3 add(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
constexpr Vec3 scaled(double s, Vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
constexpr Vec3 negative(Vec3 a) { return scaled(-1.0, a); }
constexpr double inner(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
constexpr Vec3 outer(Vec3 a, Vec3 b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }

// <cmath> is not constexpr in C++20; these are good to rounding.
constexpr double root(double x) {
  double r = x > 1.0 ? x : 1.0;
  for (int i = 0; i < 64; ++i) r = 0.5 * (r + x / r);
  return r;
}
constexpr Vec3 unit(Vec3 a) { return scaled(1.0 / root(inner(a, a)), a); }

struct SineCosine {
  double s, c;
};
constexpr SineCosine sine_cosine(double radians) {
  int quarter = 0;
  while (radians > pi / 4) radians -= pi / 2, ++quarter;
  double s = 0, c = 0, term = 1;
  for (int i = 0; i < 24; i += 2) {  // Taylor's series; the last term is below 1e-24
    c += term, term *= radians / (i + 1);
    s += term, term *= -radians / (i + 2);
  }
  for (; quarter > 0; --quarter) {
    const double t = s;
    s = c, c = -t;
  }
  return {s, c};
}
// Angle in (0, pi) with that cosine, by Newton's method.
constexpr double arc_cosine(double cosine) {
  double x = pi / 3;
  for (int i = 0; i < 32; ++i) {
    const SineCosine at = sine_cosine(x);
    x += (at.c - cosine) / at.s;
  }
  return x;
}

// Direction of height y at azimuth a half turns (0 at +Z, growing towards +X).
constexpr Vec3 azimuth(double half_turns, double y) {
  const SineCosine at = sine_cosine(half_turns * pi);
  const double h = root(1.0 - y * y);
  return {h * at.s, y, h * at.c};
}

using Vertices = std::array<Vec3, 4>;  // p0 ... p3
inline constexpr Vec3 north{0, 1, 0}, south{0, -1, 0};

// Whether p0, p1, p2, p3 run clockwise seen from the centre of the sphere.  In our left-handed frame the cross product
// of "right" and "down" then points towards the viewer.
constexpr bool clockwise(const Vertices& p) {
  return inner(outer(add(p[1], negative(p[3])), add(p[2], negative(p[0]))), add(p[0], p[2])) < 0;
}

// 6, 8, 10: m = N/2 tiles around each pole.
template <int N>
constexpr std::array<Vertices, N> polar_tiles() {
  constexpr int m = N / 2;
  // All edges have one length: that of N-A_i, whose cosine is c, is that of A_i-B_i:
  //   (1 - c^2) cos(pi/m) - c^2 = c.
  // (layouts.md writes the same root as (sqrt(1 + 4k(1+k)) - 1) / 2(1+k).)
  const double k = sine_cosine(pi / m).c;
  const double c = (root(1.0 + 4.0 * k * (1.0 + k)) - 1.0) / (2.0 * (1.0 + k));
  std::array<Vertices, N> tiles{};
  for (int i = 0; i < m; ++i) {
    const auto A = [&](int j) { return azimuth(2.0 * (j % m) / m, c); };
    const auto B = [&](int j) { return azimuth((2.0 * (j % m) + 1.0) / m, -c); };
    tiles[i] = {north, A(i + 1), B(i), A(i)};
    tiles[m + i] = {A(i + 1), B(i + 1), south, B(i)};
  }
  return tiles;
}

// 12: the rhombic dodecahedron.
constexpr std::array<Vertices, 12> dodecahedron_tiles() {
  const double h = 1.0 / root(3.0);
  const auto R = [](int j) { return azimuth(0.5 * (j % 4), 0.0); };
  const auto U = [&](int j) { return azimuth(0.5 * (j % 4) + 0.25, h); };
  const auto D = [&](int j) { return azimuth(0.5 * (j % 4) + 0.25, -h); };
  std::array<Vertices, 12> tiles{};
  for (int i = 0; i < 4; ++i) {
    tiles[i] = {north, U(i), R(i), U(i + 3)};
    tiles[4 + i] = {R(i), U(i), R(i + 1), D(i)};
    tiles[8 + i] = {R(i), D(i), south, D(i + 3)};
  }
  return tiles;
}

// 30: the rhombic triacontahedron: a diamond over each edge of an icosahedron, whose other two vertices are the centres
// of the triangles on both sides.
constexpr std::array<Vertices, 30> triacontahedron_tiles() {
  const double h = 1.0 / root(5.0);  // also the cosine of an icosahedron's edge
  const auto U = [&](int j) { return azimuth(0.4 * (j % 5), h); };
  const auto L = [&](int j) { return azimuth(0.4 * (j % 5) + 0.2, -h); };
  std::array<Vec3, 12> icosahedron{north, south};
  for (int i = 0; i < 5; ++i) icosahedron[2 + i] = U(i), icosahedron[7 + i] = L(i);
  const auto over_edge = [&](Vec3 p0, Vec3 p2) {
    std::array<Vec3, 2> centres{};
    int found = 0;
    for (const Vec3& q : icosahedron) {
      const double e0 = inner(q, p0) - h, e2 = inner(q, p2) - h;
      if (e0 * e0 < 1e-6 && e2 * e2 < 1e-6) centres[found++] = unit(add(add(p0, p2), q));
    }
    const Vertices one = {p0, centres[0], p2, centres[1]}, other = {p0, centres[1], p2, centres[0]};
    return clockwise(one) ? one : other;
  };
  std::array<Vertices, 30> tiles{};
  for (int i = 0; i < 5; ++i) {
    tiles[i] = over_edge(north, U(i));
    tiles[5 + i] = over_edge(U(i), U(i + 1));
    tiles[10 + 2 * i] = over_edge(U(i), L(i));
    tiles[11 + 2 * i] = over_edge(L(i), U(i + 1));
    tiles[20 + i] = over_edge(L(i), L(i + 1));
    tiles[25 + i] = over_edge(L(i), south);
  }
  return tiles;
}

template <int N>
constexpr std::array<Vertices, N> tiles_of_set() {
  if constexpr (N == 12)
    return dodecahedron_tiles();
  else if constexpr (N == 30)
    return triacontahedron_tiles();
  else
    return polar_tiles<N>();
}

template <int N>
struct DiamondSet {
  // Half of the tiles are antipodes of the others, but for the set of 8.
  static constexpr bool antipodal = N != 8;
  static constexpr int axis_count = antipodal ? N / 2 : N;

  std::array<Vec3, N> e0{}, e1{}, e2{};              // frames
  Table<N> x0, y0, z0, x1, y1, z1, x2, y2, z2;       // the same, to be selected by a computed tile
  double side_turns = 0, kappa = 0, mu = 0, nu = 0;  // shared by all tiles
  std::array<Vec3, axis_count> axis{};               // tile of d: the one whose axis has the largest product with d
  Table<antipodal ? N : axis_count> owner;           // tile of axis j; after them, the tile of -axis j
  bool all_clockwise = true;
};

template <int N>
constexpr DiamondSet<N> make_set() {
  DiamondSet<N> set;
  const std::array<Vertices, N> tiles = tiles_of_set<N>();
  std::array<Vec3, N> search{};
  for (int i = 0; i < N; ++i) {
    const Vertices& p = tiles[i];
    set.all_clockwise = set.all_clockwise && clockwise(p);
    const Vec3 e0 = unit(add(p[0], p[2])), e1 = unit(add(p[2], negative(p[0]))), e2 = unit(add(p[1], negative(p[3])));
    set.e0[i] = e0, set.e1[i] = e1, set.e2[i] = e2;
    set.x0.set(i, e0.x), set.y0.set(i, e0.y), set.z0.set(i, e0.z);
    set.x1.set(i, e1.x), set.y1.set(i, e1.y), set.z1.set(i, e1.z);
    set.x2.set(i, e2.x), set.y2.set(i, e2.y), set.z2.set(i, e2.z);
    search[i] = e0;
    if constexpr (N <= 10) {
      // The plane halfway between the axes of two neighbours must be that of their common edge.  Between two tiles of
      // one pole any height of the axes will do; between an upper and a lower tile w_up - w_low must be parallel to the
      // normal n of the edge, for instance p1-p2 of the first tile.  Their horizontal parts, of length 1, are half a
      // sector (pi/m) apart and differ by 2 sin(pi/2m); their heights +-y differ by 2y.
      const Vec3 n = outer(tiles[0][1], tiles[0][2]);
      const double slope = (n.y < 0 ? -n.y : n.y) / root(n.x * n.x + n.z * n.z);
      const double y = slope * sine_cosine(pi / N).s;
      const double h = 1.0 / root(e0.x * e0.x + e0.z * e0.z);
      search[i] = unit({h * e0.x, e0.y > 0 ? y : -y, h * e0.z});
    }
  }

  const double cos_alpha = inner(tiles[0][0], set.e0[0]), sin_alpha = -inner(tiles[0][0], set.e1[0]);
  const double cos_beta = inner(tiles[0][1], set.e0[0]), sin_beta = inner(tiles[0][1], set.e2[0]);
  const double p = cos_beta + cos_alpha, q = cos_beta - cos_alpha;
  const double cos_side = cos_alpha * cos_beta;                // the diagonals cross at right angles
  const double t = root((1.0 - cos_side) / (1.0 + cos_side));  // tan(S/2)
  set.side_turns = arc_cosine(cos_side) / (2.0 * pi);
  set.kappa = N == 6 ? 0.0 : q / (p * t * t);  // the diagonals of a cube's face are equal
  set.mu = sin_alpha / (p * t);
  set.nu = sin_beta / (p * t);

  int axes = 0;
  for (int i = 0; i < N; ++i) {
    int same = -1;
    if constexpr (DiamondSet<N>::antipodal)
      for (int j = 0; j < axes; ++j)
        if (inner(search[i], set.axis[j]) < -1.0 + 1e-9) same = j;
    if (same < 0) {
      set.owner.set(axes, i);
      set.axis[axes++] = search[i];
    } else {
      set.owner.set(DiamondSet<N>::axis_count + same, i);
    }
  }
  return set;
}

template <int N>
inline constexpr DiamondSet<N> diamond_set = make_set<N>();
static_assert(diamond_set<6>.all_clockwise && diamond_set<8>.all_clockwise && diamond_set<10>.all_clockwise &&
              diamond_set<12>.all_clockwise && diamond_set<30>.all_clockwise);

inline constexpr Face faces[30] = {{"d0"},  {"d1"},  {"d2"},  {"d3"},  {"d4"},  {"d5"},  {"d6"},  {"d7"},
                                   {"d8"},  {"d9"},  {"d10"}, {"d11"}, {"d12"}, {"d13"}, {"d14"}, {"d15"},
                                   {"d16"}, {"d17"}, {"d18"}, {"d19"}, {"d20"}, {"d21"}, {"d22"}, {"d23"},
                                   {"d24"}, {"d25"}, {"d26"}, {"d27"}, {"d28"}, {"d29"}};

}  // namespace diamond_sets
}  // namespace envconv
#endif  // ENVCONV_DIAMOND_SETS

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {

template <int N>
struct diamonds {
  template <class F>
  static void direction(int face, F u, F v, Vec<F>& d) {
    constexpr const diamond_sets::DiamondSet<N>& set = diamond_sets::diamond_set<N>;
    // Beyond the edges the formula goes on by itself.  1.25 keeps th and ps below a quarter turn in the set of the
    // longest edges (6: S = 70.5 degrees), and with that the direction above zero length.
    const F p = min(max(u - 0.5, -1.25), 1.25), q = min(max(v - 0.5, -1.25), 1.25);
    F sin_sum, cos_sum, sin_difference, cos_difference;
    sincos_turns((p + q) * set.side_turns, sin_sum, cos_sum);
    sincos_turns((p - q) * set.side_turns, sin_difference, cos_difference);
    // cos th cos ps - kappa sin th sin ps, from the sum's and the difference's cosines.
    const F c = named((0.5 - 0.5 * set.kappa) * cos_difference + (0.5 + 0.5 * set.kappa) * cos_sum, "c");
    const F a = named(set.mu * sin_sum, "a");
    const F b = named(set.nu * sin_difference, "b");
    const Vec3 e0 = set.e0[face], e1 = set.e1[face], e2 = set.e2[face];
    d = normalized(
        Vec<F>{c * e0.x + a * e1.x + b * e2.x, c * e0.y + a * e1.y + b * e2.y, c * e0.z + a * e1.z + b * e2.z});
  }

  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    constexpr const diamond_sets::DiamondSet<N>& set = diamond_sets::diamond_set<N>;
    F best = 0.0, index = 0.0;
    for (int j = 0; j < set.axis_count; ++j) {
      const F product = d.x * set.axis[j].x + d.y * set.axis[j].y + d.z * set.axis[j].z;
      const auto better = set.antipodal ? abs(product) > abs(best) : product > best;
      best = select(better, product, best);
      index = select(better, F(static_cast<double>(j)), index);
    }
    if constexpr (set.antipodal) index = index + select(best < 0.0, F(static_cast<double>(set.axis_count)), F(0.0));
    face = lookup(set.owner, index);
    const F c = d.x * lookup(set.x0, face) + d.y * lookup(set.y0, face) + d.z * lookup(set.z0, face);
    const F a = d.x * lookup(set.x1, face) + d.y * lookup(set.y1, face) + d.z * lookup(set.z1, face);
    const F b = d.x * lookup(set.x2, face) + d.y * lookup(set.y2, face) + d.z * lookup(set.z2, face);
    const F sum = named(a * (1.0 / set.mu) + b * (1.0 / set.nu), "sum");
    const F difference = named(a * (1.0 / set.mu) - b * (1.0 / set.nu), "difference");
    const F r = named(c + sqrt(max(c * c + set.kappa * (sum * difference), 0.0)), "r");
    u = 0.5 + atan2_turns(sum, r) * (1.0 / set.side_turns);
    v = 0.5 + atan2_turns(difference, r) * (1.0 / set.side_turns);
  }
};

struct diamond_6 : diamonds<6> {
  static LayoutInfo info() {
    static constexpr int rows[] = {3, 3};
    return {
        .title = "Six diamonds (a cube standing on a corner)",
        .source = "Crider, Tiling the Sphere with Diamonds, sec. 3, eq. 1-7",
        .notes =
            "Three diamonds about each pole: the equi-angular idea on the faces of a cube turned so that two of its "
            "corners are +Y and -Y. The left upper corner of faces d0 to d2 is +Y.",
        .faces = std::span(diamond_sets::faces).first(6),
        .congruent = true,
        .rows = rows,
        .max_error = 0.004};
  }
};

struct diamond_8 : diamonds<8> {
  static LayoutInfo info() {
    static constexpr int rows[] = {4, 4};
    return {.title = "Eight diamonds",
            .source = "Crider, Tiling the Sphere with Diamonds, sec. 3, eq. 1-7",
            .notes = "Four diamonds about each pole. The left upper corner of faces d0 to d3 is +Y.",
            .faces = std::span(diamond_sets::faces).first(8),
            .congruent = true,
            .rows = rows,
            .max_error = 0.004};
  }
};

struct diamond_10 : diamonds<10> {
  static LayoutInfo info() {
    static constexpr int rows[] = {5, 5};
    return {.title = "Ten diamonds (pairs of an icosahedron's triangles)",
            .source = "Crider, Tiling the Sphere with Diamonds, sec. 3, eq. 1-7",
            .notes =
                "Five diamonds about each pole, with the vertices of an icosahedron. The left upper corner of faces d0 "
                "to d4 is +Y.",
            .faces = std::span(diamond_sets::faces).first(10),
            .congruent = true,
            .rows = rows,
            .max_error = 0.004};
  }
};

struct diamond_12 : diamonds<12> {
  static LayoutInfo info() {
    static constexpr int rows[] = {4, 4, 4};
    return {.title = "Twelve diamonds (rhombic dodecahedron)",
            .source = "Crider, Tiling the Sphere with Diamonds, sec. 4, eq. 1-7",
            .notes =
                "Four diamonds about each pole and four around the equator. The left upper corner of faces d0 to d3 is "
                "+Y.",
            .faces = std::span(diamond_sets::faces).first(12),
            .congruent = true,
            .rows = rows,
            .max_error = 0.005};
  }
};

struct diamond_30 : diamonds<30> {
  static LayoutInfo info() {
    static constexpr int rows[] = {6, 6, 6, 6, 6};
    return {
        .title = "Thirty diamonds (rhombic triacontahedron)",
        .source = "Crider, Tiling the Sphere with Diamonds, sec. 4, eq. 1-7",
        .notes =
            "One diamond over each edge of an icosahedron that stands on a vertex. The left upper corner of faces d0 "
            "to d4 is +Y.",
        .faces = diamond_sets::faces,
        .congruent = true,
        .rows = rows,
        .max_error = 0.006};
  }
};

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
ENVCONV_EXPORT_LAYOUT(diamond_6)
ENVCONV_EXPORT_LAYOUT(diamond_8)
ENVCONV_EXPORT_LAYOUT(diamond_10)
ENVCONV_EXPORT_LAYOUT(diamond_12)
ENVCONV_EXPORT_LAYOUT(diamond_30)
