// SPDX-License-Identifier: Apache-2.0
#include "quadrature.h"

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

GridQuadrature grid_quadrature(int steps) {
  const int n = steps + 2 * GridQuadrature::halo, half = (n + 1) / 2;
  const auto multiplicity = [&](int j) { return 2 * j + 1 == n ? 1.0 : 2.0; };
  const auto wave = [&](int j, double k) {
    return multiplicity(j) * std::cos(k * ((j - GridQuadrature::halo + 0.5) / steps - 0.5));
  };
  // The last weight follows from the sum of all, which is 1.
  constexpr int waves = 600;
  const double last = multiplicity(half - 1);
  std::vector<std::vector<double>> columns(static_cast<std::size_t>(half - 1));
  std::vector<double> b;
  for (int i = 0; i < waves; ++i) {
    const double k = 1.25 * M_PI * steps * (i + 0.5) / waves;
    const double importance = k <= M_PI ? 20 : k < 0.8 * M_PI * steps ? 1 : 0.05;
    for (int j = 0; j < half - 1; ++j)
      columns[static_cast<std::size_t>(j)].push_back(importance *
                                                     (wave(j, k) - wave(half - 1, k) * multiplicity(j) / last));
    b.push_back(importance * (std::sin(0.5 * k) / (0.5 * k) - wave(half - 1, k) / last));
  }
  std::vector<double> x = least_squares(std::move(columns), std::move(b));
  double sum = 0;
  for (int j = 0; j < half - 1; ++j) sum += multiplicity(j) * x[static_cast<std::size_t>(j)];
  x.push_back((1 - sum) / last);
  GridQuadrature q;
  q.steps = steps;
  for (int j = 0; j < n; ++j)
    q.weight.push_back(static_cast<float>(x[static_cast<std::size_t>(std::min(j, n - 1 - j))]));
  return q;
}

}  // namespace envconv
