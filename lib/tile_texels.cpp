// SPDX-License-Identifier: Apache-2.0
// Tiles whose texels are sampled each for itself, and highlights: see resample.cpp.
#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <span>

#include "assertion.h"
#include "solid_angle.h"
#include "tile_sampler.h"

namespace envconv {
namespace {

[[maybe_unused]] bool is_no_weight(float weight) { return !(weight >= 0); }

// As it is computed for rows of samples: a texel's total is the sum of just these.
float sample_weight(const Quadrature& qu, const Quadrature& qv, int k, int m, float gx, float gy) {
  const auto i = static_cast<std::size_t>(k), j = static_cast<std::size_t>(m);
  const float ox = static_cast<float>(qu.offset[i]), oy = static_cast<float>(qv.offset[j]);
  return static_cast<float>(qu.weight[i] * qv.weight[j]) * std::max(0.0f, 1.0f + gx * ox + gy * oy);
}

// The samples of one texel, in the workspace's batches: read(n) is called when one is full, and by flush().
template <class Read>
class TexelSamples {
 public:
  TexelSamples(Workspace& w, const Read& read) : w_(w), read_(read) {}
  void add(double u, double v, float weight) {
    w_.u[count_] = static_cast<float>(u), w_.v[count_] = static_cast<float>(v), w_.weight[count_] = weight;
    total_ += static_cast<double>(weight);
    if (++count_ == most_samples) flush();
  }
  void flush() {
    if (count_ > 0) read_(count_);
    count_ = 0;
  }
  double total() const { return total_; }  // of the weights

 private:
  Workspace& w_;
  const Read& read_;
  double total_ = 0;
  int count_ = 0;
};

}  // namespace

// Calls visit(n) for every batch of samples of texels [run.begin, run.end) in row j of the tile, taken in turn, with
// the workspace's windows, face and weight filled in.  workspace.total holds each texel's sum of weights from the
// start. map: the tile's, or nothing.
template <class Visit>
void TileSampler::sample_row(Kernel kernel, const Tile& tile, const TilePlan& plan, const Quadrature& qu,
                             const Quadrature& qv, const TileMap* map, int j, Run run, Workspace& w,
                             const Visit& visit) const {
  const Image& face = out_.faces[static_cast<std::size_t>(tile.face)];
  const int n = run.end - run.begin, x0 = tile.x0 + run.begin;
  alignas(64) float slopes_x[largest_tile], slopes_y[largest_tile];  // relative change of the density per texel
  if (plan.creased)
    creased_slopes(out_, tile, j, run.begin, run.end, slopes_x, slopes_y);
  else
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
  // Nodes in turn, as many texels' rows of them at once as keep a batch's windows in the nearest cache.
  constexpr int batch = 256;
  static_assert(batch >= largest_tile && batch <= most_samples);
  const int nodes = qu.count() * qv.count(), per_call = std::min(nodes, batch / n);
  if (map) std::fill_n(w.face, per_call * n, static_cast<float>(map->face()));
  for (int first_node = 0; first_node < nodes; first_node += per_call) {
    const int end_node = std::min(first_node + per_call, nodes), count = (end_node - first_node) * n;
    for (int node = first_node, s = 0; node < end_node; ++node, s += n) {
      const int k = node % qu.count(), m = node / qu.count();
      const double offset_x = qu.offset[static_cast<std::size_t>(k)], offset_y = qv.offset[static_cast<std::size_t>(m)];
      const double q = qu.weight[static_cast<std::size_t>(k)] * qv.weight[static_cast<std::size_t>(m)];
      const float ox = static_cast<float>(offset_x), oy = static_cast<float>(offset_y), qf = static_cast<float>(q);
      float* __restrict us = w.u + s;
      float* __restrict ws = w.weight + s;
      for (int i = 0; i < n; ++i) ws[i] = qf * std::max(0.0f, 1.0f + gx[i] * ox + gy[i] * oy);
      if (map) {
        make_windows_along(map->row(tile_variable(j + 0.5 + offset_y, tile.height)), kernel,
                           static_cast<float>(tile_variable(run.begin + 0.5 + offset_x, tile.width)),
                           4.0f / static_cast<float>(tile.width), s, n, w.weight, w.windows);
        continue;
      }
      // u is affine in the texel's index.
      const double first = u_from_texel(x0 + offset_x, face.width(), out_.placement);
      const double step = texel_extent(face.width(), out_.placement);
      for (int i = 0; i < n; ++i) us[i] = static_cast<float>(first + i * step);
      std::fill_n(w.v + s, n, static_cast<float>(u_from_texel(tile.y0 + j + offset_y, face.height(), out_.placement)));
      for (int i = 0; any_cut && i < n; ++i) {
        if (!cut[i]) continue;
        double a, b;
        centred(i, k, offset_y, a, b);
        const double r = std::sqrt(a * a + b * b);
        if (r <= 1) continue;
        if (!outside[i]) ws[i] = 0;
        us[i] = static_cast<float>(0.5 + 0.5 * a / r * (1 - 1e-6));
        w.v[s + i] = static_cast<float>(0.5 + 0.5 * b / r * (1 - 1e-6));
      }
    }
    if (!map) find_batch(kernel, tile, w, count);
    visit(count);
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
  const auto read = [&](int count) {
    find_batch(filter_.kernel, tile, w, count);
    visit(count);
  };
  TexelSamples batch(w, read);
  // A texel's place on the disc, or the rim's nearest to it.
  const auto place = [&](double dx, double dy, float weight) {
    const double a = u + extent * dx - 0.5, b = v + extent * dy - 0.5, r = 2 * std::sqrt(a * a + b * b);
    const double scale = r < 1 ? 1 : (1 - 1e-6) / r;
    batch.add(0.5 + scale * a, 0.5 + scale * b, weight);
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
        const float density = std::max(0.0f, 1 + gx[i] * static_cast<float>(dx) + gy[i] * static_cast<float>(dy));
        place(dx, dy, static_cast<float>(node.weight * length * aside.weight[m]) * density);
      }
    }
  }
  batch.flush();
  w.total[i] = static_cast<float>(batch.total());
  if (batch.total() > 0) return;
  place(0, 0, 1);
  batch.flush();
  w.total[i] = 1;
}

// The same for texel i of row j, on a crease, in the eight triangles of its diagonals and axes: those of the layouts
// that have creases run along these.
template <class Visit>
void TileSampler::sample_creased_texel(const Tile& tile, const TilePlan& plan, int i, int j, Workspace& w,
                                       const Visit& visit) const {
  const Image& face = out_.faces[static_cast<std::size_t>(tile.face)];
  const double u = u_from_texel(tile.x0 + i, face.width(), out_.placement),
               v = u_from_texel(tile.y0 + j, face.height(), out_.placement);
  const double extent_u = texel_extent(face.width(), out_.placement),
               extent_v = texel_extent(face.height(), out_.placement);
  // At the middles of the texel's edges and at its corners, relative to that at its centre: linear between them.
  double density[3][3];
  const auto density_at = [&](int x, int y) {
    return out_.layout->density(tile.face, u + 0.5 * extent_u * x, v + 0.5 * extent_v * y);
  };
  const double centre = plan.creased ? density_at(0, 0) : 1;
  for (int y = 0; y < 3; ++y)
    for (int x = 0; x < 3; ++x) {
      const double relative = plan.creased ? density_at(x - 1, y - 1) / centre : 1;
      density[y][x] = relative > 0 && std::isfinite(relative) ? relative : 1;
    }
  // A triangle's side is half of a texel's: two nodes see a wave of two texels there to -57 dB, and of four to -81.
  const int asked = options_.samples, needed = (std::max(plan.ku, plan.kv) + 1) / 2;
  const Quadrature& nodes = tables_.nodes(std::max({2, needed, asked > 0 ? asked + 1 : 0}));
  const auto read = [&](int count) {
    find_batch(filter_.kernel, tile, w, count);
    visit(count);
  };
  TexelSamples batch(w, read);
  const auto add = [&](double x, double y, double weight) {
    batch.add(u + extent_u * x, v + extent_v * y, static_cast<float>(weight));
  };
  for (const int right : {-1, 1})
    for (const int down : {-1, 1})
      for (std::size_t k = 0; k < nodes.offset.size(); ++k) {
        const double out = nodes.offset[k] + 0.5;  // from the centre, 0, to an edge, 1
        for (std::size_t m = 0; m < nodes.offset.size(); ++m) {
          const double aside = nodes.offset[m] + 0.5;  // from the middle of the edge to its corner
          const double weight = out * nodes.weight[k] * nodes.weight[m];
          const double inner = 1 - out + out * aside * density[1 + down][1 + right], middle = out * (1 - aside);
          add(0.5 * right * out, 0.5 * down * out * aside, weight * (inner + middle * density[1][1 + right]));
          add(0.5 * right * out * aside, 0.5 * down * out, weight * (inner + middle * density[1 + down][1]));
        }
      }
  batch.flush();
  w.total[i] = static_cast<float>(batch.total());
}

// Samples every texel for itself, or only some, with positive weights.  on_crease: these are.
void TileSampler::texel_pass(Workspace& w, const Tile& tile, const TilePlan& tile_plan, const TexelMask* only,
                             bool on_crease, TexelMask& met) {
  // At a disc's rim texels need very different numbers of samples, and few along it.
  enum class Sampled { not_at_all, once, by_rows, from_rim, in_triangles };
  const bool as_needed = options_.samples == 0 || (options_.samples > 1 && is_prefiltered(filter_.kernel));
  const bool rim = !tile_plan.inside && as_needed && filter_.window == 1.0;
  const auto sampled = [&](int i, int j) {
    if (only && !only->holds(i, j)) return Sampled::not_at_all;
    if (on_crease) return Sampled::in_triangles;
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
      const bool alone = way == Sampled::from_rim || way == Sampled::in_triangles;
      while (!alone && run.end < tile.width && sampled(run.end, j) == way) ++run.end;
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
      else if (way == Sampled::in_triangles)
        sample_creased_texel(tile, tile_plan, run.begin, j, w, add);
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
