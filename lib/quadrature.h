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

/// A texel's mean from a grid of samples in equal steps that its neighbours share: one axis.
///
/// `steps` samples lie in every `texels` texels, at (s + 1/2) texels / steps from where the grid begins.  Texel i takes
/// the `taps` samples from i / texels * steps + first[i % texels] on, those before the grid's beginning included, with
/// weight[i % texels].
struct GridQuadrature {
  int steps = 1, texels = 1;
  int taps = 0;
  std::vector<int> first;                                    ///< [texels]
  std::vector<float> weight;                                 ///< [texels][taps]; those of a texel add up to 1
  int before() const { return -first.front(); }              ///< samples before the grid's beginning that take part
  int after() const { return first.back() + taps - steps; }  ///< and beyond its end
  int samples(int n) const { return n / texels * steps + before() + after(); }  ///< for n texels
};

/// The waves in the source's texels, along their rows and along their columns, that a wave of one texel is.
struct SourceWave {
  double along = 0, across = 0;
};

/// Weights that make the sum over the grid the texel's integral of every wave that the source holds: least squares
/// between sum w_j exp(i k x_j) and sin(k/2) / (k/2).  The source's highest frequency is source_texels / 2 waves per
/// texel; waves well below it and below the texels' own limit of 1/2 weigh most, the lowest by far.  With steps of one
/// source texel the error is below -74 dB up to 0.2 of that limit, -64 dB up to 0.4 and -46 dB up to 0.6 where five
/// samples lie in four texels; with one in each and steps of 1.1, which are the longest, -80, -76 and -66 dB.
/// Samples that were read with Kernel::drooping have its loss made up for: drooping_height(k wave.along) *
/// drooping_height(k wave.across) in all.
GridQuadrature grid_quadrature(int steps, int texels, double source_texels, const SourceWave& wave);
inline constexpr double grid_reach = 4;     ///< texels beyond a texel's edge that hold all its samples
inline constexpr int most_grid_steps = 16;  ///< in a texel

}  // namespace envconv
