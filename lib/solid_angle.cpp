// SPDX-License-Identifier: Apache-2.0
#include "solid_angle.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <vector>

#include "assertion.h"
#include "read_kernels.h"

namespace envconv {
namespace {

constexpr int most_block = 64;

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

double density(const Layout& layout, int face, double u, double v) {
  const DirectionJet jet = layout.direction_jet(face, u, v);
  return length(cross(jet.du, jet.dv));
}

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
    for (std::size_t i = 0; i < n; ++i) sum += weight[i] * weight[j] * density(layout, face, u.at(at[i]), v.at(at[j]));
  return sum * u.length() * v.length();
}

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
  for (int step = 0; step < 20; ++step) {
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
  return area * density(layout, face, u.at(centre.s), v.at(centre.t)) * u.length() * v.length();
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

// Quarters until the integral is certain.
double integrate_whole(const Layout& layout, int face, Interval u, Interval v, int depth = 0) {
  if (std::max(u.length(), v.length()) <= widest_piece) {
    const double whole = gauss(layout, face, u, v, nodes, weights);
    if (depth == most_depth) return whole;
    if (std::abs(gauss(layout, face, u, v, fewer_nodes, fewer_weights) - whole) <= 1e-6 * whole) return whole;
    ++depth;
  }
  return Quarters(u, v).sum([&](Interval a, Interval b) { return integrate_whole(layout, face, a, b, depth); });
}

// Where a seam may cross: quarters, at least two times, and at the bottom the rule above.
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
    if (depth >= 2 && extent <= widest_cut) return integrate_cut(layout, face, u, v);
  }
  return Quarters(u, v).sum([&](Interval a, Interval b) { return integrate_owned(layout, face, a, b, depth + 1); });
}

double integrate(const Grid& grid, Interval u, Interval v) {
  return grid.cut_by_seams() ? integrate_owned(grid.layout, grid.face, u, v)
                             : integrate_whole(grid.layout, grid.face, u, v);
}

// Lagrange basis on the nodes.
constexpr std::array<double, 4> inverse_denominators = [] {
  std::array<double, 4> inverse{};
  for (std::size_t k = 0; k < 4; ++k) {
    double product = 1;
    for (std::size_t m = 0; m < 4; ++m)
      if (m != k) product *= nodes[k] - nodes[m];
    inverse[k] = 1 / product;
  }
  return inverse;
}();
std::array<double, 4> basis(double t) {
  const double a = t - nodes[0], b = t - nodes[1], c = t - nodes[2], d = t - nodes[3];
  return {b * c * d * inverse_denominators[0], a * c * d * inverse_denominators[1], a * b * d * inverse_denominators[2],
          a * b * c * inverse_denominators[3]};
}

// Integrals of the basis over n intervals of a block's extent: out[function][interval].
void basis_integrals(const double* bounds, int n, Interval block, double (*out)[most_block]) {
  constexpr double half = 0.28867513459481287;  // two Gauss-Legendre nodes, exact for cubics
  for (int i = 0; i < n; ++i) {
    const Interval cell{bounds[i], bounds[i + 1]};
    const auto b0 = basis((cell.at(0.5 - half) - block.lo) / block.length());
    const auto b1 = basis((cell.at(0.5 + half) - block.lo) / block.length());
    for (std::size_t k = 0; k < 4; ++k) out[k][i] = 0.5 * (b0[k] + b1[k]) * cell.length();
  }
}

void block_solid_angles(const Grid& grid, int x0, int y0, int nx, int ny, double* out, std::size_t stride) {
  const Layout& layout = grid.layout;
  const int face = grid.face;
  const Interval u{grid.u[x0], grid.u[x0 + nx]}, v{grid.v[y0], grid.v[y0 + ny]};
  // Bicubic density, wherever it agrees with the truth at points between its nodes and all of the block is owned.
  bool smooth = nx * ny > 16 && u.length() <= 0.13 && v.length() <= 0.13;
  if (smooth && grid.cut_by_seams())
    for (int k = 0; k < 25 && smooth; ++k) smooth = layout.owns(face, u.within(k % 5 / 4.0), v.within(k / 5 / 4.0));
  if (smooth) {
    double nodal[4][4];
    for (std::size_t j = 0; j < 4; ++j)
      for (std::size_t i = 0; i < 4; ++i) nodal[j][i] = density(layout, face, u.at(nodes[i]), v.at(nodes[j]));
    const auto interpolate = [&](double s, double t) {
      const auto bu = basis(s), bv = basis(t);
      double sum = 0;
      for (std::size_t j = 0; j < 4; ++j)
        for (std::size_t i = 0; i < 4; ++i) sum += bv[j] * bu[i] * nodal[j][i];
      return sum;
    };
    for (const auto& [s, t] : {std::pair{0.02, 0.05}, {0.97, 0.03}, {0.5, 0.49}, {0.04, 0.96}, {0.95, 0.98}}) {
      const double truth = density(layout, face, u.at(s), v.at(t));
      smooth = smooth && std::abs(interpolate(s, t) - truth) <= 1e-6 * truth + 1e-12;
    }
    if (smooth) {
      ENVCONV_ASSERT(nx <= most_block && ny <= most_block);
      double bu[4][most_block], bv[4][most_block];
      basis_integrals(grid.u + x0, nx, u, bu);
      basis_integrals(grid.v + y0, ny, v, bv);
      for (int y = 0; y < ny; ++y) {
        double column[4] = {};
        for (std::size_t j = 0; j < 4; ++j)
          for (std::size_t i = 0; i < 4; ++i) column[i] += bv[j][y] * nodal[j][i];
        double* to = out + static_cast<std::size_t>(y) * stride;
        for (int x = 0; x < nx; ++x)
          to[x] = column[0] * bu[0][x] + column[1] * bu[1][x] + column[2] * bu[2][x] + column[3] * bu[3][x];
      }
      return;
    }
  }
  if (std::max(nx, ny) > 8) {  // most of the block may still be smooth: quarters
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
  const int side = std::clamp(static_cast<int>(1 / (32 * std::max(cell, 1e-9))), solid_angle_block, most_block);
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

}  // namespace

SphereMean sphere_mean(const EnvImage& image) { return sphere_mean(image, {}); }

SphereMean sphere_mean(const EnvImage& image, const std::function<void(int, int, int, int, int)>& visit) {
  const std::size_t channels = static_cast<std::size_t>(image.channels.count()), sums = 2 * channels + 1;
  std::vector<double> sum(sums, 0.0);
  for (int f = 0; f < image.layout->face_count(); ++f) {
    const Image& face = image.faces[static_cast<std::size_t>(f)];
    const Size size{face.width(), face.height()};
    constexpr int band_rows = most_block;
    const int bands = (size.height + band_rows - 1) / band_rows;
    // Partial sums by band, added up in order: the same result from any number of threads.
    std::vector<double> partial(static_cast<std::size_t>(bands) * sums, 0.0);
    tbb::parallel_for(0, bands, [&](int band) {
      const int y0 = band * band_rows, ny = std::min(band_rows, size.height - y0);
      double* s = &partial[static_cast<std::size_t>(band) * sums];
      // So few at once that they stay in the cache.
      double omega[most_block * most_block];
      for (int x0 = 0; x0 < size.width; x0 += most_block) {
        const int nx = std::min(most_block, size.width - x0);
        texel_solid_angles(*image.layout, f, size, image.placement, x0, y0, nx, ny, omega);
        add_block(face, x0, y0, nx, ny, omega, s);
        if (visit) visit(f, x0, y0, nx, ny);
      }
    });
    for (std::size_t b = 0; b < static_cast<std::size_t>(bands); ++b)
      for (std::size_t k = 0; k < sums; ++k) sum[k] += partial[b * sums + k];
  }
  SphereMean mean;
  for (std::size_t c = 0; c < channels; ++c) {
    mean.value.push_back(sum[c] / sum[2 * channels]);
    mean.magnitude.push_back(sum[channels + c] / sum[2 * channels]);
  }
  return mean;
}

std::vector<double> mean_radiance(const EnvImage& image) { return sphere_mean(image).value; }

}  // namespace envconv
