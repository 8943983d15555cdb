// SPDX-License-Identifier: Apache-2.0
// Where on the sphere two maps differ: profile and picture.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "map_pair.h"
#include "map_reader.h"
#include "metrics.h"

namespace envconv {
namespace {

// --- profile ---

constexpr int profile_grid = 256;
constexpr int bins_per_decade = 8, decades = 24;  // from 1e-12 to 1e12
constexpr int bins = bins_per_decade * decades;

double edge(int bin) { return std::pow(10, static_cast<double>(bin) / bins_per_decade - decades / 2.0); }

// Counts of points, of which all weigh the same.
struct ProfileSums {
  std::vector<double> squared = std::vector<double>(ErrorProfile::bands);
  std::vector<std::int64_t> points = std::vector<std::int64_t>(ErrorProfile::bands);
  std::vector<std::int64_t> histogram = std::vector<std::int64_t>(bins);
  std::int64_t equal = 0;

  void add(double error, double y) {
    const double from_top = std::acos(std::clamp(y, -1.0, 1.0)) / std::numbers::pi;
    const auto band = static_cast<std::size_t>(std::min(from_top * ErrorProfile::bands, ErrorProfile::bands - 1.0));
    squared[band] += error * error;
    ++points[band];
    if (error == 0) {
      ++equal;
    } else {
      const double bin = std::floor((std::log10(error) + decades / 2.0) * bins_per_decade);
      ++histogram[static_cast<std::size_t>(std::clamp(bin, 0.0, bins - 1.0))];
    }
  }
  void merge(const ProfileSums& other) {
    for (std::size_t i = 0; i < squared.size(); ++i) squared[i] += other.squared[i], points[i] += other.points[i];
    for (std::size_t i = 0; i < histogram.size(); ++i) histogram[i] += other.histogram[i];
    equal += other.equal;
  }
};

ErrorProfile profile_of(const ProfileSums& sums) {
  ErrorProfile out;
  std::int64_t points = 0;
  for (std::size_t i = 0; i < sums.squared.size(); ++i) {
    points += sums.points[i];
    out.rmse_by_latitude.push_back(std::sqrt(sums.squared[i] / static_cast<double>(sums.points[i])));
  }
  out.equal_share = static_cast<double>(sums.equal) / static_cast<double>(points);
  const auto is_filled = [](std::int64_t n) { return n > 0; };
  const auto first = std::ranges::find_if(sums.histogram, is_filled);
  if (first == sums.histogram.end()) return out;
  const auto last = std::find_if(sums.histogram.rbegin(), sums.histogram.rend(), is_filled).base();
  const int first_bin = static_cast<int>(first - sums.histogram.begin());
  for (auto bin = first; bin != last; ++bin)
    out.share.push_back(static_cast<double>(*bin) / static_cast<double>(points));
  for (int i = 0; i <= static_cast<int>(last - first); ++i) out.edges.push_back(edge(first_bin + i));
  return out;
}

// --- picture ---

// Sums of squared errors over the texels of one row, [texels], by points spread over their footprints.
class RowErrors {
 public:
  RowErrors(const MapPair& pair, const MapReader& a, const MapReader& b)
      : pair_(pair), a_(a), b_(b), at_a_(pair.channel_count() * PointBatch::most), at_b_(at_a_.size()) {}

  // Adds the errors at one point of each of n texels: u is that of the first, `step` apart.
  void add(const Layout& layout, const float* world_from_layout, int face, int n, double u, double step, double v,
           double* sums) {
    const auto padded = (static_cast<std::size_t>(n) + batch_padding - 1) / batch_padding * batch_padding;
    for (std::size_t i = 0; i < padded; ++i) {
      us_[i] = static_cast<float>(u + step * static_cast<double>(std::min(i, static_cast<std::size_t>(n) - 1)));
      vs_[i] = static_cast<float>(v);
    }
    layout.directions(face, padded, us_, vs_, points_.x, points_.y, points_.z);
    rotate_directions(world_from_layout, padded, points_.x, points_.y, points_.z);
    points_.count = n;
    a_.read(points_, at_a_.data());
    b_.read(points_, at_b_.data());
    const std::size_t channels = pair_.channel_count();
    for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i) {
      const double error = pair_.color_error(&at_a_[i * channels], &at_b_[i * channels]);
      sums[i] += error * error;
    }
  }

 private:
  const MapPair& pair_;
  const MapReader &a_, &b_;
  std::vector<float> at_a_, at_b_;
  PointBatch points_;
  alignas(64) float us_[PointBatch::most], vs_[PointBatch::most];
};

// Points along each side of an output texel, so that they lie as densely as the finer map's texels.
int points_a_side(const MapPair& pair, const EnvImage& out) {
  const auto texels = static_cast<double>(std::max(pair.a->texel_count(), pair.b->texel_count()));
  const double side = std::sqrt(texels / static_cast<double>(out.texel_count()));
  return static_cast<int>(std::clamp(std::ceil(side), 2.0, 16.0));
}

void fill_row(EnvImage& out, int face_index, int y, int k, RowErrors& errors) {
  Image& face = out.faces[static_cast<std::size_t>(face_index)];
  const Mat3 matrix = transpose(layout_from_world(out));
  float world_from_layout[9];
  for (std::size_t i = 0; i < 9; ++i) world_from_layout[i] = static_cast<float>(matrix.m[i]);
  const double step = texel_extent(face.width(), out.placement);
  for (int x0 = 0; x0 < face.width(); x0 += PointBatch::most) {
    const int n = std::min(PointBatch::most, face.width() - x0);
    std::vector<double> sums(static_cast<std::size_t>(n), 0.0);
    for (int j = 0; j < k; ++j)
      for (int i = 0; i < k; ++i) {
        const double u = u_from_texel(x0 + (i + 0.5) / k - 0.5, face.width(), out.placement);
        const double v = u_from_texel(y + (j + 0.5) / k - 0.5, face.height(), out.placement);
        errors.add(*out.layout, world_from_layout, face_index, n, u, step, v, sums.data());
      }
    for (int i = 0; i < n; ++i) {
      const double u = u_from_texel(x0 + i, face.width(), out.placement);
      const double v = u_from_texel(y, face.height(), out.placement);
      const double error = std::sqrt(sums[static_cast<std::size_t>(i)] / (k * k));
      *face.at(x0 + i, y) = out.layout->owns(face_index, u, v) ? static_cast<float>(error) : -1.0f;
    }
  }
}

}  // namespace

Result<ErrorProfile> error_profile(const EnvImage& a, const EnvImage& b, int threads) {
  ENVCONV_TRY(const MapPair pair, MapPair::make(a, b));
  ErrorProfile out;
  ENVCONV_CHECK(run_in_arena(threads, [&] {
    const MapReader reader_a(*pair.a), reader_b(*pair.b);
    const std::vector<PointSquare> squares = point_squares(profile_grid);
    constexpr std::size_t chunk = 32;  // squares
    std::vector<ProfileSums> parts((squares.size() + chunk - 1) / chunk);
    tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t part) {
      const std::size_t channels = pair.channel_count();
      const auto points = std::make_unique<PointBatch>();
      std::vector<float> at_a(channels * PointBatch::most), at_b(at_a.size());
      for (std::size_t s = part * chunk; s < std::min(squares.size(), (part + 1) * chunk); ++s) {
        lay_points(squares[s], *points);
        reader_a.read(*points, at_a.data());
        reader_b.read(*points, at_b.data());
        for (std::size_t i = 0; i < PointBatch::most; ++i) {
          const double error = pair.color_error(&at_a[i * channels], &at_b[i * channels]);
          if (!std::isnan(error)) parts[part].add(error, static_cast<double>(points->y[i]));
        }
      }
    });
    ProfileSums all;
    for (const ProfileSums& part : parts) all.merge(part);
    out = profile_of(all);
  }));
  return out;
}

Result<EnvImage> error_map(const EnvImage& a, const EnvImage& b, const Layout& layout, int height, int threads) {
  ENVCONV_TRY(const MapPair pair, MapPair::make(a, b));
  EnvImage out;
  ENVCONV_CHECK(run_in_arena(threads, [&] {
    out.layout = &layout;
    out.placement = layout.info().placement;
    out.channels = Channels::standard(1);
    for (int f = 0; f < layout.face_count(); ++f) {
      const Size size = face_size(layout, f, height);
      out.faces.emplace_back(size.width, size.height, 1);
    }
    const MapReader reader_a(*pair.a), reader_b(*pair.b);
    const int k = points_a_side(pair, out);
    for (int f = 0; f < layout.face_count(); ++f)
      tbb::parallel_for(0, out.faces[static_cast<std::size_t>(f)].height(), [&](int y) {
        const auto errors = std::make_unique<RowErrors>(pair, reader_a, reader_b);
        fill_row(out, f, y, k, *errors);
      });
  }));
  return out;
}

}  // namespace envconv
