// SPDX-License-Identifier: Apache-2.0
#include "tile_sampler.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>
#include <span>

#include "assertion.h"
#include "solid_angle.h"

namespace envconv {
namespace {

constexpr int most_ring = most_grid_steps + 6;  // rows of samples that a texel takes

// visit(s) for every sample that reads an excess.  Neighbours mostly share a block.
template <class Visit>
void for_each_near_highlight(const Source& source, const Workspace& w, int n, const Visit& visit) {
  constexpr int side = Highlights::side;
  int block_x = -1, block_y = -1;
  float face = -1;
  const BlockTexels* mask = nullptr;
  for (int s = 0; s < n; ++s) {
    const Place p = place_of(w.windows, s);
    if (p.x / side != block_x || p.y / side != block_y || w.face[s] != face) {
      block_x = p.x / side, block_y = p.y / side, face = w.face[s];
      mask = source.highlights().mask_at(source.faces()[static_cast<std::size_t>(face)], p.x, p.y);
    }
    if (mask && (mask->rows[p.y % side] >> (p.x % side) & 1)) visit(s);
  }
}

// Whether any sample's window may hold an excess.
bool touches_highlight(const Source& source, const Workspace& w, int n) {
  const Highlights& highlights = source.highlights();
  if (!highlights.any()) return false;
  for (int s = 0; s < n; ++s)
    if (highlights.touch(source.faces()[static_cast<std::size_t>(w.face[s])], w.windows.x[s], w.windows.y[s]))
      return true;
  return false;
}

// Where the rows of samples are going.
struct Course {
  float face = -1;
  int x = 0, y = 0;

  // Floats from a window's first to the middle of the one four rows of samples later, as far as a sample's way from the
  // row before tells; once for each row.
  std::ptrdiff_t ahead(const Workspace& w, int sample, int channels) {
    constexpr int rows = 4, middle = taps(Kernel::drooping) / 2;
    const int step_x = w.windows.x[sample] - x, step_y = w.windows.y[sample] - y;
    const bool known = w.face[sample] == face;
    face = w.face[sample], x = w.windows.x[sample], y = w.windows.y[sample];
    return known ? (middle + rows * step_y) * w.windows.pitch[sample] + (middle + rows * step_x) * channels : 0;
  }
};

// What a tile sees, and the samples beyond it that a grid takes.
SourceView view_with_neighbours(const TilePlan& plan, const Tile& tile) {
  SourceView view = plan.view;
  const double grow = grid_reach / std::min(tile.width, tile.height);
  const double wide = view.right - view.left, high = view.bottom - view.top;
  view.left -= grow * wide, view.right += grow * wide, view.top -= grow * high, view.bottom += grow * high;
  return view;
}

void combine_densities(const GridQuadrature& q, int n, const float* in, float* out) {
  for (int i = 0; i < n; ++i) {
    const auto phase = static_cast<std::size_t>(i % q.texels);
    const float* from = in + i / q.texels * q.steps + q.first[phase];
    const float* weight = q.weight.data() + phase * static_cast<std::size_t>(q.taps);
    out[i] = 0;
    for (int k = 0; k < q.taps; ++k) out[i] += weight[k] * from[k];
  }
}

// Whether grids for the tile's quarters have fewer samples than one for all of it, by more than their plans cost.
bool quarters_take_less(const TilePlan& plan, const Tile& tile) {
  constexpr double beyond = 6, plans = 3000;  // samples beyond a row, and what four plans take the time of
  const auto samples = [](double need_u, double need_v, double width, double height) {
    return (std::max(need_u, 1.0) * width + beyond) * (std::max(need_v, 1.0) * height + beyond);
  };
  double parts = plans;
  for (const auto& row : plan.quarter)
    for (const TilePlan::Need& need : row) parts += samples(need.u, need.v, 0.5 * tile.width, 0.5 * tile.height);
  return parts < samples(plan.need_u, plan.need_v, tile.width, tile.height);
}

[[maybe_unused]] bool is_no_weight(float weight) { return !(weight >= 0); }

// Points beyond a disc's rim to just inside of it.
void take_to_rim(int n, float* __restrict u, float* __restrict v) {
  for (int i = 0; i < n; ++i) {
    const float a = u[i] - 0.5f, b = v[i] - 0.5f, scale = 0.5f * (1 - 1e-6f) / std::sqrt(a * a + b * b);
    u[i] = 0.5f + scale * a, v[i] = 0.5f + scale * b;
  }
}

// As it is computed for rows of samples: a texel's total is the sum of just these.
float sample_weight(const Quadrature& qu, const Quadrature& qv, int k, int m, float gx, float gy) {
  const auto i = static_cast<std::size_t>(k), j = static_cast<std::size_t>(m);
  const float ox = static_cast<float>(qu.offset[i]), oy = static_cast<float>(qv.offset[j]);
  return static_cast<float>(qu.weight[i] * qv.weight[j]) * std::max(0.0f, 1.0f + gx * ox + gy * oy);
}

}  // namespace

TileSampler::TileSampler(const EnvImage& image, Source& source, int first_channel, EnvImage& out,
                         const Mat3& source_from_out, const Filter& filter, const ResampleOptions& options,
                         GridTables& tables)
    : image_(image),
      source_(source),
      first_channel_(first_channel),
      channels_(std::min(4, image.channels.count() - first_channel)),
      out_(out),
      source_from_out_(source_from_out),
      filter_(filter),
      options_(options),
      tables_(tables) {
  for (std::size_t i = 0; i < 9; ++i) matrix_[i] = static_cast<float>(source_from_out.m[i]);
  // A limited filter does not go below black where the source never does.
  for (int c = 0; c < 4; ++c)
    lowest_[c] = filter.limited ? std::min(source.lowest()[c], 0.0f) : -std::numeric_limits<float>::infinity();
}

// The samples' directions to windows that point at texels.
void TileSampler::find_windows(Kernel kernel, Workspace& w, int count) const {
  const std::size_t padded = (static_cast<std::size_t>(count) + 15) / 16 * 16;
  if (!(source_from_out_ == Mat3{})) rotate_directions(matrix_, padded, w.x, w.y, w.z);
  source_.layout().locations(padded, w.x, w.y, w.z, w.face, w.su, w.sv);
  make_windows(source_.maps(), kernel, count, w.face, w.su, w.sv, w.weight, w.windows);
}

void TileSampler::point(Kernel kernel, Workspace& w, int count) const {
  if (kernel == Kernel::band_limited)
    w.blocks->point(count, w.face, w.windows);
  else
    source_.point(kernel, count, w.face, w.windows);
}

// Brings what the windows point at into memory, where that is not done by reading it.
void TileSampler::gather(Kernel kernel, Workspace& w, int count) const {
  const Image& image = image_.faces.front();
  if (image.scratch() && kernel != Kernel::band_limited)
    w.scattered.prepare(image, source_.channels(), kernel, count, w.windows);
}

// out[count][4] = what the samples' windows hold.
void TileSampler::read(Kernel kernel, Workspace& w, int count, float* out) const {
  point(kernel, w, count);
  gather(kernel, w, count);
  sum_windows(kernel, source_.channels(), count, w.windows, w.weight, out);
}

// One sample in each texel, which needs no weights: several rows at once.  Beyond a disc's rim, where that is nearest.
void TileSampler::point_pass(Workspace& w, const Tile& tile, const TilePlan& tile_plan, TexelMask& met) {
  constexpr int batch = 256;
  static_assert(batch >= largest_tile);
  Image& face = out_.faces[static_cast<std::size_t>(tile.face)];
  const int n = tile.width, rows = batch / n;
  const double first = u_from_texel(tile.x0, face.width(), out_.placement);
  const double step = texel_extent(face.width(), out_.placement);
  const bool outside = rim_side(out_, tile) == RimSide::outside;
  const std::optional<TileMap> map = this->map(tile, tile_plan, 0);
  if (map) std::fill_n(w.face, batch, static_cast<float>(map->face()));
  const auto fill_u = [&] {
    for (int row = 0; row < rows; ++row)
      for (int i = 0; i < n; ++i) w.u[row * n + i] = static_cast<float>(first + i * step);
  };
  fill_u();
  const int stored = image_.channels.count();
  std::fill_n(w.weight, batch, 1.0f);
  for (int j = 0; j < tile.height; j += rows) {
    const int count = std::min(rows, tile.height - j) * n;
    const auto padded = (static_cast<std::size_t>(count) + 15) / 16 * 16;
    // Beyond the rim, where nothing is integrated, the source is read as it is, away from highlights.
    Kernel kernel = outside && taps(filter_.kernel) > taps(Kernel::bilinear) ? Kernel::bilinear : filter_.kernel;
    if (map) {
      const float first_s = static_cast<float>(tile_variable(0.5, n)), step_s = 4.0f / static_cast<float>(n);
      for (int s = 0; s < count; s += n)
        make_windows_along(map->row(tile_variable(j + s / n + 0.5, tile.height)), kernel, first_s, step_s, s, n,
                           w.weight, w.windows);
    } else {
      for (int s = 0, y = tile.y0 + j; s < count; s += n, ++y)
        std::fill_n(w.v + s, n, static_cast<float>(u_from_texel(y, face.height(), out_.placement)));
      if (outside) {
        fill_u();
        take_to_rim(count, w.u, w.v);
      }
      std::fill(w.u + count, w.u + padded, w.u[0]), std::fill(w.v + count, w.v + padded, w.v[0]);
      out_.layout->directions(tile.face, padded, w.u, w.v, w.x, w.y, w.z);
      find_windows(kernel, w, count);
    }
    if (kernel != filter_.kernel && touches_highlight(source_, w, count)) {
      kernel = filter_.kernel;
      make_windows(source_.maps(), kernel, count, w.face, w.su, w.sv, w.weight, w.windows);
    }
    if (source_.highlights().any())
      for_each_near_highlight(source_, w, count,
                              [&](int s) { met.add(s % n, j + s / n, s % n + 1, j + s / n + 1, tile); });
    read(kernel, w, count, w.samples);
    for (int s = 0, y = tile.y0 + j; s < count; s += n, ++y)
      store_texels(n, w.samples + 4 * s, {}, lowest_, channels_, stored, face.at(tile.x0, y) + first_channel_);
  }
}

// Samples the tile on a grid that its texels share.  False, with nothing to be kept, when Kernel::drooping, which
// reads the source as it is, met a highlight: the base that is left of these is in the prefiltered blocks.
bool TileSampler::grid_pass(Workspace& w, const Tile& tile, const TilePlan& plan, bool creased, Kernel kernel,
                            const GridQuadrature& qu, const GridQuadrature& qv, TexelMask& met) {
  Image& face = out_.faces[static_cast<std::size_t>(tile.face)];
  const Highlights& highlights = source_.highlights();
  const bool even = out_.layout->info().equal_area;
  const bool apart = source_.channels() == 4;  // three channels leave a float for the density
  const int nu = qu.samples(tile.width), nv = qv.samples(tile.height), ring = qv.taps;
  const auto padded = (static_cast<std::size_t>(nu) + 15) / 16 * 16;
  const double step_u = static_cast<double>(qu.texels) / qu.steps, first_u = (0.5 - qu.before()) * step_u;
  const double step_v = static_cast<double>(qv.texels) / qv.steps;
  const auto room = [](std::vector<float>& v, std::size_t n) {
    if (v.size() < n) v.resize(n);
  };
  room(w.samples_rows, static_cast<std::size_t>(ring) * padded * 4), room(w.combined, padded * 4);
  room(w.density_rows, static_cast<std::size_t>(ring) * padded), room(w.combined_density, padded);
  const double u = u_from_texel(tile.x0 - 0.5 + first_u, face.width(), out_.placement);
  const double du = texel_extent(face.width(), out_.placement) * step_u;
  for (int i = 0; i < nu; ++i) w.u[i] = static_cast<float>(u + i * du);
  std::fill(w.u + nu, w.u + padded, w.u[0]);
  std::fill_n(w.weight, padded, 1.0f);
  w.weight4.clear();
  for (const float weight : qu.weight) w.weight4.insert(w.weight4.end(), 4, weight);
  const int stored = image_.channels.count();
  int texel = 0;  // row of the tile that is next
  Course course;
  const std::optional<TileMap> map = creased ? std::nullopt : this->map(tile, plan, grid_reach);
  if (map) std::fill_n(w.face, padded, static_cast<float>(map->face()));
  const TilePolynomial density(plan.density);
  const float first_s = static_cast<float>(tile_variable(first_u, tile.width));
  const float step_s = static_cast<float>(4 * step_u / tile.width);
  for (int row = 0; row < nv; ++row) {
    const double y = (row - qv.before() + 0.5) * step_v;
    const double t = tile_variable(y, tile.height);
    if (!even && creased) {
      creased_densities(plan, tile, first_u, step_u, y, nu, w.weight);
    } else if (!even) {
      float powers[5];
      density.row(t, powers);
      evaluate_quartic(powers, first_s, step_s, nu, w.weight);
    }
    if (map) {
      make_windows_along(map->row(t), kernel, first_s, step_s, 0, nu, w.weight, w.windows);
    } else {
      const float v = static_cast<float>(u_from_texel(tile.y0 - 0.5 + y, face.height(), out_.placement));
      std::fill_n(w.v, padded, v);
      out_.layout->directions(tile.face, padded, w.u, w.v, w.x, w.y, w.z);
      find_windows(kernel, w, nu);
    }
    if (highlights.any()) {
      if (kernel == Kernel::drooping && touches_highlight(source_, w, nu)) return false;
      const int j = static_cast<int>(std::floor(y));
      for_each_near_highlight(source_, w, nu, [&](int s) {
        const int i = static_cast<int>(std::floor(first_u + s * step_u + 0.5));
        // With two texels around: between samples there are others.
        met.add(i - 2, j - 2, i + 3, j + 3, tile);
      });
    }
    point(kernel, w, nu);
    const std::ptrdiff_t ahead = course.ahead(w, nu / 2, source_.channels());
    gather(kernel, w, nu);
    const auto slot = static_cast<std::size_t>(row % ring);
    sum_windows(kernel, source_.channels(), nu, w.windows, w.weight, w.samples_rows.data() + slot * padded * 4, ahead);
    if (apart) std::copy_n(w.weight, padded, w.density_rows.data() + slot * padded);
    for (; texel < tile.height; ++texel) {
      const auto phase = static_cast<std::size_t>(texel % qv.texels);
      const int top = texel / qv.texels * qv.steps + qv.first[phase] + qv.before();
      if (top + ring > row + 1) break;
      const float *rows[most_ring], *density[most_ring];
      for (int k = 0; k < ring; ++k) {
        const auto at = static_cast<std::size_t>((top + k) % ring);
        rows[k] = w.samples_rows.data() + at * padded * 4;
        density[k] = w.density_rows.data() + at * padded;
      }
      const float* weight = qv.weight.data() + phase * static_cast<std::size_t>(ring);
      combine_rows(4 * nu, ring, weight, rows, w.combined.data());
      const float* into = w.combined.data() + 4 * static_cast<std::ptrdiff_t>(qu.before());
      combine_samples(tile.width, qu.texels, qu.steps, qu.taps, qu.first.data(), w.weight4.data(), into, w.row);
      if (apart) {
        combine_rows(nu, ring, weight, density, w.combined_density.data());
        combine_densities(qu, tile.width, w.combined_density.data() + qu.before(), w.total);
      }
      store_texels(tile.width, w.row, apart ? Totals{w.total, 1} : Totals{w.row + 3, 4}, lowest_, channels_, stored,
                   face.at(tile.x0, tile.y0 + texel) + first_channel_);
    }
  }
  ENVCONV_ASSERT(texel == tile.height);
  return true;
}

// w.row over w.total to texels of row j of the tile.
void TileSampler::store_run(Workspace& w, const Tile& tile, int j, Run run) {
  const int stored = image_.channels.count();
  store_texels(run.end - run.begin, w.row + 4 * run.begin, {w.total + run.begin, 1}, lowest_, channels_, stored,
               out_.faces[static_cast<std::size_t>(tile.face)].at(tile.x0 + run.begin, tile.y0 + j) + first_channel_);
}

// Calls visit(n) for every batch of samples of texels [run.begin, run.end) in row j of the tile, taken in turn, with
// the workspace's face, su, sv and weight filled in.  workspace.total holds each texel's sum of weights from the start.
template <class Visit>
void TileSampler::sample_row(Kernel kernel, const Tile& tile, const TilePlan& plan, const Quadrature& qu,
                             const Quadrature& qv, const TileMap* map, int j, Run run, Workspace& w,
                             const Visit& visit) const {
  const Image& face = out_.faces[static_cast<std::size_t>(tile.face)];
  const int n = run.end - run.begin, x0 = tile.x0 + run.begin;
  alignas(64) float slopes_x[largest_tile], slopes_y[largest_tile];  // relative change of the density per texel
  density_slopes(plan, tile, j, run.begin, run.end, slopes_x, slopes_y);
  float *gx = slopes_x + run.begin, *gy = slopes_y + run.begin, *total = w.total + run.begin;
  bool cut[largest_tile], outside[largest_tile], any_cut = false;
  for (int i = 0; i < n; ++i) {
    outside[i] = false;
    total[i] = 1.0f;
    cut[i] = rim_side(out_, {tile.face, x0 + i, tile.y0 + j, 1, 1}) != RimSide::inside;
    any_cut = any_cut || cut[i];
    if (cut[i] || static_cast<double>(std::abs(gx[i]) + std::abs(gy[i])) * filter_.window <= 2.0) continue;
    double sum = 0;  // some weights are cut off at 0
    for (int m = 0; m < qv.count(); ++m)
      for (int k = 0; k < qu.count(); ++k) sum += static_cast<double>(sample_weight(qu, qv, k, m, gx[i], gy[i]));
    total[i] = static_cast<float>(sum);
  }
  const auto centred = [&](int i, int k, double offset_y, double& a, double& b) {
    a = 2 * u_from_texel(x0 + i + qu.offset[static_cast<std::size_t>(k)], face.width(), out_.placement) - 1;
    b = 2 * u_from_texel(tile.y0 + j + offset_y, face.height(), out_.placement) - 1;
  };
  if (any_cut) {
    // Only samples inside the disc count; a texel without any takes the nearest rim's radiance.
    for (int i = 0; i < n; ++i) {
      if (!cut[i]) continue;
      double sum = 0;
      for (int m = 0; m < qv.count(); ++m)
        for (int k = 0; k < qu.count(); ++k) {
          double a, b;
          centred(i, k, qv.offset[static_cast<std::size_t>(m)], a, b);
          if (a * a + b * b <= 1) sum += static_cast<double>(sample_weight(qu, qv, k, m, gx[i], gy[i]));
        }
      outside[i] = !(sum > 0);
      total[i] = outside[i] ? 1.0f : static_cast<float>(sum);
      if (outside[i]) gx[i] = gy[i] = 0;
    }
  }
  const int per_call = std::max(1, most_samples / n);
  if (map) std::fill_n(w.face, std::min(per_call, qu.count()) * n, static_cast<float>(map->face()));
  for (int m = 0; m < qv.count(); ++m) {
    const double offset_y = qv.offset[static_cast<std::size_t>(m)];
    const float v = static_cast<float>(u_from_texel(tile.y0 + j + offset_y, face.height(), out_.placement));
    RowMap along;
    if (map) along = map->row(tile_variable(j + 0.5 + offset_y, tile.height));
    for (int k0 = 0; k0 < qu.count(); k0 += per_call) {
      const int columns = std::min(per_call, qu.count() - k0);
      const int count = columns * n;
      int s = 0;
      for (int k = k0; k < k0 + columns; ++k) {
        const double offset_x = qu.offset[static_cast<std::size_t>(k)];
        const double q = qu.weight[static_cast<std::size_t>(k)] * qv.weight[static_cast<std::size_t>(m)];
        // u is affine in the texel's index.
        const double first = u_from_texel(x0 + offset_x, face.width(), out_.placement);
        const double step = texel_extent(face.width(), out_.placement);
        const float ox = static_cast<float>(offset_x), oy = static_cast<float>(offset_y), qf = static_cast<float>(q);
        float* __restrict us = w.u + s;
        float* __restrict ws = w.weight + s;
        for (int i = 0; i < n; ++i) ws[i] = qf * std::max(0.0f, 1.0f + gx[i] * ox + gy[i] * oy);
        if (map) {
          make_windows_along(along, kernel, static_cast<float>(tile_variable(run.begin + 0.5 + offset_x, tile.width)),
                             4.0f / static_cast<float>(tile.width), s, n, w.weight, w.windows);
          s += n;
          continue;
        }
        for (int i = 0; i < n; ++i) us[i] = static_cast<float>(first + i * step);
        std::fill_n(w.v + s, n, v);
        s += n;
        if (!any_cut) continue;
        for (int i = 0; i < n; ++i) {
          if (!cut[i]) continue;
          double a, b;
          centred(i, k, offset_y, a, b);
          const double r = std::sqrt(a * a + b * b);
          if (r <= 1) continue;
          const int at = s - n + i;
          if (!outside[i]) w.weight[at] = 0;
          w.u[at] = static_cast<float>(0.5 + 0.5 * a / r * (1 - 1e-6));
          w.v[at] = static_cast<float>(0.5 + 0.5 * b / r * (1 - 1e-6));
        }
      }
      if (map) {
        visit(count);
        continue;
      }
      find_batch(kernel, tile, w, count);
      visit(count);
    }
  }
}

// The windows of a batch of samples at w.u and w.v, which has room for a vector more.
void TileSampler::find_batch(Kernel kernel, const Tile& tile, Workspace& w, int count) const {
  for (int p = count; p % 16; ++p) w.u[p] = w.u[0], w.v[p] = w.v[0], w.weight[p] = 0;
  const std::size_t padded = (static_cast<std::size_t>(count) + 15) / 16 * 16;
  ENVCONV_ASSERT(padded <= std::size(w.u) && std::ranges::none_of(std::span(w.weight, padded), is_no_weight));
  out_.layout->directions(tile.face, padded, w.u, w.v, w.x, w.y, w.z);
  find_windows(kernel, w, count);
}

// The same for texel i of row j, at a disc's rim.  A texel without area of its own takes the nearest rim's radiance.
template <class Visit>
void TileSampler::sample_rim_texel(const Tile& tile, const TilePlan& plan, int i, int j, Workspace& w,
                                   const Visit& visit) const {
  const Image& face = out_.faces[static_cast<std::size_t>(tile.face)];
  const int x = tile.x0 + i, y = tile.y0 + j;
  const double u = u_from_texel(x, face.width(), out_.placement), v = u_from_texel(y, face.height(), out_.placement);
  const double extent = texel_extent(face.width(), out_.placement);
  float gx[largest_tile], gy[largest_tile];
  density_slopes(plan, tile, j, i, i + 1, gx, gy);
  const RimSamples samples = rim_samples(image_, out_, source_from_out_, filter_, tile.face, x, y);
  double total = 0;
  int count = 0;
  const auto flush = [&] {
    if (count == 0) return;
    find_batch(filter_.kernel, tile, w, count);
    visit(count);
    count = 0;
  };
  const auto add = [&](double dx, double dy, double weight) {
    const double a = u + extent * dx - 0.5, b = v + extent * dy - 0.5, r = 2 * std::sqrt(a * a + b * b);
    const double scale = r < 1 ? 1 : (1 - 1e-6) / r;
    const float density = std::max(0.0f, 1 + gx[i] * static_cast<float>(dx) + gy[i] * static_cast<float>(dy));
    w.u[count] = static_cast<float>(0.5 + scale * a), w.v[count] = static_cast<float>(0.5 + scale * b);
    w.weight[count] = static_cast<float>(weight) * density;
    total += static_cast<double>(w.weight[count]);
    if (++count == most_samples) flush();
  };
  for (int piece = 0; piece < samples.texel.pieces(); ++piece) {
    const Quadrature &out = tables_.nodes(samples.outwards[piece]), &aside = tables_.nodes(samples.aside);
    for (std::size_t k = 0; k < out.offset.size(); ++k) {
      const RimTexel::Node node = samples.texel.node(piece, out.offset[k], out.weight[k]);
      const RimTexel::Chord chord = samples.texel.chord(node.outwards);
      const double length = chord.end - chord.begin;
      if (!(length > 0)) continue;
      for (std::size_t m = 0; m < aside.offset.size(); ++m) {
        const auto [dx, dy] =
            samples.texel.place(node.outwards, 0.5 * (chord.begin + chord.end) + length * aside.offset[m]);
        add(dx, dy, node.weight * length * aside.weight[m]);
      }
    }
  }
  flush();
  if (!(total > 0)) {
    add(0, 0, 1);
    w.weight[0] = 1, total = 1;
    flush();
  }
  w.total[i] = static_cast<float>(total);
}

void TileSampler::first_pass(Workspace& w, const Tile& tile, std::unique_ptr<TileHighlights>& lights) {
  const TilePlan tile_plan = plan(tile);
  if (w.blocks) w.blocks->next_tile(view_with_neighbours(tile_plan, tile));
  TexelMask met;
  sample(w, tile, tile_plan, met);
  if (lights) met.add(lights->slivers);
  if (met.any) {
    if (!lights) lights = std::make_unique<TileHighlights>();
    lights->met = met;
  }
  if (lights && !receive(w, tile, *lights)) lights.reset();
}

void TileSampler::sample(Workspace& w, const Tile& tile, const TilePlan& tile_plan, TexelMask& met) {
  if (rim_side(out_, tile) == RimSide::outside) return point_pass(w, tile, tile_plan, met);
  constexpr int least_part = 8;  // texels a side; a smaller grid takes more samples than texels do for themselves
  const bool grid = filter_.kernel == Kernel::band_limited && tile_plan.smooth;
  // Only the parts that a disc's rim crosses go without a grid, and only those that need it take many samples.
  if (tile.width > least_part && tile.height > least_part &&
      ((!grid && !tile_plan.inside) || (grid && options_.samples == 0 && quarters_take_less(tile_plan, tile)))) {
    const int left = tile.width / 2, top = tile.height / 2;
    for (const int x : {0, left})
      for (const int y : {0, top}) {
        const Tile part{tile.face, tile.x0 + x, tile.y0 + y, x ? tile.width - left : left, y ? tile.height - top : top};
        TexelMask part_met;
        sample(w, part, plan(part), part_met);
        for (int j = 0; j < part.height && part_met.any; ++j) met.rows[y + j] |= part_met.rows[j] << x;
        met.any = met.any || part_met.any;
      }
    return;
  }
  const TexelMask creased = grid ? find_creases(out_, tile) : TexelMask{};
  // A crease has waves of two kinds, one on each side.
  const bool wide = tile_plan.least >= direct_ratio && !creased.any;
  const bool on_it = grid && ((wide && on_grid(w, tile, tile_plan, false, Kernel::drooping, met)) ||
                              on_grid(w, tile, tile_plan, creased.any, Kernel::band_limited, met));
  if (!on_it) {
    if (tile_plan.ku == 1 && tile_plan.kv == 1 && !filter_.limited && tile_plan.inside)
      return point_pass(w, tile, tile_plan, met);
    texel_pass(w, tile, tile_plan, nullptr, met);
  }
  if (!creased.any) return;
  TilePlan dense = tile_plan;
  if (options_.samples == 0) dense.ku *= 2, dense.kv *= 2;  // a quadrature sees a crease late
  texel_pass(w, tile, dense, &creased, met);
}

bool TileSampler::on_grid(Workspace& w, const Tile& tile, const TilePlan& tile_plan, bool creased, Kernel kernel,
                          TexelMask& met) {
  const std::optional<GridQuadrature> u = tables_.grid(tile_plan.need_u, tile_plan.wave_u, kernel, tile.width);
  const std::optional<GridQuadrature> v = tables_.grid(tile_plan.need_v, tile_plan.wave_v, kernel, tile.height);
  return u && v && grid_pass(w, tile, tile_plan, creased, kernel, *u, *v, met);
}

// Samples every texel for itself, or only some, with positive weights.
void TileSampler::texel_pass(Workspace& w, const Tile& tile, const TilePlan& tile_plan, const TexelMask* only,
                             TexelMask& met) {
  // At a disc's rim texels need very different numbers of samples, and few along it.
  enum class Sampled { not_at_all, once, by_rows, from_rim };
  const bool rim = !tile_plan.inside && options_.samples == 0 && filter_.window == 1.0;
  const auto sampled = [&](int i, int j) {
    if (only && !only->holds(i, j)) return Sampled::not_at_all;
    if (!rim) return Sampled::by_rows;
    return rim_side(out_, {tile.face, tile.x0 + i, tile.y0 + j, 1, 1}) == RimSide::outside ? Sampled::once
                                                                                           : Sampled::from_rim;
  };
  std::optional<TileMap> map;
  if (!only) map = this->map(tile, tile_plan, 0.5 * (filter_.window - 1));
  for (int j = 0; j < tile.height; ++j) {
    for (Run run{0, 0}; run.begin < tile.width; run.begin = run.end) {
      const Sampled way = sampled(run.begin, j);
      run.end = run.begin + 1;
      while (way != Sampled::from_rim && run.end < tile.width && sampled(run.end, j) == way) ++run.end;
      if (way == Sampled::not_at_all) continue;
      const int ku = way == Sampled::once ? 1 : tile_plan.ku, kv = way == Sampled::once ? 1 : tile_plan.kv;
      // A texel on a singular point may take millions of samples: batches are added up in double.
      const int n = run.end - run.begin;
      double sum[4 * largest_tile];
      std::fill_n(sum, 4 * n, 0.0);
      const auto add = [&](int count) {
        if (source_.highlights().any())
          for_each_near_highlight(source_, w, count, [&](int s) {
            const int i = run.begin + s % n;
            met.add(i - 1, j - 1, i + 2, j + 2, tile);
          });
        read(filter_.kernel, w, count, w.samples);
        float batch[4 * largest_tile];
        std::fill_n(batch, 4 * n, 0.0f);
        for (int s = 0; s < count; s += n)
          for (int i = 0; i < 4 * n; ++i) batch[i] += w.samples[4 * s + i];
        for (int i = 0; i < 4 * n; ++i) sum[i] += static_cast<double>(batch[i]);
      };
      if (way == Sampled::from_rim)
        sample_rim_texel(tile, tile_plan, run.begin, j, w, add);
      else
        sample_row(filter_.kernel, tile, tile_plan, tables_.nodes(ku), tables_.nodes(kv), map ? &*map : nullptr, j, run,
                   w, add);
      for (int i = 0; i < 4 * n; ++i) w.row[4 * run.begin + i] = static_cast<float>(sum[i]);
      store_run(w, tile, j, run);
    }
  }
}

// Samples the texels that met highlights: visit(j, run, n) for samples of texels `run` of row j, taken in turn.
template <class Visit>
void TileSampler::sample_met(Workspace& w, const Tile& tile, const TileHighlights& lights, const Visit& visit) {
  const TilePlan tile_plan = plan(tile);
  constexpr int many = 256;  // texels, of which some samples' formulas take longer than a map
  int met_texels = 0;
  for (const std::uint64_t row : lights.met.rows) met_texels += std::popcount(row);
  std::optional<TileMap> map;
  if (met_texels >= many) map = this->map(tile, tile_plan, 0.5 * (filter_.window - 1));
  for (int j = 0; j < tile.height; ++j) {
    if (lights.met.rows[j] == 0) continue;
    for (Run run{0, 0}; run.begin < tile.width; run.begin = run.end) {
      const bool met = lights.met.holds(run.begin, j), sliver = lights.slivers.holds(run.begin, j);
      for (run.end = run.begin + 1;
           run.end < tile.width && lights.met.holds(run.end, j) == met && lights.slivers.holds(run.end, j) == sliver;)
        ++run.end;
      if (!met) continue;
      const int least = sliver ? lights.sliver_samples : 1;
      sample_row(Kernel::bilinear, tile, tile_plan, tables_.nodes(std::max(tile_plan.ku, least)),
                 tables_.nodes(std::max(tile_plan.kv, least)), map ? &*map : nullptr, j, run, w,
                 [&](int count) { visit(j, run, count); });
    }
  }
}

// Counts what the texels that met highlights receive of them.  False when that is nothing.
bool TileSampler::receive(Workspace& w, const Tile& tile, const TileHighlights& lights) {
  const Image& face = out_.faces[static_cast<std::size_t>(tile.face)];
  Highlights& highlights = source_.highlights();
  std::vector<double> omega;  // of the texels, once a highlight is met
  HighlightQuad<Highlights::Texel> quad;
  std::uint64_t received[4] = {};  // by its texels, so far
  const auto flush = [&] {
    for (int k = 0; k < 4; ++k) {
      if (quad.texel[k] && received[k] > 0 && quad.texel[k]->lit())
        std::atomic_ref<std::uint64_t>(quad.texel[k]->received).fetch_add(received[k], std::memory_order_relaxed);
      received[k] = 0;
    }
  };
  sample_met(w, tile, lights, [&](int j, Run run, int count) {
    const int n = run.end - run.begin;
    double scale[largest_tile];  // of weights to units of what is received; negative: not known yet
    std::fill_n(scale, n, -1.0);
    for_each_near_highlight(source_, w, count, [&](int s) {
      if (omega.empty()) {
        omega.resize(static_cast<std::size_t>(tile.width) * static_cast<std::size_t>(tile.height));
        texel_solid_angles(*out_.layout, tile.face, {face.width(), face.height()}, out_.placement, tile.x0, tile.y0,
                           tile.width, tile.height, omega.data());
      }
      const SourceFace& f = source_.faces()[static_cast<std::size_t>(w.face[s])];
      const Place p = place_of(w.windows, s);
      const int i = s % n, at = run.begin + i;
      if (!(scale[i] >= 0))
        scale[i] = omega[static_cast<std::size_t>(j * tile.width + at)] /
                   (static_cast<double>(w.total[at]) * Highlights::received_unit);
      const double share = scale[i] * static_cast<double>(w.weight[s]);
      ENVCONV_ASSERT(share >= 0);
      if (!quad.is_at(w.face[s], p)) {
        flush();
        quad.move(highlights, f, w.face[s], p);
      }
      for (int k = 0; k < 4; ++k)
        received[k] +=
            static_cast<std::uint64_t>(share * static_cast<double>(HighlightQuad<Highlights::Texel>::weight(k, p)));
    });
  });
  flush();
  return !omega.empty();
}

// Adds the highlights to the texels that met them.
void TileSampler::second_pass(Workspace& w, const Tile& tile, const TileHighlights& lights) {
  Image& face = out_.faces[static_cast<std::size_t>(tile.face)];
  const Highlights& highlights = source_.highlights();
  HighlightQuad<const Highlights::Texel> quad;
  double sums[largest_tile][4] = {};
  int row = -1;  // that they are of
  const auto store = [&] {
    if (row < 0) return;
    float* to = face.at(tile.x0, tile.y0 + row) + first_channel_;
    for (int i = 0; i < tile.width; ++i, to += image_.channels.count())
      for (int c = 0; c < channels_; ++c) to[c] += static_cast<float>(sums[i][c]), sums[i][c] = 0;
  };
  sample_met(w, tile, lights, [&](int j, Run run, int count) {
    if (j != row) store(), row = j;
    const int n = run.end - run.begin;
    for_each_near_highlight(source_, w, count, [&](int s) {
      const SourceFace& f = source_.faces()[static_cast<std::size_t>(w.face[s])];
      const Place p = place_of(w.windows, s);
      if (!quad.is_at(w.face[s], p)) quad.move(highlights, f, w.face[s], p);
      float value[3] = {};
      for (int k = 0; k < 4; ++k) {
        if (!quad.texel[k]) continue;
        const float weight = w.weight[s] * HighlightQuad<const Highlights::Texel>::weight(k, p);
        for (int c = 0; c < 3; ++c) value[c] += weight * quad.texel[k]->excess[c];
      }
      const int at = run.begin + s % n;
      for (int c = 0; c < 3; ++c) sums[at][c] += static_cast<double>(value[c]) / static_cast<double>(w.total[at]);
    });
  });
  store();
}

}  // namespace envconv
