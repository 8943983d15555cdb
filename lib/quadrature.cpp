// SPDX-License-Identifier: Apache-2.0
#include "quadrature.h"

#include <array>
#include <cmath>

namespace envconv {

Quadrature box_quadrature(int n) {
  Quadrature q;
  if (n > 64) {
    for (int i = 0; i < n; ++i) q.offset.push_back((i + 0.5) / n - 0.5), q.weight.push_back(1.0 / n);
    return q;
  }
  // Roots of the Legendre polynomial by Newton's iteration from Tricomi's estimate; weights 2 / ((1-x^2) P'^2).
  for (int i = 0; i < n; ++i) {
    double x = -std::cos(M_PI * (i + 0.75) / (n + 0.5)), slope = 1;
    for (int step = 0; step < 20; ++step) {
      double p0 = 1, p1 = x;
      for (int k = 2; k <= n; ++k) {
        const double p2 = ((2 * k - 1) * x * p1 - (k - 1) * p0) / k;
        p0 = p1, p1 = p2;
      }
      if (n == 1) p0 = 1, p1 = x;
      slope = n * (x * p1 - p0) / (x * x - 1);
      const double dx = p1 / slope;
      x -= dx;
      if (std::abs(dx) < 1e-15) break;
    }
    if (2 * i + 1 == n) x = 0;  // the middle node, exactly
    q.offset.push_back(0.5 * x);
    q.weight.push_back(1 / ((1 - x * x) * slope * slope));
  }
  double sum = 0;
  for (const double w : q.weight) sum += w;
  for (double& w : q.weight) w /= sum;
  return q;
}

Quadrature quadrature(const Filter& filter, int n) {
  if (!filter.gaussian) return box_quadrature(n);
  Quadrature q;
  double sum = 0;
  for (int i = 0; i < n; ++i) {
    const double t = filter.window * ((i + 0.5) / n - 0.5);
    q.offset.push_back(t);
    q.weight.push_back(std::exp(-2 * t * t));  // sigma = 1/2
    sum += q.weight.back();
  }
  for (double& w : q.weight) w /= sum;
  return q;
}

namespace {

// Least squares min |A x - b| through modified Gram-Schmidt; columns of A are independent.
std::vector<double> least_squares(std::vector<std::vector<double>> columns, std::vector<double> b) {
  const auto dot = [](const std::vector<double>& p, const std::vector<double>& q) {
    double sum = 0;
    for (std::size_t i = 0; i < p.size(); ++i) sum += p[i] * q[i];
    return sum;
  };
  const std::size_t n = columns.size();
  std::vector<std::vector<double>> r(n, std::vector<double>(n + 1));
  for (std::size_t k = 0; k < n; ++k) {
    const double length = std::sqrt(dot(columns[k], columns[k]));
    r[k][k] = length;
    for (double& v : columns[k]) v /= length;
    const auto project = [&](std::vector<double>& v) {
      const double along = dot(columns[k], v);
      for (std::size_t i = 0; i < v.size(); ++i) v[i] -= along * columns[k][i];
      return along;
    };
    for (std::size_t j = k + 1; j < n; ++j) r[k][j] = project(columns[j]);
    r[k][n] = project(b);
  }
  std::vector<double> x(n);
  for (std::size_t k = n; k-- > 0;) {
    double sum = r[k][n];
    for (std::size_t j = k + 1; j < n; ++j) sum -= r[k][j] * x[j];
    x[k] = sum / r[k][k];
  }
  return x;
}

}  // namespace

namespace {

// The weights of samples at x[] texels from a texel's centre; where these lie symmetrically, so do the weights.
std::vector<double> wave_weights(const std::vector<double>& x, bool symmetric, double steps_per_texel,
                                 double source_texels, const SourceWave& wave) {
  constexpr int waves = 160;
  const double band = 0.5 * source_texels;  // waves per texel
  // Unknowns: weights, or pairs of them; the last follows from the sum of all, which is 1.
  const std::size_t unknowns = symmetric ? (x.size() + 1) / 2 : x.size(), free = unknowns - 1;
  const auto multiplicity = [&](std::size_t j) { return symmetric && 2 * j + 1 != x.size() ? 2.0 : 1.0; };
  const double last = multiplicity(free);
  // Waves' numbers are in equal steps, so their values at a sample follow by turning on.
  const double first_wave = 0.625 * M_PI * steps_per_texel / waves;  // radians per texel; steps are twice as long
  struct Turn {
    double cosine, sine;
  };
  std::vector<std::array<Turn, waves>> turns(unknowns);
  for (std::size_t j = 0; j < unknowns; ++j) {
    const double c = std::cos(2 * first_wave * x[j]), s = std::sin(2 * first_wave * x[j]);
    Turn turn{std::cos(first_wave * x[j]), std::sin(first_wave * x[j])};
    for (Turn& at : turns[j]) {
      at = turn;
      turn = {turn.cosine * c - turn.sine * s, turn.sine * c + turn.cosine * s};
    }
  }
  std::vector<std::vector<double>> columns(free);
  std::vector<double> b;
  for (int i = 0; i < waves; ++i) {
    const double f = 0.625 * steps_per_texel * (i + 0.5) / waves;  // to past the grid's own limit of half the steps
    const double within = std::min(0.85 * band, 0.42 * steps_per_texel);
    const double low = 2000 * std::max(0.0, 1 - f / 0.36);
    const double importance = f <= within ? (f <= 0.5 ? 20 + low : 2) : f <= band ? 0.25 : 0.02;
    const double k = 2 * M_PI * f, truth = std::sin(0.5 * k) / (0.5 * k);
    const double height = drooping_height(k * wave.along) * drooping_height(k * wave.across);
    for (const bool odd : {false, true}) {
      if (odd && symmetric) continue;
      const auto wave_at = [&](std::size_t j) {
        const Turn& turn = turns[j][static_cast<std::size_t>(i)];
        return height * (odd ? turn.sine : turn.cosine);
      };
      const double of_last = wave_at(free);
      for (std::size_t j = 0; j < free; ++j)
        columns[j].push_back(importance * multiplicity(j) * (wave_at(j) - of_last));
      b.push_back(importance * ((odd ? 0 : truth) - of_last));
    }
  }
  std::vector<double> w = least_squares(std::move(columns), std::move(b));
  double sum = 0;
  for (std::size_t j = 0; j < free; ++j) sum += multiplicity(j) * w[j];
  w.push_back((1 - sum) / last);
  for (std::size_t j = unknowns; j < x.size(); ++j) w.push_back(w[x.size() - 1 - j]);
  return w;
}

}  // namespace

GridQuadrature grid_quadrature(int steps, int texels, double source_texels, const SourceWave& wave) {
  const double density = static_cast<double>(steps) / texels;
  GridQuadrature q;
  q.steps = steps, q.texels = texels;
  // Long steps have little room between the band and their limit, and need more of the neighbours; more still where
  // they do not lie alike in every texel.  Around a sample that is a texel's middle as many lie before as after.
  const int around = (density >= 2 ? 4 : 6) + (texels > 1 ? 1 : 0);
  q.taps = static_cast<int>(std::ceil(density + around));
  std::vector<std::vector<double>> weights;
  for (int phase = 0; phase < texels; ++phase) {
    const double centre = (phase + 0.5) * density - 0.5;  // in samples
    q.first.push_back(static_cast<int>(std::lround(centre - 0.5 * (q.taps - 1))));
    const int mirrored = texels - 1 - phase;
    if (mirrored < phase) {
      weights.emplace_back(weights[static_cast<std::size_t>(mirrored)].rbegin(),
                           weights[static_cast<std::size_t>(mirrored)].rend());
      continue;
    }
    std::vector<double> x;
    for (int j = 0; j < q.taps; ++j) x.push_back((q.first.back() + j - centre) / density);
    weights.push_back(wave_weights(x, mirrored == phase, density, source_texels, wave));
  }
  for (const auto& w : weights)
    for (const double v : w) q.weight.push_back(static_cast<float>(v));
  return q;
}

}  // namespace envconv
