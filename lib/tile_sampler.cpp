// SPDX-License-Identifier: Apache-2.0
#include "tile_sampler.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "assertion.h"
#include "sum_kernels.h"

namespace envconv {
namespace {

constexpr int most_ring = most_grid_steps + 6;  // rows of samples that a texel takes

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

// Points beyond a disc's rim to just inside of it.
void take_to_rim(int n, float* __restrict u, float* __restrict v) {
  for (int i = 0; i < n; ++i) {
    const float a = u[i] - 0.5f, b = v[i] - 0.5f, scale = 0.5f * (1 - 1e-6f) / std::sqrt(a * a + b * b);
    u[i] = 0.5f + scale * a, v[i] = 0.5f + scale * b;
  }
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
  if (is_prefiltered(kernel))
    w.blocks->point(count, w.face, w.windows);
  else
    source_.point(kernel, count, w.face, w.windows);
}

// Brings what the windows point at into memory, where that is not done by reading it.
void TileSampler::gather(Kernel kernel, Workspace& w, int count) const {
  const Image& image = image_.faces.front();
  if (image.scratch() && !is_prefiltered(kernel))
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
  const bool grid = is_prefiltered(filter_.kernel) && tile_plan.smooth;
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
  const Creases creases = grid ? find_creases(out_, tile) : Creases{};
  const bool creased = creases.near.any;
  // A crease has waves of two kinds, one on each side.
  const bool wide = tile_plan.least >= direct_ratio && !creased;
  const bool on_it = grid && ((wide && on_grid(w, tile, tile_plan, false, Kernel::drooping, met)) ||
                              on_grid(w, tile, tile_plan, creased, filter_.kernel, met));
  // Two nodes see a wave of two texels to -34 dB, three to -67.  One sample, when it is asked for, is one everywhere.
  TilePlan apart = tile_plan;
  if (is_prefiltered(filter_.kernel) && options_.samples != 1)
    apart.ku = std::max(tile_plan.ku, 3), apart.kv = std::max(tile_plan.kv, 3);
  if (!on_it) {
    if (tile_plan.ku == 1 && tile_plan.kv == 1 && !filter_.limited && tile_plan.inside)
      return point_pass(w, tile, tile_plan, met);
    texel_pass(w, tile, apart, nullptr, false, met);
  }
  if (!creased) return;
  apart.creased = !out_.layout->info().equal_area;
  if (options_.samples == 1) return texel_pass(w, tile, apart, &creases.near, false, met);
  const TexelMask beside = creases.near.without(creases.across);
  texel_pass(w, tile, apart, &beside, false, met);
  texel_pass(w, tile, apart, &creases.across, true, met);
}

bool TileSampler::on_grid(Workspace& w, const Tile& tile, const TilePlan& tile_plan, bool creased, Kernel kernel,
                          TexelMask& met) {
  const std::optional<GridQuadrature> u = tables_.grid(tile_plan.need_u, tile_plan.wave_u, kernel, tile.width);
  const std::optional<GridQuadrature> v = tables_.grid(tile_plan.need_v, tile_plan.wave_v, kernel, tile.height);
  return u && v && grid_pass(w, tile, tile_plan, creased, kernel, *u, *v, met);
}

}  // namespace envconv
