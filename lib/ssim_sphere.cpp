// SPDX-License-Identifier: Apache-2.0
#include "ssim_sphere.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>

#include "error_sums.h"

namespace envconv {
namespace {

// Of the centres: a step of 0.01 is that of a map of 126000 texels, of which every window covers 121.
constexpr double fine_pitch = 0.01;
constexpr int coarse_grid = 32, fine_grid = 64;
constexpr int reach = 5, side = 2 * reach + 1, window_points = side * side;
constexpr int windows_per_batch = PointBatch::most / window_points;
constexpr double sigma = 1.5;  // steps

// Weights of a window's points, which add up to 1.
const std::vector<double>& window_weights() {
  static const std::vector<double> weights = [] {
    std::vector<double> w;
    double sum = 0;
    for (int j = -reach; j <= reach; ++j)
      for (int i = -reach; i <= reach; ++i) sum += w.emplace_back(std::exp(-(i * i + j * j) / (2 * sigma * sigma)));
    for (double& value : w) value /= sum;
    return w;
  }();
  return weights;
}

void lay_window(Vec3 centre, double pitch, PointBatch& batch) {
  const Vec3 away = std::abs(centre.y) < 0.9 ? Vec3{0, 1, 0} : Vec3{1, 0, 0};
  const Vec3 across = normalize(cross(away, centre)), up = cross(centre, across);
  for (int j = -reach; j <= reach; ++j)
    for (int i = -reach; i <= reach; ++i) {
      const Vec3 d = centre + (pitch * i) * across + (pitch * j) * up;
      batch.x[batch.count] = static_cast<float>(d.x);
      batch.y[batch.count] = static_cast<float>(d.y);
      batch.z[batch.count] = static_cast<float>(d.z);
      ++batch.count;
    }
}

// Of one channel of one window, at points `stride` values apart; NaN when a value is.
double similarity(const float* a, const float* b, std::size_t stride, double range) {
  const std::vector<double>& weights = window_weights();
  const double black = static_cast<double>(log_encoded_float(0));  // means are measured from it
  double mean_a = 0, mean_b = 0, square_a = 0, square_b = 0, product = 0;
  for (std::size_t k = 0; k < weights.size(); ++k) {
    const float value_a = a[k * stride], value_b = b[k * stride];
    if (!std::isfinite(value_a) || !std::isfinite(value_b)) return std::nan("");
    const double x = static_cast<double>(log_encoded_float(value_a)) - black;
    const double y = static_cast<double>(log_encoded_float(value_b)) - black;
    mean_a += weights[k] * x;
    mean_b += weights[k] * y;
    square_a += weights[k] * x * x;
    square_b += weights[k] * y * y;
    product += weights[k] * x * y;
  }
  const double c1 = 0.01 * range * 0.01 * range, c2 = 0.03 * range * 0.03 * range;
  const double variance_a = square_a - mean_a * mean_a, variance_b = square_b - mean_b * mean_b;
  const double covariance = product - mean_a * mean_b;
  return (2 * mean_a * mean_b + c1) * (2 * covariance + c2) /
         ((mean_a * mean_a + mean_b * mean_b + c1) * (variance_a + variance_b + c2));
}

struct WindowSums {
  std::vector<double> similarity;
  int windows = 0;
};

// The windows around centres [first, first + n) of a batch.
void add_windows(const MapReader& a, const MapReader& b, const PointBatch& centres, int first, int n, double pitch,
                 double range, WindowSums& sums) {
  const auto batch = std::make_unique<PointBatch>();
  for (int i = first; i < first + n; ++i)
    lay_window(
        {static_cast<double>(centres.x[i]), static_cast<double>(centres.y[i]), static_cast<double>(centres.z[i])},
        pitch, *batch);
  const auto channels = static_cast<std::size_t>(a.channels());
  std::vector<float> at_a(channels * static_cast<std::size_t>(batch->count)), at_b(at_a.size());
  a.read(*batch, at_a.data());
  b.read(*batch, at_b.data());
  std::vector<double> values(channels);
  for (int i = 0; i < n; ++i) {
    const std::size_t at = static_cast<std::size_t>(i) * window_points * channels;
    bool whole = true;
    for (std::size_t c = 0; c < channels && whole; ++c) {
      values[c] = similarity(&at_a[at + c], &at_b[at + c], channels, range);
      whole = !std::isnan(values[c]);
    }
    if (!whole) continue;
    for (std::size_t c = 0; c < channels; ++c) sums.similarity[c] += values[c];
    ++sums.windows;
  }
}

}  // namespace

std::vector<double> ssim_on_sphere(const MapReader& a, const MapReader& b, double pitch, double range) {
  const std::vector<PointSquare> squares = point_squares(pitch < fine_pitch ? fine_grid : coarse_grid);
  constexpr int batches = (PointBatch::most + windows_per_batch - 1) / windows_per_batch;  // of a square's centres
  std::vector<WindowSums> parts(squares.size() * batches);
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t part) {
    const auto centres = std::make_unique<PointBatch>();
    lay_points(squares[part / batches], *centres);
    const int first = static_cast<int>(part % batches) * windows_per_batch;
    parts[part].similarity.assign(static_cast<std::size_t>(a.channels()), 0.0);
    add_windows(a, b, *centres, first, std::min(windows_per_batch, PointBatch::most - first), pitch, range,
                parts[part]);
  });
  std::vector<double> mean(static_cast<std::size_t>(a.channels()), 0.0);
  std::int64_t windows = 0;
  for (const WindowSums& part : parts) {
    for (std::size_t c = 0; c < mean.size(); ++c) mean[c] += part.similarity[c];
    windows += part.windows;
  }
  for (double& value : mean) value = windows > 0 ? value / static_cast<double>(windows) : std::nan("");
  return mean;
}

}  // namespace envconv
