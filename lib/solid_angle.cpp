// SPDX-License-Identifier: Apache-2.0
#include "solid_angle.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "assertion.h"

namespace envconv {
namespace {

constexpr int most_block = 64;

struct Interval {
  double lo, hi;
  double length() const { return hi - lo; }
  double at(double t) const { return lo + t * (hi - lo); }
};

// Extent of texel i in u; texels centred on an edge end there.
Interval extent(int i, int n, Placement placement) {
  return {std::max(0.0, u_from_texel(i - 0.5, n, placement)), std::min(1.0, u_from_texel(i + 0.5, n, placement))};
}

double density(const Layout& layout, int face, double u, double v) {
  const DirectionJet jet = layout.direction_jet(face, u, v);
  return length(cross(jet.du, jet.dv));
}

// Gauss-Legendre abscissae on [0,1] with four nodes: exact for polynomials of degree 7.
constexpr std::array<double, 4> nodes = {0.0694318442029737, 0.3300094782075719, 0.6699905217924281,
                                         0.9305681557970263};
constexpr std::array<double, 4> weights = {0.1739274225687269, 0.3260725774312731, 0.3260725774312731,
                                           0.1739274225687269};

double integrate_smooth(const Layout& layout, int face, Interval u, Interval v) {
  double sum = 0;
  for (std::size_t j = 0; j < 4; ++j)
    for (std::size_t i = 0; i < 4; ++i)
      sum += weights[i] * weights[j] * density(layout, face, u.at(nodes[i]), v.at(nodes[j]));
  return sum * u.length() * v.length();
}

// Where a seam may cross: quarters, and at the bottom a polygon whose corners on the piece's edges are bisected.
double integrate_owned(const Layout& layout, int face, Interval u, Interval v, int depth) {
  int owned = 0;
  for (const double s : {0.0, 0.5, 1.0})
    for (const double t : {0.0, 0.5, 1.0}) owned += layout.owns(face, u.at(s), v.at(t)) ? 1 : 0;
  if (owned == 0) return 0;
  if (owned == 9) return integrate_smooth(layout, face, u, v);
  if (depth > 0) {
    const Interval ul{u.lo, u.at(0.5)}, ur{u.at(0.5), u.hi}, vt{v.lo, v.at(0.5)}, vb{v.at(0.5), v.hi};
    return integrate_owned(layout, face, ul, vt, depth - 1) + integrate_owned(layout, face, ur, vt, depth - 1) +
           integrate_owned(layout, face, ul, vb, depth - 1) + integrate_owned(layout, face, ur, vb, depth - 1);
  }
  struct Point {
    double s, t;
  };
  constexpr Point corners[4] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  std::array<Point, 8> polygon;
  std::size_t n = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    Point a = corners[k], b = corners[(k + 1) % 4];
    const auto owns = [&](Point p) { return layout.owns(face, u.at(p.s), v.at(p.t)); };
    const bool a_owned = owns(a), b_owned = owns(b);
    if (a_owned) polygon[n++] = a;
    if (a_owned == b_owned) continue;
    for (int step = 0; step < 16; ++step) {
      const Point middle{0.5 * (a.s + b.s), 0.5 * (a.t + b.t)};
      (owns(middle) == a_owned ? a : b) = middle;
    }
    polygon[n++] = {0.5 * (a.s + b.s), 0.5 * (a.t + b.t)};
  }
  double area = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const Point a = polygon[k], b = polygon[(k + 1) % n];
    area += 0.5 * (a.s * b.t - a.t * b.s);
  }
  return std::abs(area) * density(layout, face, u.at(0.5), v.at(0.5)) * u.length() * v.length();
}

double integrate(const Layout& layout, int face, Interval u, Interval v, int depth) {
  if (layout.info().domain != Domain::square) return integrate_owned(layout, face, u, v, depth);
  // Small faces curve within a texel: pieces of at most 1/16 of the face.
  const int nu = std::max(1, static_cast<int>(std::ceil(u.length() * 16 - 1e-9)));
  const int nv = std::max(1, static_cast<int>(std::ceil(v.length() * 16 - 1e-9)));
  double sum = 0;
  for (int j = 0; j < nv; ++j)
    for (int i = 0; i < nu; ++i)
      sum += integrate_smooth(layout, face, {u.at(double(i) / nu), u.at(double(i + 1) / nu)},
                              {v.at(double(j) / nv), v.at(double(j + 1) / nv)});
  return sum;
}

// Lagrange basis on the nodes.
std::array<double, 4> basis(double t) {
  std::array<double, 4> b;
  for (std::size_t k = 0; k < 4; ++k) {
    b[k] = 1;
    for (std::size_t m = 0; m < 4; ++m)
      if (m != k) b[k] *= (t - nodes[m]) / (nodes[k] - nodes[m]);
  }
  return b;
}

// Integrals of the basis over texels a..a+n of a block's extent, in u.
void basis_integrals(int a, int n, int size, Placement placement, Interval block, std::array<double, 4>* out) {
  constexpr double half = 0.28867513459481287;  // two Gauss-Legendre nodes, exact for cubics
  for (int i = 0; i < n; ++i) {
    const Interval texel = extent(a + i, size, placement);
    const auto b0 = basis((texel.at(0.5 - half) - block.lo) / block.length());
    const auto b1 = basis((texel.at(0.5 + half) - block.lo) / block.length());
    for (std::size_t k = 0; k < 4; ++k) out[i][k] = 0.5 * (b0[k] + b1[k]) * texel.length();
  }
}

void block_solid_angles(const Layout& layout, int face, Size size, Placement placement, int x0, int y0, int nx, int ny,
                        double* out, std::size_t stride) {
  const Interval u{extent(x0, size.width, placement).lo, extent(x0 + nx - 1, size.width, placement).hi};
  const Interval v{extent(y0, size.height, placement).lo, extent(y0 + ny - 1, size.height, placement).hi};
  // Bicubic density, wherever it agrees with the truth at points between its nodes and all of the block is owned.
  bool smooth = nx * ny > 16 && u.length() <= 0.13 && v.length() <= 0.13;
  if (smooth && layout.info().domain != Domain::square)
    for (int k = 0; k < 25 && smooth; ++k) smooth = layout.owns(face, u.at(k % 5 / 4.0), v.at(k / 5 / 4.0));
  if (smooth) {
    double grid[4][4];
    for (std::size_t j = 0; j < 4; ++j)
      for (std::size_t i = 0; i < 4; ++i) grid[j][i] = density(layout, face, u.at(nodes[i]), v.at(nodes[j]));
    const auto interpolate = [&](double s, double t) {
      const auto bu = basis(s), bv = basis(t);
      double sum = 0;
      for (std::size_t j = 0; j < 4; ++j)
        for (std::size_t i = 0; i < 4; ++i) sum += bv[j] * bu[i] * grid[j][i];
      return sum;
    };
    for (const auto& [s, t] : {std::pair{0.02, 0.05}, {0.97, 0.03}, {0.5, 0.49}, {0.04, 0.96}, {0.95, 0.98}}) {
      const double truth = density(layout, face, u.at(s), v.at(t));
      smooth = smooth && std::abs(interpolate(s, t) - truth) <= 1e-6 * truth + 1e-12;
    }
    if (smooth) {
      ENVCONV_ASSERT(nx <= most_block && ny <= most_block);
      std::array<double, 4> bu[most_block], bv[most_block];
      basis_integrals(x0, nx, size.width, placement, u, bu);
      basis_integrals(y0, ny, size.height, placement, v, bv);
      for (int y = 0; y < ny; ++y) {
        std::array<double, 4> column{};
        for (std::size_t j = 0; j < 4; ++j)
          for (std::size_t i = 0; i < 4; ++i) column[i] += bv[y][j] * grid[j][i];
        for (int x = 0; x < nx; ++x)
          out[static_cast<std::size_t>(y) * stride + static_cast<std::size_t>(x)] =
              column[0] * bu[x][0] + column[1] * bu[x][1] + column[2] * bu[x][2] + column[3] * bu[x][3];
      }
      return;
    }
  }
  if (std::max(nx, ny) > 8) {  // most of the block may still be smooth: quarters
    const int hx = (nx + 1) / 2, hy = (ny + 1) / 2;
    for (int k = 0; k < 4; ++k) {
      const int x = k % 2 * hx, y = k / 2 * hy, w = k % 2 ? nx - hx : hx, h = k / 2 ? ny - hy : hy;
      if (w > 0 && h > 0)
        block_solid_angles(layout, face, size, placement, x0 + x, y0 + y, w, h,
                           out + static_cast<std::size_t>(y) * stride + static_cast<std::size_t>(x), stride);
    }
    return;
  }
  const int depth = std::max(size.width, size.height) <= 64 ? 3 : 2;
  for (int y = 0; y < ny; ++y)
    for (int x = 0; x < nx; ++x)
      out[static_cast<std::size_t>(y) * stride + static_cast<std::size_t>(x)] =
          integrate(layout, face, extent(x0 + x, size.width, placement), extent(y0 + y, size.height, placement), depth);
}

}  // namespace

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
  // The larger the face, the more texels a polynomial of the same accuracy covers.
  const int side = std::clamp(std::min(size.width, size.height) / 32, solid_angle_block, most_block);
  for (int y = 0; y < ny; y += side)
    for (int x = 0; x < nx; x += side)
      block_solid_angles(layout, face, size, placement, x0 + x, y0 + y, std::min(side, nx - x), std::min(side, ny - y),
                         out + static_cast<std::size_t>(y) * static_cast<std::size_t>(nx) + static_cast<std::size_t>(x),
                         static_cast<std::size_t>(nx));
}

namespace {

// s[c] += w v, s[channels + c] += w |v|, s[2 channels] += w, over a row of texels.
//
// In floats over short runs, whose sums go on in double: three channels do not fit vectors, but runs of them do when
// weights are repeated by channel.
template <int channels>
void add_row_of(const float* p, const double* w, int n, double* s) {
  constexpr int run = 16, values = run * channels;
  int x = 0;
  for (; x + run <= n; x += run, p += values) {
    float weight[values], sum[values], magnitude[values];
    double total = 0, least = 1;
    for (int i = 0; i < run; ++i) {
      for (int c = 0; c < channels; ++c) weight[i * channels + c] = static_cast<float>(w[x + i]);
      total += w[x + i];
      least = std::min(least, w[x + i]);
    }
    if (least == 0) {
      // A texel that owns nothing may hold anything, NaN included.
      for (int i = 0; i < values; ++i) sum[i] = weight[i] == 0 ? 0 : weight[i] * p[i];
    } else {
      for (int i = 0; i < values; ++i) sum[i] = weight[i] * p[i];
    }
    for (int i = 0; i < values; ++i) magnitude[i] = std::abs(sum[i]);
    for (int c = 0; c < channels; ++c) {
      double a = 0, b = 0;
      for (int i = c; i < values; i += channels)
        a += static_cast<double>(sum[i]), b += static_cast<double>(magnitude[i]);
      s[c] += a, s[channels + c] += b;
    }
    s[2 * channels] += total;
  }
  for (; x < n; ++x, p += channels) {
    if (w[x] == 0) continue;
    for (int c = 0; c < channels; ++c) {
      s[c] += w[x] * static_cast<double>(p[c]);
      s[channels + c] += w[x] * static_cast<double>(std::abs(p[c]));
    }
    s[2 * channels] += w[x];
  }
}

void add_row(const float* p, const double* w, int n, std::size_t channels, double* s) {
  switch (channels) {
    case 1: return add_row_of<1>(p, w, n, s);
    case 3: return add_row_of<3>(p, w, n, s);
    case 4: return add_row_of<4>(p, w, n, s);
    default: break;
  }
  for (int x = 0; x < n; ++x, p += channels) {
    if (w[x] == 0) continue;
    for (std::size_t c = 0; c < channels; ++c) {
      s[c] += w[x] * static_cast<double>(p[c]);
      s[channels + c] += w[x] * static_cast<double>(std::abs(p[c]));
    }
    s[2 * channels] += w[x];
  }
}

}  // namespace

SphereMean sphere_mean(const EnvImage& image) {
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
      std::vector<double> omega(static_cast<std::size_t>(ny) * static_cast<std::size_t>(size.width));
      texel_solid_angles(*image.layout, f, size, image.placement, 0, y0, size.width, ny, omega.data());
      double* s = &partial[static_cast<std::size_t>(band) * sums];
      for (int y = 0; y < ny; ++y) {
        const double* w = &omega[static_cast<std::size_t>(y) * static_cast<std::size_t>(size.width)];
        add_row(face.row(y0 + y), w, size.width, channels, s);
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
