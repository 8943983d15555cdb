// SPDX-License-Identifier: Apache-2.0
// Where in an output texel the sub-samples lie, and what they weigh.
#pragma once

#include <vector>

#include "filter.h"

namespace envconv {

/// One axis: offsets from the texel's centre in texels, and weights that add up to 1.
struct Quadrature {
  std::vector<double> offset, weight;
  int count() const { return static_cast<int>(offset.size()); }
};

/// n Gauss-Legendre nodes over [-1/2, 1/2] (exact for polynomials of degree 2n-1); above 64, where the nodes crowd at
/// the ends more than sampling needs, n equal steps.
Quadrature box_quadrature(int n);

/// The nodes for a filter: its box, or n equal steps over its Gaussian window.
Quadrature quadrature(const Filter& filter, int n);

/// A texel's mean from a grid of equal steps that its neighbours share: one axis.
struct GridQuadrature {
  static constexpr int halo = 2;  ///< steps beyond each side of the texel that take part
  int steps = 0;                  ///< in the texel
  std::vector<float> weight;      ///< [steps + 2 halo]; they add up to 1
};

/// Weights that make the sum over the grid the texel's integral of every wave that the grid resolves: least squares
/// between sum w_j cos(k x_j) and sin(k/2) / (k/2), for k from 0 to past the grid's Nyquist limit pi steps, with most
/// weight up to pi, the texels' own.  With two steps the error of a wave is below -72 dB up to there, where two
/// Gauss-Legendre nodes have -34 dB at the same cost.  steps: 1 to most_grid_steps.
GridQuadrature grid_quadrature(int steps);
inline constexpr int most_grid_steps = 16;

}  // namespace envconv
