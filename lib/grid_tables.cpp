// SPDX-License-Identifier: Apache-2.0
#include "grid_tables.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace envconv {
namespace {

// Largest steps of a grid, in source texels.
constexpr double grid_spacing = 1.1, direct_spacing = 2.0;

}  // namespace

const Quadrature& GridTables::nodes(int n) {
  const std::lock_guard lock(mutex_);
  auto& q = quadratures_[n];
  if (!q) q = std::make_unique<Quadrature>(quadrature(filter_, n));
  return *q;
}

std::optional<GridQuadrature> GridTables::grid(double need, const SourceWave& wave, Kernel kernel, int n) {
  const double spacing = kernel == Kernel::drooping ? direct_spacing : grid_spacing;
  int steps = samples_, texels = 1;
  if (steps == 0) {
    // Of 1, 5/4, 3/2, 7/4, 2, 3, 4, 5 ... as few as will do.  Fractions see high frequencies less well: their steps
    // are shorter for it, and above 2 they take 9 dB from waves at 0.98 of the source's limit.
    const double wanted = need / spacing;
    int fraction = 1;
    if (wanted > 1 && wanted <= 1.6) fraction = n % 4 == 0 ? 4 : n % 2 == 0 ? 2 : 1;
    const double longest = fraction == 4 ? 1.0 : spacing;
    steps = std::max(1, static_cast<int>(std::ceil(std::min(need / longest, 1e6) * fraction)));
    texels = fraction;
    while (texels > 1 && steps % 2 == 0) steps /= 2, texels /= 2;
  }
  if (steps > most_grid_steps * texels) return std::nullopt;
  // In steps' source texels, rounded, so that few tables serve all tiles.
  const double density = static_cast<double>(steps) / texels;
  const int length = std::max(1, static_cast<int>(std::ceil(8 * need / density - 0.25)));
  if (kernel != Kernel::drooping) return table({steps, texels, length, 0, 0});
  // What the kernel loses changes faster with the length of a step: between tables.
  const auto split = [&](double wave, int& low) {
    const double at = 8 * std::min(wave * density, 2.0);
    low = static_cast<int>(at);
    return static_cast<float>(at - low);
  };
  int along, across;
  const float s = split(wave.along, along), t = split(wave.across, across);
  GridQuadrature between = table({steps, texels, length, along, across});
  const GridQuadrature &right = table({steps, texels, length, along + 1, across}),
                       &below = table({steps, texels, length, along, across + 1}),
                       &both = table({steps, texels, length, along + 1, across + 1});
  for (std::size_t i = 0; i < between.weight.size(); ++i) {
    const float top = between.weight[i] + s * (right.weight[i] - between.weight[i]);
    between.weight[i] = top + t * (below.weight[i] + s * (both.weight[i] - below.weight[i]) - top);
  }
  return between;
}

// By steps, texels, and 8ths of a source texel: a step's length, and a step's wave along and across.
const GridQuadrature& GridTables::table(const std::array<int, 5>& key) {
  const auto found = [&]() -> const GridQuadrature* {
    const std::lock_guard lock(mutex_);
    const auto at = grids_.find(key);
    return at == grids_.end() ? nullptr : at->second.get();
  };
  if (const GridQuadrature* q = found()) return *q;
  // Made without the lock: others need not wait, and who made the same one meanwhile made the same.
  const double density = static_cast<double>(key[0]) / key[1];
  auto made = std::make_unique<GridQuadrature>(
      grid_quadrature(key[0], key[1], key[2] / 8.0 * density, {key[3] / 8.0 / density, key[4] / 8.0 / density}));
  const std::lock_guard lock(mutex_);
  return *grids_.try_emplace(key, std::move(made)).first->second;
}

}  // namespace envconv
