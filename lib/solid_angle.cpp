// SPDX-License-Identifier: Apache-2.0
#include "solid_angle.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>
#include <span>
#include <vector>

#include "assertion.h"
#include "row_kernels.h"
#include "texel_kernels.h"

namespace envconv {
namespace {

constexpr int most_block = visit_side;
constexpr double widest_patch = 0.26;        // of a face: where 8 nodes a side are enough for a cube's
constexpr double smallest_bent = 1.0 / 128;  // where 3 are, and creases matter

struct Interval {
  double lo, hi;
  double length() const { return hi - lo; }
  double at(double t) const { return lo + t * (hi - lo); }
  // A little inside of its ends: a seam that runs along a cell's edge is no seam through the cell.
  double within(double t) const { return at(0.5 + (t - 0.5) * (1 - 1e-4)); }
};

// A grid of cells, of which the owned parts count, or all.
struct Grid {
  const Layout& layout;
  int face;
  const double *u, *v;  // bounds of its columns and rows
  bool owned_only;

  Interval column(int i) const { return {u[i], u[i + 1]}; }
  Interval row(int j) const { return {v[j], v[j + 1]}; }
  bool cut_by_seams() const { return owned_only && layout.info().domain != Domain::square; }
};

// Gauss-Legendre abscissae on [0,1] with four nodes: exact for polynomials of degree 7.
constexpr std::array<double, 4> nodes = {0.0694318442029737, 0.3300094782075719, 0.6699905217924281,
                                         0.9305681557970263};
constexpr std::array<double, 4> weights = {0.1739274225687269, 0.3260725774312731, 0.3260725774312731,
                                           0.1739274225687269};

// The same with three nodes: where both agree, neither met a crease.
constexpr std::array<double, 3> fewer_nodes = {0.1127016653792583, 0.5, 0.8872983346207417};
constexpr std::array<double, 3> fewer_weights = {5.0 / 18, 8.0 / 18, 5.0 / 18};

template <std::size_t n>
double gauss(const Layout& layout, int face, Interval u, Interval v, const std::array<double, n>& at,
             const std::array<double, n>& weight) {
  double sum = 0;
  for (std::size_t j = 0; j < n; ++j)
    for (std::size_t i = 0; i < n; ++i) sum += weight[i] * weight[j] * layout.density(face, u.at(at[i]), v.at(at[j]));
  return sum * u.length() * v.length();
}

// And with two, for triangles and for small pieces.
constexpr std::array<double, 2> fewest_nodes = {0.2113248654051871, 0.7886751345948129};
constexpr std::array<double, 2> fewest_weights = {0.5, 0.5};

struct Point {
  double s, t;
};
Point operator+(Point a, Point b) { return {a.s + b.s, a.t + b.t}; }
Point operator-(Point a, Point b) { return {a.s - b.s, a.t - b.t}; }
Point operator*(double k, Point a) { return {k * a.s, k * a.t}; }

// Where the seam passes between a and b, only one of which is owned.
template <class Owns>
Point on_seam(Point a, Point b, const Owns& owns) {
  const bool a_owned = owns(a);
  for (int step = 0; step < 14; ++step) {
    const Point middle = 0.5 * (a + b);
    (owns(middle) == a_owned ? a : b) = middle;
  }
  return 0.5 * (a + b);
}

// A piece so small that the seam through it is a parabola: the polygon of its owned corners and the seam's two points
// on its edges, and the segment between their chord and the seam, of area 2/3 chord x sagitta (Archimedes).  The
// density is taken at the centre of gravity.
double integrate_cut(const Layout& layout, int face, Interval u, Interval v) {
  constexpr Point corners[4] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  const auto owns = [&](Point p) { return layout.owns(face, u.within(p.s), v.within(p.t)); };
  std::array<Point, 8> polygon;
  std::array<Point, 4> crossings;
  std::size_t n = 0, crossed = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const Point a = corners[k], b = corners[(k + 1) % 4];
    const bool a_owned = owns(a);
    if (a_owned) polygon[n++] = a;
    if (a_owned == owns(b)) continue;
    polygon[n++] = crossings[crossed++] = on_seam(a, b, owns);
  }
  double area = 0;
  Point moment{0, 0};
  for (std::size_t k = 0; k < n; ++k) {
    const Point a = polygon[k], b = polygon[(k + 1) % n];
    const double triangle = 0.5 * (a.s * b.t - a.t * b.s);
    area += triangle;
    moment = moment + (triangle / 3) * (a + b);
  }
  if (!(area > 0)) return 0;
  if (crossed == 2) {
    const Point middle = 0.5 * (crossings[0] + crossings[1]), chord = crossings[1] - crossings[0];
    const double width = std::hypot(chord.s, chord.t);
    const Point inner = (1 / area) * moment - middle;  // towards what is owned
    Point out{chord.t, -chord.s};
    if (out.s * inner.s + out.t * inner.t > 0) out = -1.0 * out;
    // The seam bulges one way or the other, by less than half the chord.
    const double side = owns(middle) ? 0.5 : -0.5;
    const Point far = middle + side * out;
    if (width > 0 && owns(far) != owns(middle)) {
      const Point top = on_seam(middle, far, owns);
      const double sagitta = (side > 0 ? 1 : -1) * std::hypot(top.s - middle.s, top.t - middle.t);
      const double segment = 2.0 / 3 * width * sagitta;
      moment = moment + segment * (middle + 0.4 * (top - middle));
      area += segment;
    }
  }
  const Point centre = (1 / area) * moment;
  return area * layout.density(face, u.at(centre.s), v.at(centre.t)) * u.length() * v.length();
}

constexpr double widest_piece = 1.0 / 16;  // of a face: faces of few texels curve within one
constexpr double widest_cut = 1.0 / 128;   // where a seam passes
constexpr int most_depth = 4;              // quarters of quarters of a small piece with a crease

struct Quarters {
  Interval left, right, top, bottom;
  Quarters(Interval u, Interval v)
      : left{u.lo, u.at(0.5)}, right{u.at(0.5), u.hi}, top{v.lo, v.at(0.5)}, bottom{v.at(0.5), v.hi} {}
  template <class F>
  double sum(const F& of) const {
    return of(left, top) + of(right, top) + of(left, bottom) + of(right, bottom);
  }
};

// The four triangles between a piece's middle and its sides, each with n nodes along a side and n towards the middle: a
// crease along a diagonal, as where octahedral maps fold, is between them.
template <std::size_t n>
std::array<double, 4> gauss_triangles(const Layout& layout, int face, Interval u, Interval v,
                                      const std::array<double, n>& at, const std::array<double, n>& weight) {
  std::array<double, 4> sums{};
  for (std::size_t j = 0; j < n; ++j)
    for (std::size_t i = 0; i < n; ++i) {
      const double out = at[j], along = 0.5 + out * (at[i] - 0.5), near = 0.5 - 0.5 * out, far = 0.5 + 0.5 * out;
      const double w = 0.5 * out * weight[i] * weight[j] * u.length() * v.length();
      sums[0] += w * layout.density(face, u.at(along), v.at(near));
      sums[1] += w * layout.density(face, u.at(along), v.at(far));
      sums[2] += w * layout.density(face, u.at(near), v.at(along));
      sums[3] += w * layout.density(face, u.at(far), v.at(along));
    }
  return sums;
}

// The same with a node each, in their centres of gravity.
std::array<double, 4> rough_triangles(const Layout& layout, int face, Interval u, Interval v) {
  const double w = 0.25 * u.length() * v.length();
  constexpr double low = 1.0 / 6, high = 5.0 / 6;
  return {w * layout.density(face, u.at(0.5), v.at(low)), w * layout.density(face, u.at(0.5), v.at(high)),
          w * layout.density(face, u.at(low), v.at(0.5)), w * layout.density(face, u.at(high), v.at(0.5))};
}

// The triangles' sum, if the rougher rule agrees with it.
std::optional<double> agreed(const std::array<double, 4>& triangles, const std::array<double, 4>& rougher) {
  const double sum = std::reduce(triangles.begin(), triangles.end());
  const auto agree = [&](double a, double b) { return std::abs(a - b) <= 2.5e-7 * sum; };
  if (!std::equal(triangles.begin(), triangles.end(), rougher.begin(), agree)) return std::nullopt;
  return sum;
}

constexpr double smallest_piece = 1.0 / 256;  // of a face: where the rules of fewest nodes mostly do

// Quarters until the integral is certain.
double integrate_whole(const Layout& layout, int face, Interval u, Interval v, int depth = 0) {
  const double extent = std::max(u.length(), v.length());
  if (extent <= smallest_piece && depth == 0) {
    // A crease makes a difference between the two.
    const double whole = gauss(layout, face, u, v, fewest_nodes, fewest_weights);
    const auto rough = rough_triangles(layout, face, u, v);
    if (std::abs(std::reduce(rough.begin(), rough.end()) - whole) <= 1e-6 * whole) return whole;
    if (const auto sum = agreed(gauss_triangles(layout, face, u, v, fewest_nodes, fewest_weights), rough)) return *sum;
  }
  if (extent <= widest_piece) {
    const double whole = gauss(layout, face, u, v, nodes, weights);
    if (depth == most_depth) return whole;
    if (std::abs(gauss(layout, face, u, v, fewer_nodes, fewer_weights) - whole) <= 1e-6 * whole) return whole;
    if (const auto sum = agreed(gauss_triangles(layout, face, u, v, fewer_nodes, fewer_weights),
                                gauss_triangles(layout, face, u, v, fewest_nodes, fewest_weights)))
      return *sum;
    ++depth;
  }
  return Quarters(u, v).sum([&](Interval a, Interval b) { return integrate_whole(layout, face, a, b, depth); });
}

// Where a seam may cross: quarters, and at the bottom the rule above.
double integrate_owned(const Layout& layout, int face, Interval u, Interval v, int depth = 0) {
  const double extent = std::max(u.length(), v.length());
  if (extent <= widest_piece) {
    // Around the piece's edges, closely enough that no arc of a seam slips through that matters, and in its middle.
    const int steps = extent > widest_cut ? 8 : 2;
    const int points = 4 * steps + 1;
    int owned = layout.owns(face, u.at(0.5), v.at(0.5)) ? 1 : 0;
    for (int k = 0; k < steps; ++k) {
      const double t = static_cast<double>(k) / steps;
      for (const auto& [x, y] : {std::pair{t, 0.0}, {1.0, t}, {1 - t, 1.0}, {0.0, 1 - t}})
        owned += layout.owns(face, u.within(x), v.within(y)) ? 1 : 0;
    }
    if (owned == 0) return 0;
    if (owned == points) return integrate_whole(layout, face, u, v);
    // The seam is a parabola within a piece: so small, or a sixteenth of a cell that is not much larger.
    if (extent <= (depth >= 2 ? widest_cut : 0.25 * widest_cut)) return integrate_cut(layout, face, u, v);
  }
  return Quarters(u, v).sum([&](Interval a, Interval b) { return integrate_owned(layout, face, a, b, depth + 1); });
}

double integrate(const Grid& grid, Interval u, Interval v) {
  return grid.cut_by_seams() ? integrate_owned(grid.layout, grid.face, u, v)
                             : integrate_whole(grid.layout, grid.face, u, v);
}

// A polynomial through n x n Gauss-Legendre nodes, by powers of each axis.
template <int n>
struct Interpolation {
  std::array<double, n> node;  // in [-1, 1]
  double power[n][n]{};        // [m][k]: coefficient of t^k in the Lagrange polynomial of node m
  constexpr explicit Interpolation(const std::array<double, n>& nodes) : node(nodes) {
    for (std::size_t m = 0; m < n; ++m) {
      double* c = power[m];
      c[0] = 1;
      for (std::size_t other = 0, degree = 0; other < n; ++other) {
        if (other == m) continue;
        const double scale = 1 / (node[m] - node[other]);
        ++degree;
        for (std::size_t k = degree; k > 0; --k) c[k] = scale * (c[k - 1] - node[other] * c[k]);
        c[0] *= -scale * node[other];
      }
    }
  }
};
constexpr Interpolation<3> three({-0.7745966692414834, 0, 0.7745966692414834});
constexpr Interpolation<5> five({-0.9061798459386640, -0.5384693101056831, 0, 0.5384693101056831, 0.9061798459386640});
constexpr Interpolation<8> eight({-0.9602898564975363, -0.7966664774136267, -0.5255324099163290, -0.1834346424956498,
                                  0.1834346424956498, 0.5255324099163290, 0.7966664774136267, 0.9602898564975363});

// The density over a block: the sum of c[j][i] t^j s^i, s and t in [-1, 1] along u and v.
struct Patch {
  double c[most_inner][most_inner];
  int powers_u, powers_v;  // that count

  double at(double s, double t) const {
    double sum = 0;
    for (int j = powers_v; j-- > 0;) {
      double row = 0;
      for (int i = powers_u; i-- > 0;) row = row * s + c[j][i];
      sum = sum * t + row;
    }
    return sum;
  }

  // Without the highest powers that do not matter: all but the first where the density is the same along an axis.
  void shorten() {
    const double least = 1e-10 * std::abs(c[0][0]);
    const auto vanishes = [&](int j, int i) { return std::abs(c[j][i]) <= least; };
    const auto column = [&](int i) {
      for (int j = 0; j < powers_v; ++j)
        if (!vanishes(j, i)) return false;
      return true;
    };
    const auto row = [&](int j) {
      for (int i = 0; i < powers_u; ++i)
        if (!vanishes(j, i)) return false;
      return true;
    };
    while (powers_u > 1 && column(powers_u - 1)) --powers_u;
    while (powers_v > 1 && row(powers_v - 1)) --powers_v;
  }
};

enum class Fit { good, near, none };

// How well the polynomial agrees with the truth near the block's corners and in its middle: whatever crosses the block
// makes a difference there, and then no degree is high enough.
template <int n>
Fit fit(const Layout& layout, int face, Interval u, Interval v, const Interpolation<n>& by, Patch& patch) {
  const auto density_at = [&](double s, double t) {
    return layout.density(face, u.at(0.5 + 0.5 * s), v.at(0.5 + 0.5 * t));
  };
  double rows[n][n] = {};  // [node along v][power along u]
  for (std::size_t j = 0; j < n; ++j)
    for (std::size_t i = 0; i < n; ++i) {
      const double value = density_at(by.node[i], by.node[j]);
      for (std::size_t k = 0; k < n; ++k) rows[j][k] += value * by.power[i][k];
    }
  for (std::size_t k = 0; k < n; ++k)
    for (std::size_t i = 0; i < n; ++i) {
      patch.c[k][i] = 0;
      for (std::size_t j = 0; j < n; ++j) patch.c[k][i] += by.power[j][k] * rows[j][i];
    }
  patch.powers_u = patch.powers_v = n;
  Fit result = Fit::good;
  for (const auto& [s, t] : {std::pair{-0.99, -0.99}, {0.99, -0.99}, {0.03, -0.02}, {-0.99, 0.99}, {0.99, 0.99}}) {
    const double truth = density_at(s, t), error = std::abs(patch.at(s, t) - truth);
    if (!(error <= 3e-4 * std::abs(patch.c[0][0]))) return Fit::none;
    if (!(error <= 1e-6 * truth + 1e-12)) result = Fit::near;
  }
  patch.shorten();
  return result;
}

// Integrals of powers of t, from -1 to 1 over a block, over its n cells.
using PowerIntegrals = std::array<std::array<double, most_block>, most_inner>;  // [power][cell]
void power_integrals(const double* bounds, int n, int powers, PowerIntegrals& out) {
  const double low = bounds[0], scale = 2 / (bounds[n] - bounds[0]);
  const auto last = static_cast<std::size_t>(n);
  std::array<double, most_block + 1> t, power;
  for (std::size_t i = 0; i <= last; ++i) power[i] = t[i] = (bounds[i] - low) * scale - 1;
  for (std::size_t k = 0; k < static_cast<std::size_t>(powers); ++k) {
    const double factor = 1 / (scale * static_cast<double>(k + 1));
    for (std::size_t i = 0; i < last; ++i) out[k][i] = (power[i + 1] - power[i]) * factor;
    for (std::size_t i = 0; i <= last; ++i) power[i] *= t[i];
  }
}

void integrate_patch(const Patch& patch, const double* u, int nx, const double* v, int ny, double* out,
                     std::size_t stride) {
  ENVCONV_ASSERT(nx <= most_block && ny <= most_block);
  PowerIntegrals along, down, rows;
  power_integrals(u, nx, patch.powers_u, along);
  power_integrals(v, ny, patch.powers_v, down);
  multiply_transposed(patch.powers_u, patch.powers_v, ny, {patch.c[0], most_inner}, {down[0].data(), most_block},
                      {rows[0].data(), most_block});
  multiply_transposed(ny, patch.powers_u, nx, {rows[0].data(), most_block}, {along[0].data(), most_block},
                      {out, stride});
}

enum class Owned { all, some, none };

// Tried at points around it so close that no arc of a seam slips through that matters, and in its middle.
Owned owned_part(const Grid& grid, Interval u, Interval v) {
  if (!grid.cut_by_seams()) return Owned::all;
  const int steps = std::max(4, static_cast<int>(std::ceil(64 * std::max(u.length(), v.length()))));
  const auto owns = [&](double s, double t) { return grid.layout.owns(grid.face, u.within(s), v.within(t)); };
  const bool middle = owns(0.5, 0.5);
  for (int k = 0; k < steps; ++k) {
    const double t = static_cast<double>(k) / steps;
    if (owns(t, 0) != middle || owns(1, t) != middle || owns(1 - t, 1) != middle || owns(0, 1 - t) != middle)
      return Owned::some;
  }
  return middle ? Owned::all : Owned::none;
}

// A polynomial wherever one fits and all of the block is owned; else quarters, and at last texels one by one.
void block_solid_angles(const Grid& grid, int x0, int y0, int nx, int ny, double* out, std::size_t stride) {
  const Interval u{grid.u[x0], grid.u[x0 + nx]}, v{grid.v[y0], grid.v[y0 + ny]};
  const double extent = std::max(u.length(), v.length());
  if (nx * ny > 4 && extent <= widest_patch) {
    const Owned owned = owned_part(grid, u, v);
    if (owned == Owned::none) {
      for (int y = 0; y < ny; ++y) std::fill_n(out + static_cast<std::size_t>(y) * stride, nx, 0.0);
      return;
    }
    Patch patch;
    Fit result = owned == Owned::all ? Fit::near : Fit::none;
    const auto try_fit = [&](const auto& by) {
      if (result == Fit::near) result = fit(grid.layout, grid.face, u, v, by, patch);
    };
    // In small blocks it is a crease that bends the density, and no degree is high enough.
    if (extent <= smallest_bent) {
      try_fit(three);
    } else {
      if (extent <= 0.5 * widest_patch) try_fit(five);
      try_fit(eight);
    }
    if (result == Fit::good) return integrate_patch(patch, grid.u + x0, nx, grid.v + y0, ny, out, stride);
  }
  if (std::max(nx, ny) > 2) {
    const int hx = (nx + 1) / 2, hy = (ny + 1) / 2;
    for (int k = 0; k < 4; ++k) {
      const int x = k % 2 * hx, y = k / 2 * hy, w = k % 2 ? nx - hx : hx, h = k / 2 ? ny - hy : hy;
      if (w > 0 && h > 0)
        block_solid_angles(grid, x0 + x, y0 + y, w, h,
                           out + static_cast<std::size_t>(y) * stride + static_cast<std::size_t>(x), stride);
    }
    return;
  }
  for (int y = 0; y < ny; ++y)
    for (int x = 0; x < nx; ++x)
      out[static_cast<std::size_t>(y) * stride + static_cast<std::size_t>(x)] =
          integrate(grid, grid.column(x0 + x), grid.row(y0 + y));
}

// The whole grid, in blocks.  The finer the cells, the more of them a polynomial of the same accuracy covers.
void grid_solid_angles(const Grid& grid, int nx, int ny, double* out) {
  const double cell = std::max((grid.u[nx] - grid.u[0]) / nx, (grid.v[ny] - grid.v[0]) / ny);
  const int side =
      std::clamp(static_cast<int>(0.5 * widest_patch / std::max(cell, 1e-9)), solid_angle_block, most_block);
  for (int y = 0; y < ny; y += side)
    for (int x = 0; x < nx; x += side)
      block_solid_angles(grid, x, y, std::min(side, nx - x), std::min(side, ny - y),
                         out + static_cast<std::size_t>(y) * static_cast<std::size_t>(nx) + static_cast<std::size_t>(x),
                         static_cast<std::size_t>(nx));
}

}  // namespace

std::vector<double> texel_bounds(int n, Placement placement, int first, int count) {
  std::vector<double> bounds;
  bounds.reserve(static_cast<std::size_t>(count) + 1);
  for (int i = first; i <= first + count; ++i)
    bounds.push_back(std::clamp(u_from_texel(i - 0.5, n, placement), 0.0, 1.0));
  return bounds;
}

void cell_solid_angles(const Layout& layout, int face, std::span<const double> u, std::span<const double> v,
                       bool owned_only, double* out) {
  ENVCONV_ASSERT(u.size() > 1 && v.size() > 1);
  grid_solid_angles({layout, face, u.data(), v.data(), owned_only}, static_cast<int>(u.size()) - 1,
                    static_cast<int>(v.size()) - 1, out);
}

void texel_solid_angles(const Layout& layout, int face, Size size, Placement placement, int x0, int y0, int nx, int ny,
                        double* out) {
  ENVCONV_ASSERT(x0 >= 0 && y0 >= 0 && x0 + nx <= size.width && y0 + ny <= size.height);
  const LayoutInfo& info = layout.info();
  if (info.equal_area && info.domain == Domain::square && placement == Placement::centre) {
    double texels = 0;
    for (const Face& f : info.faces) texels += f.aspect * f.scale * f.scale;
    const Face& f = info.faces[static_cast<std::size_t>(face)];
    const double whole = 4 * std::numbers::pi * f.aspect * f.scale * f.scale / texels;  // the face's
    std::fill_n(out, static_cast<std::size_t>(nx) * static_cast<std::size_t>(ny),
                whole / (static_cast<double>(size.width) * size.height));
    return;
  }
  cell_solid_angles(layout, face, texel_bounds(size.width, placement, x0, nx),
                    texel_bounds(size.height, placement, y0, ny), true, out);
}

namespace {

// s[c] += w v, s[channels + c] += w |v|, s[2 channels] += w, over a block of texels.
void add_block(const Image& image, int x0, int y0, int nx, int ny, const double* w, double* s) {
  const std::size_t channels = static_cast<std::size_t>(image.channels());
  if (channels <= 4)
    return add_weighted(image.channels(), nx, ny, image.at(x0, y0),
                        static_cast<std::ptrdiff_t>(image.width()) * image.channels(), w, s);
  for (int y = 0; y < ny; ++y) {
    const float* p = image.at(x0, y0 + y);
    for (int x = 0; x < nx; ++x, ++w, p += channels) {
      if (*w == 0) continue;  // a texel that owns nothing may hold anything, NaN included
      for (std::size_t c = 0; c < channels; ++c) {
        s[c] += *w * static_cast<double>(p[c]);
        s[channels + c] += *w * static_cast<double>(std::abs(p[c]));
      }
      s[2 * channels] += *w;
    }
  }
}

// Sums over texels of a band of rows, most_block at most, of a face and of those alike.
class BandSums {
 public:
  BandSums(const EnvImage& image, int face, int y0, int rows) : image_(image), face_(face), y0_(y0), rows_(rows) {
    ENVCONV_ASSERT(rows <= most_block);
    const LayoutInfo& info = image.layout->info();
    // Where centres lie on edges, texels there are halves.
    rows_alike_ = (info.zonal || info.equal_area) && info.domain == Domain::square &&
                  image.placement == Placement::centre && image.channels.count() <= 4;
    if (rows_alike_) solid_angles(0, 1);
  }

  // Columns [x0, x0 + nx).
  void add(int face, int x0, int nx, double* sums) {
    const Image& pixels = image_.faces[static_cast<std::size_t>(face)];
    if (rows_alike_)
      return add_rows(pixels.channels(), nx, rows_, pixels.at(x0, y0_),
                      static_cast<std::ptrdiff_t>(pixels.width()) * pixels.channels(), omega_, sums);
    // So few at once that they stay in the cache.
    for (int x = x0; x < x0 + nx; x += most_block) {
      const int width = std::min(most_block, x0 + nx - x);
      if (x != x_ || width != width_) solid_angles(x, width);
      add_block(pixels, x, y0_, width, rows_, omega_, sums);
    }
  }

 private:
  void solid_angles(int x, int width) {
    const Image& pixels = image_.faces[static_cast<std::size_t>(face_)];
    texel_solid_angles(*image_.layout, face_, {pixels.width(), pixels.height()}, image_.placement, x, y0_, width, rows_,
                       omega_);
    x_ = x, width_ = width;
  }
  const EnvImage& image_;
  int face_, y0_, rows_;
  bool rows_alike_;
  int x_ = -1, width_ = 0;                 // of the columns that omega_ is about
  double omega_[most_block * most_block];  // of texels, or of a texel of each row
};

// Faces in groups whose texels span the same solid angles.
std::vector<std::vector<int>> alike_faces(const EnvImage& image) {
  std::vector<std::vector<int>> groups;
  for (int f = 0; f < image.layout->face_count(); ++f) {
    const auto size = [&](int face) {
      const Image& pixels = image.faces[static_cast<std::size_t>(face)];
      return std::pair(pixels.width(), pixels.height());
    };
    if (f > 0 && image.layout->info().congruent && size(f) == size(0))
      groups.front().push_back(f);
    else
      groups.push_back({f});
  }
  return groups;
}

}  // namespace

void add_to_sums(const EnvImage& image, int face, int x0, int y0, int nx, int ny, double* sums) {
  for (int y = y0; y < y0 + ny; y += most_block)
    BandSums(image, face, y, std::min(most_block, y0 + ny - y)).add(face, x0, nx, sums);
}

SphereMean mean_of_sums(std::span<const double> sums) {
  const std::size_t channels = sums.size() / 2;
  SphereMean mean;
  for (std::size_t c = 0; c < channels; ++c) {
    mean.value.push_back(sums[c] / sums[2 * channels]);
    mean.magnitude.push_back(sums[channels + c] / sums[2 * channels]);
  }
  return mean;
}

SphereMean sphere_mean(const EnvImage& image) { return sphere_mean(image, {}); }

SphereMean sphere_mean(const EnvImage& image, const std::function<void(int, int, int, int, int)>& visit) {
  const std::size_t count = sphere_sums(image.channels.count());
  std::vector<double> sums(count, 0.0);
  for (const std::vector<int>& group : alike_faces(image)) {
    const Image& face = image.faces[static_cast<std::size_t>(group.front())];
    constexpr int band_rows = most_block;
    const int bands = (face.height() + band_rows - 1) / band_rows;
    // Partial sums by band, added up in order: the same result from any number of threads.
    std::vector<double> partial(static_cast<std::size_t>(bands) * count, 0.0);
    tbb::parallel_for(0, bands, [&](int band) {
      const int y0 = band * band_rows, ny = std::min(band_rows, face.height() - y0);
      BandSums band_sums(image, group.front(), y0, ny);
      for (int x0 = 0; x0 < face.width(); x0 += most_block) {
        const int nx = std::min(most_block, face.width() - x0);
        for (const int f : group) {
          band_sums.add(f, x0, nx, &partial[static_cast<std::size_t>(band) * count]);
          if (visit) visit(f, x0, y0, nx, ny);
        }
      }
    });
    for (std::size_t i = 0; i < partial.size(); ++i) sums[i % count] += partial[i];
  }
  return mean_of_sums(sums);
}

std::vector<double> mean_radiance(const EnvImage& image) { return sphere_mean(image).value; }

}  // namespace envconv
