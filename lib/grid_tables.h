// SPDX-License-Identifier: Apache-2.0
// Quadratures of one resampling, made when they are first asked for.  For several threads at once.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <mutex>
#include <optional>

#include "filter.h"
#include "quadrature.h"

namespace envconv {

inline constexpr double direct_ratio = 3.5;  ///< source texels in a texel from which no prefilter is needed

class GridTables {
 public:
  /// samples: as many in a texel, or 0 for as many as are needed.
  GridTables(const Filter& filter, int samples) : filter_(filter), samples_(samples) {}

  /// quadrature() of the filter with n nodes.
  const Quadrature& nodes(int n);

  /// The grid for n texels in a row whose sides are `need` source texels at most, and whose waves are `wave` in the
  /// source; nothing when that takes more steps than a grid has.  kernel: band_limited or drooping.
  std::optional<GridQuadrature> grid(double need, const SourceWave& wave, Kernel kernel, int n);

 private:
  const GridQuadrature& table(const std::array<int, 5>& key);

  const Filter& filter_;
  int samples_;
  std::map<int, std::unique_ptr<Quadrature>> quadratures_;
  std::map<std::array<int, 5>, std::unique_ptr<GridQuadrature>> grids_;
  std::mutex mutex_;
};

}  // namespace envconv
