// SPDX-License-Identifier: Apache-2.0
// The innermost sums of the discrepancy, on the best SIMD target of this machine.
#pragma once

#include <cstddef>

namespace envconv {

/// Points as three arrays, and where they are wanted a weight for each.  Arrays need no alignment and no padding.
struct PointArrays {
  const double *x, *y, *z, *weight;
  std::size_t count;
};

/// Sum over all pairs of ln(1 + |a - b| / 2).  Distances are at most 2.
double log_distance_sum(const PointArrays& a, const PointArrays& b);

/// Sum over all pairs of weight_a weight_b ln(1 + |a - b| / 2).
double weighted_log_distance_sum(const PointArrays& a, const PointArrays& b);

}  // namespace envconv
