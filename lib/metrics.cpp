// SPDX-License-Identifier: Apache-2.0
#include "metrics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <set>
#include <utility>

#include "error_passes.h"
#include "map_pair.h"
#include "solid_angle.h"
#include "ssim_sphere.h"

namespace envconv {
namespace {

double decibels(double peak, double mean_square) { return 10 * std::log10(peak * peak / mean_square); }

// Values that are NaN or infinite in texels of which the layout owns a part.
std::int64_t count_nonfinite(const EnvImage& image) {
  std::int64_t count = 0;
  for (int f = 0; f < image.layout->face_count(); ++f) {
    const Image& face = image.faces[static_cast<std::size_t>(f)];
    for (int y = 0; y < face.height(); ++y)
      for (int x = 0; x < face.width(); ++x) {
        const float* p = face.at(x, y);
        const auto bad = std::count_if(p, p + face.channels(), [](float v) { return !std::isfinite(v); });
        if (bad == 0) continue;
        if (texel_solid_angle(*image.layout, f, x, y, {face.width(), face.height()}, image.placement) > 0) count += bad;
      }
  }
  return count;
}

double largest_color(const MapPair& pair) {
  float most = 0;
  for (const Image& face : pair.a->faces) {
    const float* p = face.data();
    for (std::size_t i = 0; i < face.pixel_count(); ++i)
      for (std::size_t c = 0; c < pair.channel_count(); ++c, ++p)
        if (pair.is_color[c] && std::isfinite(*p)) most = std::max(most, *p);
  }
  return most > 0 ? static_cast<double>(most) : 1.0;
}

// All that the figures are made of, before the decibels.
struct Passes {
  ErrorSums sphere, ws, s;
  std::vector<double> ssim;
};

Passes run_passes(const MapPair& pair, double peak) {
  Passes passes;
  const MapReader a(*pair.a), b(*pair.b);
  if (pair.same_grid) {
    passes.sphere = sums_on_common_grid(pair);
    passes.ws = passes.sphere;
  } else {
    passes.sphere = sums_on_sphere(pair, a, b);
    passes.ws = sums_on_grid_of(*pair.a, b, false);
    const ErrorSums on_b = sums_on_grid_of(*pair.b, a, true);
    for (const ErrorSums* grid : {&std::as_const(passes.ws), &on_b})
      for (std::size_t c = 0; c < pair.channel_count(); ++c)
        passes.sphere.channels[c].largest.raise(grid->channels[c].largest.error, grid->channels[c].largest.direction);
  }
  passes.s = sums_at_s_psnr_points(pair);
  // One step of the window is the side of a square with the mean solid angle of the finer map's texels.
  const auto texels = static_cast<double>(std::max(pair.a->texel_count(), pair.b->texel_count()));
  passes.ssim = ssim_on_sphere(a, b, std::sqrt(4 * std::numbers::pi / texels), log_encoded_range(peak));
  return passes;
}

// Mean squares, from which a channel's figures or the total's are made.
struct MeanSquares {
  double linear = 0, logarithmic = 0, ws = 0, s = 0;
};

MeanSquares mean_squares(const Passes& passes, std::size_t c) {
  return {passes.sphere.channels[c].squared / passes.sphere.weight,
          passes.sphere.channels[c].log_squared / passes.sphere.weight,
          passes.ws.channels[c].squared / passes.ws.weight, passes.s.channels[c].squared / passes.s.weight};
}

void set_squares(const MeanSquares& squares, double peak, ErrorFigures& figures) {
  figures.rmse = std::sqrt(squares.linear);
  figures.psnr = decibels(peak, squares.linear);
  figures.psnr_hdr = decibels(log_encoded_range(peak), squares.logarithmic);
  figures.ws_psnr = decibels(peak, squares.ws);
  figures.s_psnr = decibels(peak, squares.s);
}

ErrorFigures channel_figures(const Passes& passes, std::size_t c, double peak) {
  const ChannelSums& sums = passes.sphere.channels[c];
  ErrorFigures figures;
  figures.mean_a = sums.a / passes.sphere.weight;
  figures.mean_b = sums.b / passes.sphere.weight;
  figures.mae = sums.absolute / passes.sphere.weight;
  figures.max_error = passes.sphere.weight > 0 ? sums.largest.error : std::nan("");
  figures.max_error_direction = sums.largest.direction;
  figures.ssim_sphere = passes.ssim[c];
  set_squares(mean_squares(passes, c), peak, figures);
  return figures;
}

ErrorFigures total_figures(const Passes& passes, const MapPair& pair, const std::vector<ErrorFigures>& channels,
                           double peak) {
  ErrorFigures total;
  MeanSquares squares;
  const double share = 1.0 / static_cast<double>(std::ranges::count(pair.is_color, true));
  for (std::size_t c = 0; c < channels.size(); ++c) {
    if (!pair.is_color[c]) continue;
    const ErrorFigures& f = channels[c];
    total.mean_a += share * f.mean_a;
    total.mean_b += share * f.mean_b;
    total.mae += share * f.mae;
    total.ssim_sphere += share * f.ssim_sphere;
    if (!(f.max_error <= total.max_error)) {
      total.max_error = f.max_error;
      total.max_error_direction = f.max_error_direction;
    }
    const MeanSquares s = mean_squares(passes, c);
    squares.linear += share * s.linear;
    squares.logarithmic += share * s.logarithmic;
    squares.ws += share * s.ws;
    squares.s += share * s.s;
  }
  set_squares(squares, peak, total);
  return total;
}

using Corners = std::array<std::size_t, 3>;

std::vector<Vec3> icosahedron_corners() {
  const double golden = (1 + std::sqrt(5.0)) / 2;
  std::vector<Vec3> corners;
  for (const double s : {1.0, -1.0})
    for (const double t : {golden, -golden})
      for (const Vec3 corner : {Vec3{0, s, t}, Vec3{s, t, 0}, Vec3{t, 0, s}}) corners.push_back(normalize(corner));
  return corners;
}

// Three corners that are an edge apart are a face.
std::vector<Corners> icosahedron_faces(const std::vector<Vec3>& corners) {
  const auto is_edge = [&](std::size_t i, std::size_t j) { return dot(corners[i], corners[j]) > 0.4; };
  std::vector<Corners> faces;
  for (std::size_t i = 0; i < corners.size(); ++i)
    for (std::size_t j = i + 1; j < corners.size(); ++j)
      for (std::size_t k = j + 1; k < corners.size(); ++k)
        if (is_edge(i, j) && is_edge(j, k) && is_edge(i, k)) faces.push_back({i, j, k});
  return faces;
}

// The corners of a triangle's parts after bisections of all edges, at (i, j) with i + j <= n, n a power of two: the
// triangle's own corners are (0, 0), (n, 0) and (0, n).
class Lattice {
 public:
  Lattice(int n, Vec3 a, Vec3 b, Vec3 c) : n_(n), points_(static_cast<std::size_t>((n + 1) * (n + 1))) {
    at(0, 0) = a, at(n, 0) = b, at(0, n) = c;
    for (int half = n / 2; half > 0; half /= 2)
      for (int j = 0; j <= n; j += half)
        for (int i = 0; i + j <= n; i += half) {
          const int di = i % (2 * half), dj = j % (2 * half);  // half on a new corner, in one or in both
          if (di + dj > 0)
            at(i, j) = normalize(at(i - di, j + (di > 0 ? dj : -dj)) + at(i + di, j + (di > 0 ? -dj : dj)));
        }
  }
  Vec3& at(int i, int j) { return points_[static_cast<std::size_t>(j * (n_ + 1) + i)]; }

 private:
  int n_;
  std::vector<Vec3> points_;
};

std::vector<Vec3> bisected_icosahedron(int n) {
  std::vector<Vec3> points = icosahedron_corners();
  const std::vector<Vec3> corners = points;
  std::set<std::pair<std::size_t, std::size_t>> edges;  // whose points are there
  for (const auto& [a, b, c] : icosahedron_faces(corners)) {
    Lattice lattice(n, corners[a], corners[b], corners[c]);
    const bool ab = edges.emplace(a, b).second, ac = edges.emplace(a, c).second, bc = edges.emplace(b, c).second;
    for (int j = 0; j <= n; ++j)
      for (int i = 0; i + j <= n; ++i) {
        const bool on_ab = j == 0, on_ac = i == 0, on_bc = i + j == n;
        if (on_ab + on_ac + on_bc > 1) continue;  // a corner
        if ((!on_ab || ab) && (!on_ac || ac) && (!on_bc || bc)) points.push_back(lattice.at(i, j));
      }
  }
  return points;
}

}  // namespace

double log_encoded(double x) { return std::log2(std::max(x, 0.0) + 1.0 / 1024); }

double log_encoded_range(double peak) { return log_encoded(peak) - log_encoded(0); }

const std::vector<Vec3>& s_psnr_points() {
  static const std::vector<Vec3> all = bisected_icosahedron(1 << 8);
  return all;
}

Result<Comparison> compare_maps(const EnvImage& a, const EnvImage& b, const CompareOptions& options) {
  ENVCONV_TRY(const MapPair pair, MapPair::make(a, b));
  Comparison out;
  out.channels = pair.channels;
  out.only_in_a = pair.only_in_a;
  out.only_in_b = pair.only_in_b;
  out.same_grid = pair.same_grid;
  out.peak = options.peak > 0 ? options.peak : largest_color(pair);
  out.nonfinite_a = count_nonfinite(*pair.a);
  out.nonfinite_b = count_nonfinite(*pair.b);
  ENVCONV_CHECK(run_in_arena(options.threads, [&] {
    const Passes passes = run_passes(pair, out.peak);
    for (std::size_t c = 0; c < pair.channel_count(); ++c) out.figures.push_back(channel_figures(passes, c, out.peak));
    out.total = total_figures(passes, pair, out.figures, out.peak);
    out.excluded = passes.sphere.excluded / (passes.sphere.excluded + passes.sphere.weight);
  }));
  return out;
}

}  // namespace envconv
