// SPDX-License-Identifier: Apache-2.0
#include "tile_plan.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace envconv {
namespace {

constexpr double sliver_limit = 1.375;    // longest side over shortest that the sampling follows
constexpr double rim = 0.5 * (1 - 1e-6);  // of a disc, in its u and v

// The sides of the texel around a point of a disc, as chords: derivatives have no bound at some discs' rims.  What lies
// beyond the rim is taken to it.
std::pair<Vec3, Vec3> chords(const EnvImage& out, int face, double u, double v, double eu, double ev) {
  const auto at = [&](double a, double b) {
    const double x = a - 0.5, y = b - 0.5, rr = x * x + y * y, scale = rr > rim * rim ? rim / std::sqrt(rr) : 1;
    return out.layout->direction(face, 0.5 + scale * x, 0.5 + scale * y);
  };
  return {at(u + 0.5 * eu, v) - at(u - 0.5 * eu, v), at(u, v + 0.5 * ev) - at(u, v - 0.5 * ev)};
}

// A texel of the source about a direction (in its axes): what lengths on the sphere are in it.
struct SourceTexel {
  Location at;
  Vec3 a, b;           // its sides
  Vec3 along, across;  // unit vectors, where it is longest and thinnest
  double wide, thin;   // its extent there; a sliver's limited
  bool usable() const { return wide > 0 && std::isfinite(wide); }
  struct Way {
    double along, across;  // in source texels
    double squared() const { return along * along + across * across; }
  };
  Way way(Vec3 t) const { return {dot(t, along) / wide, dot(t, across) / thin}; }
};

SourceTexel source_texel(const EnvImage& source, const Filter& filter, const Vec3& d) {
  SourceTexel texel;
  texel.at = source.layout->locate(d);
  const Image& s = source.faces[static_cast<std::size_t>(texel.at.face)];
  const DirectionJet jet = source.layout->direction_jet(texel.at.face, texel.at.u, texel.at.v);
  texel.a = texel_extent(s.width(), source.placement) * jet.du;
  texel.b = texel_extent(s.height(), source.placement) * jet.dv;
  const double aa = dot(texel.a, texel.a), ab = dot(texel.a, texel.b), bb = dot(texel.b, texel.b);
  const double root = std::sqrt((aa - bb) * (aa - bb) + 4 * ab * ab);
  texel.wide = std::sqrt(0.5 * (aa + bb + root));
  texel.thin =
      std::max(std::sqrt(std::max(0.0, 0.5 * (aa + bb - root))), texel.wide / (filter.limited ? sliver_limit : 1));
  if (!texel.usable()) return texel;
  const double angle = 0.5 * std::atan2(2 * ab, aa - bb);
  texel.along = (1 / texel.wide) * (std::cos(angle) * texel.a + std::sin(angle) * texel.b);
  texel.across = cross(normalize(d), texel.along);
  return texel;
}

// A texel of the output among the source's.
struct Footprint {
  Location at;                    // of its centre, in the source
  double side_u = 0, side_v = 0;  // source texels along its sides
  double narrow = 1e30;           // source texels that it is wide where it is narrowest
  SourceWave wave_u, wave_v;      // see TilePlan; meaningful if has_waves
  bool has_waves = false;
};

Footprint footprint(const EnvImage& source, const EnvImage& out, const Mat3& source_from_out, const Filter& filter,
                    int face, double u, double v, const DirectionJet& jet) {
  const Image& pixels = out.faces[static_cast<std::size_t>(face)];
  const double eu = texel_extent(pixels.width(), out.placement), ev = texel_extent(pixels.height(), out.placement);
  Footprint f;
  const auto [du, dv] =
      out.layout->info().domain == Domain::disc ? chords(out, face, u, v, eu, ev) : std::pair(eu * jet.du, ev * jet.dv);
  const Vec3 tu = source_from_out * du, tv = source_from_out * dv, d = source_from_out * jet.d;
  const SourceTexel texel = source_texel(source, filter, d);
  f.at = texel.at;
  if (!texel.usable()) return f;
  const Vec3 &a = texel.a, &b = texel.b;
  const double aa = dot(a, a), ab = dot(a, b), bb = dot(b, b);
  const SourceTexel::Way su = texel.way(tu), sv = texel.way(tv);
  f.side_u = std::sqrt(su.squared()), f.side_v = std::sqrt(sv.squared());
  const double area = su.along * sv.across - su.across * sv.along, both = su.squared() + sv.squared();
  f.narrow = std::sqrt(0.5 * (both - std::sqrt(std::max(0.0, both * both - 4 * area * area))));
  // Both sides in the source's rows and columns, and the wave vectors q with q.tu = 1, q.tv = 0 and vice versa.
  const double gram = aa * bb - ab * ab;
  const auto texels = [&](Vec3 t) {
    const double x = dot(t, a), y = dot(t, b);
    return std::pair{(x * bb - y * ab) / gram, (y * aa - x * ab) / gram};
  };
  const auto [ux, uy] = texels(tu);
  const auto [vx, vy] = texels(tv);
  const double turn = ux * vy - uy * vx;
  f.wave_u = {std::abs(vy / turn), std::abs(vx / turn)}, f.wave_v = {std::abs(uy / turn), std::abs(ux / turn)};
  f.has_waves = std::isfinite(f.wave_u.along + f.wave_u.across + f.wave_v.along + f.wave_v.across);
  return f;
}

// Samples of a side of so many source texels.
int samples_of(const Filter& filter, double texels) {
  if (filter.spacing <= 0) return filter.least_samples;
  const double wanted = std::ceil(texels * filter.window / filter.spacing - 0.02);
  return std::max(filter.least_samples, static_cast<int>(std::min(wanted, 4096.0)));
}

}  // namespace

void TexelMask::add(int left, int top, int right, int bottom, const Tile& tile) {
  left = std::max(left, 0), top = std::max(top, 0);
  right = std::min(right, tile.width), bottom = std::min(bottom, tile.height);
  if (left >= right || top >= bottom) return;
  static_assert(largest_tile == 64);
  const std::uint64_t bits = (~std::uint64_t{0} >> (64 - (right - left))) << left;
  for (int j = top; j < bottom; ++j) rows[j] |= bits;
  any = true;
}

TilePlan plan_tile(const EnvImage& source, const EnvImage& out, const Mat3& source_from_out, const Filter& filter,
                   const ResampleOptions& options, const Tile& tile) {
  TilePlan plan;
  const Image& face = out.faces[static_cast<std::size_t>(tile.face)];
  const bool disc = out.layout->info().domain == Domain::disc;
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
      plan.to[j][i] = source_from_out * jet.d;
      if (i % 2 || j % 2) continue;
      const Footprint f = footprint(source, out, source_from_out, filter, tile.face, u, v, jet);
      const Image& s = source.faces[static_cast<std::size_t>(f.at.face)];
      if (plan.view.face < 0) plan.view.face = f.at.face;
      one_face = one_face && plan.view.face == f.at.face;
      plan.view.add(texel_from_u(f.at.u, s.width(), source.placement),
                    texel_from_u(f.at.v, s.height(), source.placement));
      for (int q = 0; q < 4; ++q) {
        const int right = q % 2, lower = q / 2;
        if (std::abs(i - 1 - 2 * right) > 1 || std::abs(j - 1 - 2 * lower) > 1) continue;
        TilePlan::Need& need = plan.quarter[lower][right];
        if (std::isfinite(f.side_u)) need.u = std::max(need.u, f.side_u);
        if (std::isfinite(f.side_v)) need.v = std::max(need.v, f.side_v);
        plan.need_u = std::max(plan.need_u, need.u), plan.need_v = std::max(plan.need_v, need.v);
      }
      if (std::isfinite(f.narrow)) plan.least = std::min(plan.least, f.narrow);
      if (!f.has_waves) continue;
      ++waves;
      plan.wave_u.along += f.wave_u.along, plan.wave_u.across += f.wave_u.across;
      plan.wave_v.along += f.wave_v.along, plan.wave_v.across += f.wave_v.across;
    }
  if (!one_face) plan.view = {};
  for (SourceWave* wave : {&plan.wave_u, &plan.wave_v})
    if (waves > 0) wave->along /= waves, wave->across /= waves;
  double least = plan.density[0][0], most = least;
  for (const auto& row : plan.density)
    for (const double density : row) least = std::min(least, density), most = std::max(most, density);
  if (disc) {
    for (const double x : {tile.x0 - grid_reach, tile.x0 + tile.width - 1 + grid_reach})
      for (const double y : {tile.y0 - grid_reach, tile.y0 + tile.height - 1 + grid_reach})
        plan.inside = plan.inside && std::hypot(u_from_texel(x, face.width(), out.placement) - 0.5,
                                                u_from_texel(y, face.height(), out.placement) - 0.5) < 0.5;
  }
  plan.smooth = plan.inside && least > 0.2 * most;
  if (options.samples > 0) {
    plan.ku = plan.kv = options.samples;
  } else {
    plan.ku = samples_of(filter, plan.need_u);
    plan.kv = samples_of(filter, plan.need_v);
  }
  return plan;
}

void creased_densities(const TilePlan& plan, const Tile& tile, double x, double step, double y, int n,
                       float* __restrict out) {
  const double wide = static_cast<double>(tile.width) / (TilePlan::nodes_x - 1);
  const double high = static_cast<double>(tile.height) / (TilePlan::nodes_y - 1);
  const int row = std::clamp(static_cast<int>(y / high), 0, TilePlan::nodes_y - 2);
  const double t = y / high - row;
  for (int cell = 0, i = 0; cell < TilePlan::nodes_x - 1; ++cell) {
    const double left = plan.density[row][cell] + t * (plan.density[row + 1][cell] - plan.density[row][cell]);
    const double right =
        plan.density[row][cell + 1] + t * (plan.density[row + 1][cell + 1] - plan.density[row][cell + 1]);
    const int end = cell + 2 == TilePlan::nodes_x
                        ? n
                        : std::clamp(static_cast<int>(std::ceil(((cell + 1) * wide - x) / step)), i, n);
    const float scale = static_cast<float>((right - left) / wide * step);
    const float first = static_cast<float>(left + (right - left) / wide * (x - cell * wide));
    for (; i < end; ++i) out[i] = first + scale * static_cast<float>(i);
  }
}

void density_slopes(const TilePlan& plan, const Tile& tile, int j, int begin, int end, float* __restrict gx,
                    float* __restrict gy) {
  const double wide = static_cast<double>(tile.width) / (TilePlan::nodes_x - 1);
  const double high = static_cast<double>(tile.height) / (TilePlan::nodes_y - 1);
  const int k = std::min(static_cast<int>((j + 0.5) / high), TilePlan::nodes_y - 2);
  const double t = (j + 0.5) / high - k;
  for (int cell = 0, i = begin; cell < TilePlan::nodes_x - 1; ++cell) {
    const double a = plan.density[k][cell], b = plan.density[k][cell + 1];
    const double c = plan.density[k + 1][cell], d = plan.density[k + 1][cell + 1];
    const float left = static_cast<float>(a + t * (c - a)), right = static_cast<float>(b + t * (d - b));
    const float across = static_cast<float>((right - left) / wide);
    const float down_left = static_cast<float>((c - a) / high), down_right = static_cast<float>((d - b) / high);
    const int last =
        cell + 2 == TilePlan::nodes_x ? end : std::min(end, static_cast<int>(std::ceil((cell + 1) * wide - 0.5)));
    const float scale = static_cast<float>(1 / wide), first = static_cast<float>(0.5 - cell * wide);
    for (; i < last; ++i) {
      const float x = (static_cast<float>(i) + first) * scale;
      const float here = left + x * (right - left);
      const float inverse = here > 0 ? 1.0f / here : 0.0f;
      gx[i] = std::clamp(across * inverse, -2.0f, 2.0f);
      gy[i] = std::clamp((down_left + x * (down_right - down_left)) * inverse, -2.0f, 2.0f);
    }
  }
}

void creased_slopes(const EnvImage& out, const Tile& tile, int j, int begin, int end, float* __restrict gx,
                    float* __restrict gy) {
  constexpr double aside = 0.29;  // texels: about where two nodes lie
  const Image& face = out.faces[static_cast<std::size_t>(tile.face)];
  for (int i = begin; i < end; ++i) {
    const auto density = [&](double dx, double dy) {
      return out.layout->density(tile.face, u_from_texel(tile.x0 + i + dx, face.width(), out.placement),
                                 u_from_texel(tile.y0 + j + dy, face.height(), out.placement));
    };
    const double left = density(-aside, 0), right = density(aside, 0), top = density(0, -aside),
                 bottom = density(0, aside);
    const auto slope = [&](double before, double after) {
      const double g = (after - before) / (aside * (before + after));
      return std::isfinite(g) ? static_cast<float>(std::clamp(g, -2.0, 2.0)) : 0.0f;
    };
    gx[i] = slope(left, right), gy[i] = slope(top, bottom);
  }
}

RimSamples rim_samples(const EnvImage& source, const EnvImage& out, const Mat3& source_from_out, const Filter& filter,
                       int face, int x, int y) {
  const Image& pixels = out.faces[static_cast<std::size_t>(face)];
  const double u = u_from_texel(x, pixels.width(), out.placement), v = u_from_texel(y, pixels.height(), out.placement);
  const double extent = texel_extent(pixels.width(), out.placement);
  RimSamples samples(RimTexel((u - 0.5) / extent, (v - 0.5) / extent, 0.5 / extent));
  if (samples.texel.pieces() == 0) return samples;
  const auto direction = [&](double out_by, double aside) {
    const auto [dx, dy] = samples.texel.place(out_by, aside);
    return source_from_out * out.layout->direction(face, u + extent * dx, v + extent * dy);
  };
  const int pieces = samples.texel.pieces();
  Vec3 bound[RimTexel::most_pieces + 1];
  for (int i = 0; i <= pieces; ++i) bound[i] = direction(samples.texel.bound(i), 0);
  const SourceTexel texel = source_texel(source, filter, bound[0] + bound[pieces]);
  const auto counted = [&](Vec3 way) {
    return samples_of(filter, texel.usable() ? std::sqrt(texel.way(way).squared()) : 0);
  };
  // One more than a wave takes: the chords' length changes along a piece.
  for (int i = 0; i < pieces; ++i) samples.outwards[i] = counted(bound[i + 1] - bound[i]) + 1;
  const double inner = samples.texel.bound(0);
  samples.aside = std::max(2, counted(direction(inner, 0.5) - direction(inner, -0.5)));
  return samples;
}

RimSide rim_side(const EnvImage& out, const Tile& texels) {
  if (out.layout->info().domain != Domain::disc) return RimSide::inside;
  const Image& pixels = out.faces[static_cast<std::size_t>(texels.face)];
  // Of their sides, from the disc's middle.
  const auto bounds = [&](int first, int count, int n) {
    const double a = u_from_texel(first - 0.5, n, out.placement) - 0.5;
    const double b = u_from_texel(first + count - 0.5, n, out.placement) - 0.5;
    return std::pair{std::max({a, -b, 0.0}), std::max(-a, b)};
  };
  const auto [near_u, far_u] = bounds(texels.x0, texels.width, pixels.width());
  const auto [near_v, far_v] = bounds(texels.y0, texels.height, pixels.height());
  if (far_u * far_u + far_v * far_v <= 0.25) return RimSide::inside;
  return near_u * near_u + near_v * near_v > 0.25 ? RimSide::outside : RimSide::cut;
}

}  // namespace envconv
