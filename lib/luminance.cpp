// SPDX-License-Identifier: Apache-2.0
// Percentiles come from a histogram over the bits of floats, which are in the order of their values: each power of two
// has 4096 bins, of which the largest value is kept.  Bands of rows are computed in parallel and added up in order.
#include "luminance.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include "color.h"
#include "solid_angle.h"

namespace envconv {
namespace {

constexpr int kShift = 11;  // 23 bits of mantissa to 12

// Unsigned integers in the order of the floats.
std::uint32_t ordered(float v) {
  const auto bits = std::bit_cast<std::uint32_t>(v);
  return bits & 0x80000000u ? ~bits : bits | 0x80000000u;
}

struct Histogram {
  std::vector<double> weight = std::vector<double>((std::size_t{1} << (32 - kShift)), 0.0);
  std::vector<float> largest = std::vector<float>(weight.size(), -std::numeric_limits<float>::infinity());
  double total = 0;

  void add(float value, double w) {
    const std::size_t bin = ordered(value) >> kShift;
    weight[bin] += w;
    largest[bin] = std::max(largest[bin], value);
    total += w;
  }
  std::array<double, luminance_shares.size()> percentiles() const {
    std::array<double, luminance_shares.size()> result{};
    std::size_t next = 0;
    double below = 0, last = 0;
    for (std::size_t bin = 0; bin < weight.size() && next < result.size(); ++bin) {
      if (weight[bin] == 0) continue;
      below += weight[bin];
      last = static_cast<double>(largest[bin]);
      // Less the rounding of the sums, so that all of a plain sky counts as all.
      while (next < result.size() && below >= (luminance_shares[next] / 100 - 1e-12) * total) result[next++] = last;
    }
    while (next < result.size()) result[next++] = last;
    return result;
  }
};

struct Band {
  std::vector<float> luminance;
  std::vector<double> omega;
};

void fill(Band& band, const EnvImage& image, int f, int y0, int rows, const std::array<int, 3>& at,
          const std::array<double, 3>& weights) {
  const Image& face = image.faces[static_cast<std::size_t>(f)];
  const std::size_t count = static_cast<std::size_t>(rows) * static_cast<std::size_t>(face.width());
  band.luminance.resize(count);
  band.omega.resize(count);
  texel_solid_angles(*image.layout, f, {face.width(), face.height()}, image.placement, 0, y0, face.width(), rows,
                     band.omega.data());
  std::size_t i = 0;
  for (int y = y0; y < y0 + rows; ++y) {
    const float* texel = face.row(y);
    for (int x = 0; x < face.width(); ++x, ++i, texel += face.channels()) {
      double sum = 0;
      for (std::size_t c = 0; c < 3; ++c) sum += weights[c] * static_cast<double>(texel[at[c]]);
      band.luminance[i] = static_cast<float>(sum);
    }
  }
}

}  // namespace

double LuminanceStatistics::stops() const {
  return any && smallest_positive > 0 && max > 0 ? std::log2(max / smallest_positive) : 0;
}

double LuminanceStatistics::usual_stops() const {
  const double dark = percentiles.front(), bright = percentiles[luminance_shares.size() - 2];
  return any && dark > 0 ? std::log2(bright / dark) : 0;
}

Result<LuminanceStatistics> luminance_statistics(const EnvImage& image, const Chromaticities& primaries) {
  const auto at = color_channels(image.channels);
  if (!at) return Error{ErrorCode::unsupported, "holds no colour (channels R, G, B or Y)"};
  const Vec3 w = luminance_weights(primaries);
  // A grey is its own luminance, to the last bit.
  const std::array<double, 3> weights =
      (*at)[0] == (*at)[1] ? std::array<double, 3>{1, 0, 0} : std::array<double, 3>{w.x, w.y, w.z};
  LuminanceStatistics s;
  Histogram histogram;
  double sum = 0;
  constexpr int rows = solid_angle_block, group = 16;
  std::array<Band, group> bands;
  for (int f = 0; f < image.layout->face_count(); ++f) {
    const Image& face = image.faces[static_cast<std::size_t>(f)];
    for (int top = 0; top < face.height(); top += rows * group) {
      const int count = std::min(group, (face.height() - top + rows - 1) / rows);
      tbb::parallel_for(0, count, [&](int b) {
        const int y0 = top + b * rows;
        fill(bands[static_cast<std::size_t>(b)], image, f, y0, std::min(rows, face.height() - y0), *at, weights);
      });
      for (int b = 0; b < count; ++b) {
        const Band& band = bands[static_cast<std::size_t>(b)];
        for (std::size_t i = 0; i < band.luminance.size(); ++i) {
          const float v = band.luminance[i];
          const double value = static_cast<double>(v);
          if (!(band.omega[i] > 0) || !std::isfinite(v)) continue;
          if (!s.any || value > s.max) {
            s.max = value;
            s.brightest.face = f;
            s.brightest.x = static_cast<int>(i % static_cast<std::size_t>(face.width()));
            s.brightest.y = top + b * rows + static_cast<int>(i / static_cast<std::size_t>(face.width()));
          }
          if (!s.any || value < s.min) s.min = value;
          if (value > 0 && (s.smallest_positive == 0 || value < s.smallest_positive)) s.smallest_positive = value;
          s.any = true;
          histogram.add(v, band.omega[i]);
          sum += value * band.omega[i];
        }
      }
    }
  }
  if (!s.any) return s;
  s.mean = sum / histogram.total;
  s.percentiles = histogram.percentiles();
  const Image& face = image.faces[static_cast<std::size_t>(s.brightest.face)];
  s.brightest.direction =
      transpose(layout_from_world(image)) *
      image.layout->direction(s.brightest.face, u_from_texel(s.brightest.x, face.width(), image.placement),
                              u_from_texel(s.brightest.y, face.height(), image.placement));
  return s;
}

}  // namespace envconv
