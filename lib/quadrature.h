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

}  // namespace envconv
