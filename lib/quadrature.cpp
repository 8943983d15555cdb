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

}  // namespace envconv
