// SPDX-License-Identifier: Apache-2.0
#include "tile_plan.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace envconv {
namespace {

constexpr double sliver_limit = 1.375;  // longest side over shortest that the sampling follows
constexpr int sliver_samples = 24;      // samples a side where highlights lie on slivers

// Whether the map's derivatives jump somewhere: between two of five points in a row they change much more than between
// the others.  Creases are straight or nearly so, and jumps of the size of the derivatives themselves.
bool jumps(const Vec3 (&d)[5]) {
  double change[4];
  for (int i = 0; i < 4; ++i) {
    change[i] = length(d[i + 1] - d[i]);
    if (!std::isfinite(change[i])) return true;
  }
  std::sort(change, change + 4);
  return change[3] > 3 * change[1] + 0.05 * length(d[2]);
}

// Of the tile, and the texels around it that a grid's weights reach.
bool is_creased(const EnvImage& out, const Tile& tile) {
  constexpr int nodes = 5;
  const Image& face = out.faces[static_cast<std::size_t>(tile.face)];
  const double wide = tile.width + 2 * grid_reach, high = tile.height + 2 * grid_reach;
  DirectionJet jets[nodes][nodes];
  for (int j = 0; j < nodes; ++j)
    for (int i = 0; i < nodes; ++i)
      jets[j][i] = out.layout->direction_jet(
          tile.face, u_from_texel(tile.x0 - 0.5 - grid_reach + wide * i / (nodes - 1), face.width(), out.placement),
          u_from_texel(tile.y0 - 0.5 - grid_reach + high * j / (nodes - 1), face.height(), out.placement));
  for (const auto derivative : {&DirectionJet::du, &DirectionJet::dv})
    for (int k = 0; k < nodes; ++k) {
      Vec3 row[nodes], column[nodes];
      for (int i = 0; i < nodes; ++i) row[i] = jets[k][i].*derivative, column[i] = jets[i][k].*derivative;
      if (jumps(row) || jumps(column)) return true;
    }
  return false;
}

}  // namespace

TilePlan plan_tile(const EnvImage& source, const EnvImage& out, const Mat3& source_from_out, const Filter& filter,
                   const ResampleOptions& options, const Tile& tile) {
  TilePlan plan;
  const Image& face = out.faces[static_cast<std::size_t>(tile.face)];
  const double eu = texel_extent(face.width(), out.placement), ev = texel_extent(face.height(), out.placement);
  int waves = 0;
  bool one_face = true;
  for (int j = 0; j < TilePlan::nodes_y; ++j)
    for (int i = 0; i < TilePlan::nodes_x; ++i) {
      const double u =
          u_from_texel(tile.x0 - 0.5 + tile.width * i / (TilePlan::nodes_x - 1.0), face.width(), out.placement);
      const double v =
          u_from_texel(tile.y0 - 0.5 + tile.height * j / (TilePlan::nodes_y - 1.0), face.height(), out.placement);
      const DirectionJet jet = out.layout->direction_jet(tile.face, u, v);
      const double density = length(cross(jet.du, jet.dv));
      plan.density[j][i] = out.layout->info().equal_area ? 1.0 : std::isfinite(density) ? density : 0.0;
      if (i % 2 || j % 2) continue;
      // Sides of the texel in source texels.
      const Vec3 tu = source_from_out * (eu * jet.du), tv = source_from_out * (ev * jet.dv);
      const Vec3 d = source_from_out * jet.d;
      const Location at = source.layout->locate(d);
      const Image& s = source.faces[static_cast<std::size_t>(at.face)];
      if (plan.view.face < 0) plan.view.face = at.face;
      one_face = one_face && plan.view.face == at.face;
      plan.view.add(texel_from_u(at.u, s.width(), source.placement), texel_from_u(at.v, s.height(), source.placement));
      const DirectionJet from = source.layout->direction_jet(at.face, at.u, at.v);
      const Vec3 a = texel_extent(s.width(), source.placement) * from.du;
      const Vec3 b = texel_extent(s.height(), source.placement) * from.dv;
      const double aa = dot(a, a), ab = dot(a, b), bb = dot(b, b);
      const double root = std::sqrt((aa - bb) * (aa - bb) + 4 * ab * ab);
      double wide = std::sqrt(0.5 * (aa + bb + root));
      const double thin =
          std::max(std::sqrt(std::max(0.0, 0.5 * (aa + bb - root))), wide / (filter.limited ? sliver_limit : 1));
      if (!(wide > 0) || !std::isfinite(wide)) continue;
      const double angle = 0.5 * std::atan2(2 * ab, aa - bb);
      const Vec3 along = (1 / wide) * (std::cos(angle) * a + std::sin(angle) * b);
      // A side of the output's texel in the source's, along these and across.
      const Vec3 across = cross(normalize(d), along);
      struct Side {
        double along, across;
        double squared() const { return along * along + across * across; }
      };
      const Side su{dot(tu, along) / wide, dot(tu, across) / thin}, sv{dot(tv, along) / wide, dot(tv, across) / thin};
      const double nu = std::sqrt(su.squared()), nv = std::sqrt(sv.squared());
      if (std::isfinite(nu)) plan.need_u = std::max(plan.need_u, nu);
      if (std::isfinite(nv)) plan.need_v = std::max(plan.need_v, nv);
      const double area = su.along * sv.across - su.across * sv.along, both = su.squared() + sv.squared();
      const double narrow = std::sqrt(0.5 * (both - std::sqrt(std::max(0.0, both * both - 4 * area * area))));
      if (std::isfinite(narrow)) plan.least = std::min(plan.least, narrow);
      // Both sides in the source's rows and columns, and the wave vectors q with q.tu = 1, q.tv = 0 and vice versa.
      const double gram = aa * bb - ab * ab;
      const auto texels = [&](Vec3 t) {
        const double x = dot(t, a), y = dot(t, b);
        return std::pair{(x * bb - y * ab) / gram, (y * aa - x * ab) / gram};
      };
      const auto [ux, uy] = texels(tu);
      const auto [vx, vy] = texels(tv);
      const double turn = ux * vy - uy * vx;
      const SourceWave qu{std::abs(vy / turn), std::abs(vx / turn)}, qv{std::abs(uy / turn), std::abs(ux / turn)};
      if (!std::isfinite(qu.along + qu.across + qv.along + qv.across)) continue;
      ++waves;
      plan.wave_u.along += qu.along, plan.wave_u.across += qu.across;
      plan.wave_v.along += qv.along, plan.wave_v.across += qv.across;
    }
  if (!one_face) plan.view = {};
  for (SourceWave* wave : {&plan.wave_u, &plan.wave_v})
    if (waves > 0) wave->along /= waves, wave->across /= waves;
  double least = plan.density[0][0], most = least;
  for (const auto& row : plan.density)
    for (const double density : row) least = std::min(least, density), most = std::max(most, density);
  if (out.layout->info().domain == Domain::disc) {
    for (const double x : {tile.x0 - grid_reach, tile.x0 + tile.width - 1 + grid_reach})
      for (const double y : {tile.y0 - grid_reach, tile.y0 + tile.height - 1 + grid_reach})
        plan.inside = plan.inside && std::hypot(u_from_texel(x, face.width(), out.placement) - 0.5,
                                                u_from_texel(y, face.height(), out.placement) - 0.5) < 0.5;
  }
  plan.smooth = plan.inside && least > 0.2 * most;
  plan.creased = filter.limited && plan.smooth && is_creased(out, tile);
  if (options.samples > 0) {
    plan.ku = plan.kv = options.samples;
  } else {
    const auto samples = [&](double texels) {
      if (filter.spacing <= 0) return filter.least_samples;
      const double wanted = std::ceil(texels * filter.window / filter.spacing - 0.02);
      return std::max(filter.least_samples, static_cast<int>(std::min(wanted, 4096.0)));
    };
    plan.ku = samples(plan.need_u);
    plan.kv = samples(plan.need_v);
  }
  if (tile.slivers) plan.ku = std::max(plan.ku, sliver_samples), plan.kv = std::max(plan.kv, sliver_samples);
  return plan;
}

}  // namespace envconv
