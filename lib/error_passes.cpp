// SPDX-License-Identifier: Apache-2.0
#include "error_passes.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>

#include "metrics.h"
#include "solid_angle.h"

namespace envconv {
namespace {

constexpr int band_rows = 32;

struct Band {
  int face, y0, rows;
};
std::vector<Band> bands_of(const EnvImage& image) {
  std::vector<Band> bands;
  for (int f = 0; f < image.layout->face_count(); ++f) {
    const int height = image.faces[static_cast<std::size_t>(f)].height();
    for (int y = 0; y < height; y += band_rows) bands.push_back({f, y, std::min(band_rows, height - y)});
  }
  return bands;
}

std::vector<double> solid_angles(const EnvImage& image, const Band& band) {
  const Image& face = image.faces[static_cast<std::size_t>(band.face)];
  std::vector<double> omega(static_cast<std::size_t>(band.rows) * static_cast<std::size_t>(face.width()));
  texel_solid_angles(*image.layout, band.face, {face.width(), face.height()}, image.placement, 0, band.y0, face.width(),
                     band.rows, omega.data());
  return omega;
}

// visit(band, sums) for every band in parallel; the bands' sums added up in order.
template <class Visit>
ErrorSums over_bands(const EnvImage& image, const Visit& visit) {
  const std::vector<Band> bands = bands_of(image);
  const auto channels = static_cast<std::size_t>(image.channels.count());
  std::vector<ErrorSums> parts(bands.size(), ErrorSums(channels));
  tbb::parallel_for(std::size_t{0}, bands.size(), [&](std::size_t i) { visit(bands[i], parts[i]); });
  return merged(parts, channels);
}

// The face point of a texel's centre.
Location centre(const EnvImage& image, int face, int x, int y) {
  const Image& pixels = image.faces[static_cast<std::size_t>(face)];
  return {face, u_from_texel(x, pixels.width(), image.placement), u_from_texel(y, pixels.height(), image.placement)};
}

// Directions, in the world frame, of the texels of row y from x0; and whether the layout owns their centres.
void lay_texels(const EnvImage& image, const Mat3& world_from_layout, int face, int y, int x0, int n,
                PointBatch& points, bool* owned) {
  alignas(64) float u[PointBatch::most] = {}, v[PointBatch::most] = {};
  for (int i = 0; i < n; ++i) {
    const Location at = centre(image, face, x0 + i, y);
    u[i] = static_cast<float>(at.u), v[i] = static_cast<float>(at.v);
    owned[i] = image.layout->owns(face, at.u, at.v);
  }
  float matrix[9];
  for (std::size_t i = 0; i < 9; ++i) matrix[i] = static_cast<float>(world_from_layout.m[i]);
  const auto padded = (static_cast<std::size_t>(n) + batch_padding - 1) / batch_padding * batch_padding;
  image.layout->directions(face, padded, u, v, points.x, points.y, points.z);
  rotate_directions(matrix, padded, points.x, points.y, points.z);
  points.count = n;
}

Vec3 direction(const PointBatch& points, int i) {
  return normalize(
      {static_cast<double>(points.x[i]), static_cast<double>(points.y[i]), static_cast<double>(points.z[i])});
}

// One square of points, and how sure its part of the squared error is.
struct SquareSums {
  PointSquare square;
  ErrorSums sums;
  double squared = 0, doubt = 0;  ///< of all channels together
};

SquareSums sum_square(const PointSquare& square, const MapPair& pair, const MapReader& a, const MapReader& b) {
  const std::size_t channels = pair.channel_count();
  const auto points = std::make_unique<PointBatch>();
  lay_points(square, *points);
  std::vector<float> at_a(channels * PointBatch::most), at_b(at_a.size());
  a.read(*points, at_a.data());
  b.read(*points, at_b.data());
  const double weight = 1 / (12.0 * square.grid * square.grid);
  SquareSums out{square, ErrorSums(channels)};
  ErrorSums odd(channels);  // the black squares of the chessboard
  for (int i = 0; i < points->count; ++i) {
    const float* p = &at_a[static_cast<std::size_t>(i) * channels];
    const float* q = &at_b[static_cast<std::size_t>(i) * channels];
    ErrorSums& half = (i + i / PointSquare::side) % 2 ? odd : out.sums;
    if (!half.add(p, q, weight)) continue;
    for (std::size_t c = 0; c < channels; ++c) {
      const double error = std::abs(static_cast<double>(p[c]) - static_cast<double>(q[c]));
      if (error > out.sums.channels[c].largest.error) out.sums.channels[c].largest.raise(error, direction(*points, i));
    }
  }
  // Two estimates of the same integral: half of the points each.
  for (std::size_t c = 0; c < channels; ++c) {
    out.squared += out.sums.channels[c].squared + odd.channels[c].squared;
    out.doubt += std::abs(out.sums.channels[c].squared - odd.channels[c].squared);
  }
  out.sums.merge(odd);
  return out;
}

void sum_squares(std::vector<SquareSums>& squares, std::size_t first, const MapPair& pair, const MapReader& a,
                 const MapReader& b) {
  tbb::parallel_for(first, squares.size(),
                    [&](std::size_t i) { squares[i] = sum_square(squares[i].square, pair, a, b); });
}

// The squares with the most doubt, so many that what is left is sure enough, from the least doubtful kept one on.
std::vector<std::size_t> doubtful(const std::vector<SquareSums>& squares, std::size_t most) {
  constexpr double tolerance = 1e-3;
  double total = 0, doubt = 0;
  for (const SquareSums& s : squares) total += s.squared, doubt += s.doubt * s.doubt;
  const double allowed = tolerance * total * tolerance * total;
  std::vector<std::size_t> order(squares.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, [&](std::size_t i, std::size_t j) { return squares[i].doubt > squares[j].doubt; });
  std::size_t n = 0;
  while (n < order.size() && n < most && doubt > allowed)
    doubt -= squares[order[n]].doubt * squares[order[n]].doubt, ++n;
  order.resize(n);
  return order;
}

}  // namespace

ErrorSums sums_on_common_grid(const MapPair& pair) {
  const Mat3 world_from_layout = transpose(layout_from_world(*pair.a));
  return over_bands(*pair.a, [&](const Band& band, ErrorSums& sums) {
    const std::vector<double> omega = solid_angles(*pair.a, band);
    const Image& a = pair.a->faces[static_cast<std::size_t>(band.face)];
    const Image& b = pair.b->faces[static_cast<std::size_t>(band.face)];
    const double* w = omega.data();
    for (int y = band.y0; y < band.y0 + band.rows; ++y)
      for (int x = 0; x < a.width(); ++x, ++w) {
        if (*w == 0) continue;  // what a layout does not own may hold anything
        if (!sums.add(a.at(x, y), b.at(x, y), *w)) continue;
        for (std::size_t c = 0; c < sums.channels.size(); ++c) {
          const double error = std::abs(static_cast<double>(a.at(x, y)[c]) - static_cast<double>(b.at(x, y)[c]));
          if (!(error > sums.channels[c].largest.error)) continue;
          const Location at = centre(*pair.a, band.face, x, y);
          sums.channels[c].largest.raise(error, world_from_layout * pair.a->layout->direction(at.face, at.u, at.v));
        }
      }
  });
}

ErrorSums sums_on_grid_of(const EnvImage& own, const MapReader& other, bool swapped) {
  const Mat3 world_from_layout = transpose(layout_from_world(own));
  const auto channels = static_cast<std::size_t>(own.channels.count());
  return over_bands(own, [&](const Band& band, ErrorSums& sums) {
    const Image& face = own.faces[static_cast<std::size_t>(band.face)];
    const std::vector<double> omega =
        swapped ? std::vector<double>(static_cast<std::size_t>(band.rows) * static_cast<std::size_t>(face.width()), 1.0)
                : solid_angles(own, band);
    const auto points = std::make_unique<PointBatch>();
    std::vector<float> values(channels * PointBatch::most);
    bool owned[PointBatch::most];
    for (int y = 0; y < band.rows; ++y)
      for (int x0 = 0; x0 < face.width(); x0 += PointBatch::most) {
        const int n = std::min(PointBatch::most, face.width() - x0);
        lay_texels(own, world_from_layout, band.face, band.y0 + y, x0, n, *points, owned);
        other.read(*points, values.data());
        const double* w =
            &omega[static_cast<std::size_t>(y) * static_cast<std::size_t>(face.width()) + static_cast<std::size_t>(x0)];
        for (int i = 0; i < n; ++i) {
          if (!owned[i]) continue;
          const float* mine = face.at(x0 + i, band.y0 + y);
          const float* its = &values[static_cast<std::size_t>(i) * channels];
          if (swapped) std::swap(mine, its);
          if (sums.add(mine, its, w[i], false)) sums.add_largest(mine, its, direction(*points, i));
        }
      }
  });
}

ErrorSums sums_on_sphere(const MapPair& pair, const MapReader& a, const MapReader& b) {
  constexpr int rounds = 6;
  std::vector<SquareSums> squares;
  for (const PointSquare& square : point_squares(pair.grid)) squares.push_back({square, ErrorSums(), 0, 0});
  // No more than this are split in all, so that hopeless noise does not take for ever.
  std::size_t budget = std::max<std::size_t>(squares.size() / 2, 1024);
  sum_squares(squares, 0, pair, a, b);
  for (int round = 0; round < rounds; ++round) {
    const std::vector<std::size_t> split = doubtful(squares, budget);
    if (split.empty()) break;
    budget -= split.size();
    const std::size_t first = squares.size();
    for (const std::size_t i : split) {
      // Four squares of half the spacing take the place of one.  Its largest error was met, so it stays.
      const PointSquare s = squares[i].square;
      for (int k = 0; k < 4; ++k)
        squares.push_back(
            {{s.face, 2 * s.grid, 2 * s.x + k % 2 * PointSquare::side, 2 * s.y + k / 2 * PointSquare::side},
             ErrorSums(),
             0,
             0});
      ErrorSums largest(pair.channel_count());
      for (std::size_t c = 0; c < pair.channel_count(); ++c)
        largest.channels[c].largest = squares[i].sums.channels[c].largest;
      squares[i] = {s, largest, 0, 0};
    }
    sum_squares(squares, first, pair, a, b);
  }
  ErrorSums all(pair.channel_count());
  for (const SquareSums& s : squares) all.merge(s.sums);
  return all;
}

ErrorSums sums_at_s_psnr_points(const MapPair& pair) {
  const std::vector<Vec3>& all = s_psnr_points();
  constexpr std::size_t chunk = PointBatch::most;
  std::vector<ErrorSums> parts((all.size() + chunk - 1) / chunk, ErrorSums(pair.channel_count()));
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t part) {
    const auto points = std::make_unique<PointBatch>();
    for (std::size_t i = part * chunk; i < std::min(all.size(), (part + 1) * chunk); ++i) {
      points->x[points->count] = static_cast<float>(all[i].x);
      points->y[points->count] = static_cast<float>(all[i].y);
      points->z[points->count] = static_cast<float>(all[i].z);
      ++points->count;
    }
    TexelPlace in_a[PointBatch::most], in_b[PointBatch::most];
    nearest_texels(*pair.a, *points, in_a);
    if (!pair.same_grid) nearest_texels(*pair.b, *points, in_b);
    for (int i = 0; i < points->count; ++i)
      parts[part].add(in_a[i].of(*pair.a), (pair.same_grid ? in_a : in_b)[i].of(*pair.b), 1, false);
  });
  return merged(parts, pair.channel_count());
}

}  // namespace envconv
