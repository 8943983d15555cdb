// SPDX-License-Identifier: Apache-2.0
// Tiles of the output, in parallel.  Each texel's footprint is sampled in the output's own (u, v): ku x kv points, each
// located exactly in the source, so that curved footprints, poles and seams are no special case.
//
// How many samples: the distance between them is at most Filter::spacing source texels, along each axis of the output
// apart.  Where the source's texels are slivers (latlong at its poles) their short side counts as no less than
// half of the long one.
//
// The integral over a footprint is over solid angle.  It is taken in one of two ways.
// - Grid.  Samples lie in equal steps over the tile and two steps beyond it, and every texel takes its own and two of
//   its neighbours' on each side, with the weights of grid_quadrature(): as many samples as without the neighbours, and
//   a far better integral.  A sample counts by the density |dd/du x dd/dv| there; the sums of weights times density
//   divide.  For Kernel::band_limited, where the density is smooth and no highlight is met.
// - Texel.  Gauss-Legendre nodes in each texel, never a negative weight; a sample's weight is its quadrature weight
//   times the density relative to that at the texel's centre, to first order: 1 + g . offset.  The nodes lie
//   symmetrically, so these weights still add up to 1.
// Both leave a constant constant.
//
// Highlights take two passes.  In the first every output texel reports the share of solid angle by which it received
// each highlight (integers, so that the order does not matter); the highlights are then scaled to conserve their energy
// (Source::conserve_highlights), and the second pass adds them where they were met.
#include "resample.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <new>
#include <optional>
#include <span>
#include <stdexcept>

#include "assertion.h"
#include "quadrature.h"
#include "read_kernels.h"
#include "solid_angle.h"
#include "source.h"
#include "source_blocks.h"

namespace envconv {
namespace {

constexpr int largest_tile = 64, tile_rows = 64;            // of a tile
constexpr int tallest_face = 1 << 24;                       // more texels than any memory
constexpr double sliver_limit = 1.375;                      // longest side over shortest that the sampling follows
constexpr std::size_t block_memory = std::size_t{8} << 20;  // bytes of prefiltered blocks that a thread keeps
constexpr double grid_spacing = 0.88;                       // largest step of a grid, in source texels
constexpr double direct_ratio = 3.5;            // source texels in a texel from which no prefilter is needed
constexpr double direct_spacing = 1.1;          // largest step of a grid there
constexpr int most_ring = most_grid_steps + 6;  // rows of samples that a texel takes
constexpr int sliver_samples = 24;              // samples a side where highlights lie on slivers

struct Tile {
  int face, x0, y0, width, height;
  bool slivers = false;  // holds highlights that need dense sampling
};

// The part of a tile that met highlights, in texels of the face.
struct Met {
  int left = 1 << 30, top = 1 << 30, right = -1, bottom = -1;  // right and bottom: one past the last
  bool any() const { return right > left; }
  void add(int x, int y) {
    left = std::min(left, x), top = std::min(top, y);
    right = std::max(right, x + 1), bottom = std::max(bottom, y + 1);
  }
};

// Density relative to neighbours, and the number of samples, over one tile.
struct TilePlan {
  static constexpr int nodes_x = 5, nodes_y = 5;
  double density[nodes_y][nodes_x];
  double need_u = 0, need_v = 0;  // source texels along a texel's sides, at most
  double least = 1e30;            // source texels that a texel is wide where it is narrowest
  // A wave of one texel along u, and along v: the waves that it is along the source's texels and across, on average.
  SourceWave wave_u, wave_v;
  int ku = 1, kv = 1;
  bool smooth = false;  // the density varies little enough to be sampled on a grid
};

class Resampler {
 public:
  Resampler(const EnvImage& source, const ResampleOptions& options, const Filter& filter)
      : source_(source), options_(options), filter_(filter) {
    const Mat3 out_from_world = layout_from_world(*options.layout, options.consumer_from_world);
    source_from_out_ =
        layout_from_world(source) * (transpose(rotation_matrix(options.rotation)) * transpose(out_from_world));
    for (std::size_t i = 0; i < 9; ++i) matrix_[i] = static_cast<float>(source_from_out_.m[i]);
  }

  bool is_copy() const {
    if (source_.layout != options_.layout || source_.placement != options_.placement || filter_.window != 1.0)
      return false;
    if (!(source_from_out_ == Mat3{})) return false;
    for (int f = 0; f < source_.layout->face_count(); ++f) {
      const Image& face = source_.faces[static_cast<std::size_t>(f)];
      if (Size{face.width(), face.height()} != face_size(*options_.layout, f, options_.height)) return false;
    }
    return true;
  }

  Result<EnvImage> run(EnvImage recycled) {
    EnvImage out;
    out.layout = options_.layout;
    out.placement = options_.placement;
    out.consumer_from_world = options_.consumer_from_world;
    out.channels = source_.channels;
    if (is_copy()) {
      for (const Image& face : source_.faces) out.faces.push_back(face.clone());
      return out;
    }
    for (int f = 0; f < options_.layout->face_count(); ++f) {
      const Size size = face_size(*options_.layout, f, options_.height);
      const auto i = static_cast<std::size_t>(f);
      if (i < recycled.faces.size() && recycled.faces[i].width() == size.width &&
          recycled.faces[i].height() == size.height && recycled.faces[i].channels() == source_.channels.count()) {
        out.faces.push_back(std::move(recycled.faces[i]));
      } else {
        out.faces.emplace_back(size.width, size.height, source_.channels.count());
      }
    }
    make_tiles(out);
    const int groups = (source_.channels.count() + 3) / 4;
    SphereMean mean;
    for (int g = 0; g < groups && !stopped_; ++g) {
      Source source(source_, 4 * g, filter_);
      share_done_ = static_cast<double>(g) / groups;
      share_step_ = 1.0 / groups;
      run_group(source, out, 4 * g);
      if (g == 0) mean = source.mean();
    }
    if (stopped_) return Error{ErrorCode::output, "stopped"};
    if (filter_.limited) keep_mean(mean, out);
    return out;
  }

 private:
  // Sampling leaves the mean over the sphere off by 1e-8 to 1e-3 of itself (most where texel-sized noise is shrunk a
  // little).  What is missing is given back in proportion to each value's magnitude: a gain for radiance, and nothing
  // for a constant, whose mean is exact already.
  void keep_mean(const SphereMean& before, EnvImage& out) const {
    constexpr double most = 0.01;  // more than this is no rounding to be mended: a handful of texels, or singular ones
    const SphereMean after = sphere_mean(out);
    const int channels = out.channels.count();
    std::vector<float> share(static_cast<std::size_t>(channels), 0.0f);
    bool any = false;
    for (std::size_t c = 0; c < share.size(); ++c) {
      const double missing = before.value[c] - after.value[c];
      if (!(after.magnitude[c] > 0) || !(std::abs(missing) <= most * after.magnitude[c])) continue;
      share[c] = static_cast<float>(missing / after.magnitude[c]);
      any = any || std::abs(share[c]) > 1e-6f;
    }
    if (!any) return;
    // A row's values take their channels' shares in turn: twelve at once, a whole number of texels of 1 to 4 channels.
    constexpr int period = 12;
    const bool periodic = channels <= 4;
    float shares[period];
    for (int i = 0; periodic && i < period; ++i) shares[i] = share[static_cast<std::size_t>(i % channels)];
    for (Image& face : out.faces)
      tbb::parallel_for(0, face.height(), [&](int y) {
        float* __restrict p = face.row(y);
        const std::ptrdiff_t n = static_cast<std::ptrdiff_t>(face.width()) * channels;
        std::ptrdiff_t at = 0;
        for (; periodic && at + period <= n; at += period)
          for (int i = 0; i < period; ++i) p[at + i] += shares[i] * std::abs(p[at + i]);
        for (; at < n; ++at) p[at] += share[static_cast<std::size_t>(at % channels)] * std::abs(p[at]);
      });
  }

  // Tiles hold about as many samples each, so that what they need of the source stays in a core's cache and the number
  // of samples follows the place.
  void make_tiles(const EnvImage& out) {
    double ratio = 1;  // source texels a side of an output texel, where both layouts' faces are centred
    if (filter_.spacing > 0)
      ratio = std::sqrt(static_cast<double>(source_.texel_count()) / static_cast<double>(out.texel_count())) /
              filter_.spacing;
    const int by_ratio = ratio <= 2.5 ? largest_tile : ratio <= 5 ? 32 : 16;
    // A sixteenth of a face at most, over which the density is nearly a plane between the plan's nodes.
    tile_side_ = std::clamp(out.faces.front().height() / 16, 8, by_ratio);
    for (int f = 0; f < out.layout->face_count(); ++f) {
      const Image& face = out.faces[static_cast<std::size_t>(f)];
      for (int y = 0; y < face.height(); y += tile_side_)
        for (int x = 0; x < face.width(); x += tile_side_)
          tiles_.push_back({f, x, y, std::min(tile_side_, face.width() - x), std::min(tile_side_, face.height() - y)});
    }
    met_.resize(tiles_.size());
  }

  // Tiles of the output that see a highlight on a sliver, or are one texel away from seeing it.
  void mark_slivers(const Source& source, const EnvImage& out) {
    for (Tile& t : tiles_) t.slivers = false;
    std::ranges::fill(met_, Met{});
    if (source.highlights().slivers.empty()) return;
    std::vector<std::size_t> first;  // index of each face's first tile
    for (std::size_t i = 0; i < tiles_.size(); ++i)
      if (static_cast<std::size_t>(tiles_[i].face) == first.size()) first.push_back(i);
    const Mat3 out_from_source = transpose(source_from_out_);
    for (const Vec3& d : source.highlights().slivers) {
      const Location at = out.layout->locate(out_from_source * d);
      const Image& face = out.faces[static_cast<std::size_t>(at.face)];
      const double x = texel_from_u(at.u, face.width(), out.placement);
      const double y = texel_from_u(at.v, face.height(), out.placement);
      const int across = (face.width() + tile_side_ - 1) / tile_side_;
      for (const double dx : {-1.5, 1.5})
        for (const double dy : {-1.5, 1.5}) {
          const int i = std::clamp(static_cast<int>(std::floor(x + dx + 0.5)), 0, face.width() - 1);
          const int j = std::clamp(static_cast<int>(std::floor(y + dy + 0.5)), 0, face.height() - 1);
          tiles_[first[static_cast<std::size_t>(at.face)] +
                 static_cast<std::size_t>(j / tile_side_ * across + i / tile_side_)]
              .slivers = true;
        }
    }
  }

  void run_group(Source& source, EnvImage& out, int first_channel) {
    mark_slivers(source, out);
    const std::size_t most_blocks = SourceBlocks::worth_keeping(source_, block_memory);
    tbb::enumerable_thread_specific<std::unique_ptr<Workspace>> workspaces(
        [&] { return std::make_unique<Workspace>(source, filter_.kernel, most_blocks); });
    std::atomic<std::size_t> done{0};
    tbb::parallel_for(std::size_t{0}, tiles_.size(), [&](std::size_t i) {
      if (stopped_) return;
      first_pass(source, *workspaces.local(), tiles_[i], met_[i], out, first_channel);
      if (options_.progress && !options_.progress(share_done_ + share_step_ * static_cast<double>(++done) /
                                                                    static_cast<double>(tiles_.size())))
        stopped_ = true;
    });
    if (!source.highlights().any() || stopped_) return;
    const std::vector<StrandedEnergy> stranded = source.conserve_highlights();
    tbb::parallel_for(std::size_t{0}, tiles_.size(), [&](std::size_t i) {
      if (met_[i].any()) second_pass(source, *workspaces.local(), tiles_[i], met_[i], out, first_channel);
    });
    for (const StrandedEnergy& e : stranded) deposit(e, out, first_channel);
  }

  // Energy that no sample met goes to the texel in whose footprint it lies, or its neighbour with the most solid angle.
  void deposit(const StrandedEnergy& stranded, EnvImage& out, int first_channel) const {
    const Location at = out.layout->locate(transpose(source_from_out_) * stranded.direction);
    Image& face = out.faces[static_cast<std::size_t>(at.face)];
    const Size size{face.width(), face.height()};
    const int x =
        std::clamp(static_cast<int>(std::lround(texel_from_u(at.u, size.width, out.placement))), 0, size.width - 1);
    const int y =
        std::clamp(static_cast<int>(std::lround(texel_from_u(at.v, size.height, out.placement))), 0, size.height - 1);
    double best = 0;
    int best_x = x, best_y = y;
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx) {
        const int xx = std::clamp(x + dx, 0, size.width - 1), yy = std::clamp(y + dy, 0, size.height - 1);
        double omega = texel_solid_angle(*out.layout, at.face, xx, yy, size, out.placement);
        if (dx == 0 && dy == 0) omega *= 4;  // unless it is a remnant cut off by a seam
        if (omega > best) best = omega, best_x = xx, best_y = yy;
      }
    const double omega = texel_solid_angle(*out.layout, at.face, best_x, best_y, size, out.placement);
    float* to = face.at(best_x, best_y) + first_channel;
    for (int c = 0; c < std::min(4, source_.channels.count() - first_channel); ++c)
      to[c] += static_cast<float>(stranded.energy[c] / omega);
  }

  TilePlan plan(const Source& source, const Tile& tile, const EnvImage& out) const {
    TilePlan plan;
    const Image& face = out.faces[static_cast<std::size_t>(tile.face)];
    const double eu = texel_extent(face.width(), out.placement), ev = texel_extent(face.height(), out.placement);
    int waves = 0;
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
        const Vec3 tu = source_from_out_ * (eu * jet.du), tv = source_from_out_ * (ev * jet.dv);
        const Vec3 d = source_from_out_ * jet.d;
        const Location at = source.layout().locate(d);
        const SourceFace& s = source.faces()[static_cast<std::size_t>(at.face)];
        const DirectionJet from = source.layout().direction_jet(at.face, at.u, at.v);
        const Vec3 a = texel_extent(s.size.width, source.placement()) * from.du;
        const Vec3 b = texel_extent(s.size.height, source.placement()) * from.dv;
        const double aa = dot(a, a), ab = dot(a, b), bb = dot(b, b);
        const double root = std::sqrt((aa - bb) * (aa - bb) + 4 * ab * ab);
        double wide = std::sqrt(0.5 * (aa + bb + root));
        const double thin =
            std::max(std::sqrt(std::max(0.0, 0.5 * (aa + bb - root))), wide / (filter_.limited ? sliver_limit : 1));
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
    for (SourceWave* wave : {&plan.wave_u, &plan.wave_v})
      if (waves > 0) wave->along /= waves, wave->across /= waves;
    double least = plan.density[0][0], most = least;
    for (const auto& row : plan.density)
      for (const double density : row) least = std::min(least, density), most = std::max(most, density);
    plan.smooth = out.layout->info().domain != Domain::disc && least > 0.2 * most;
    if (options_.samples > 0) {
      plan.ku = plan.kv = options_.samples;
    } else {
      const auto samples = [&](double texels) {
        if (filter_.spacing <= 0) return filter_.least_samples;
        const double wanted = std::ceil(texels * filter_.window / filter_.spacing - 0.02);
        return std::max(filter_.least_samples, static_cast<int>(std::min(wanted, 4096.0)));
      };
      plan.ku = samples(plan.need_u);
      plan.kv = samples(plan.need_v);
    }
    if (tile.slivers) plan.ku = std::max(plan.ku, sliver_samples), plan.kv = std::max(plan.kv, sliver_samples);
    return plan;
  }

  // What a thread needs for its tiles.
  struct Workspace {
    Workspace(const Source& source, Kernel kernel, std::size_t most_blocks) {
      if (kernel == Kernel::band_limited) blocks.emplace(source, most_blocks);
    }
    std::optional<SourceBlocks> blocks;
    Windows windows;
    alignas(64) float u[batch_room], v[batch_room], x[batch_room], y[batch_room], z[batch_room], face[batch_room],
        su[batch_room], sv[batch_room], weight[batch_room];
    alignas(64) float samples[batch_room * 4];  // of a batch
    float total[batch_room];
    alignas(64) float row[largest_tile * 4];
    // Of the grid: the last rows of samples, four floats each, and their densities; and those combined to a row.
    std::vector<float> samples_rows, density_rows, combined, combined_density;
  };

  // The samples' directions to windows that point at texels.
  void find_windows(const Source& source, Kernel kernel, Workspace& w, int count) const {
    const std::size_t padded = (static_cast<std::size_t>(count) + 15) / 16 * 16;
    rotate_directions(matrix_, padded, w.x, w.y, w.z);
    source.layout().locations(padded, w.x, w.y, w.z, w.face, w.su, w.sv);
    make_windows(source.maps(), kernel, count, w.face, w.su, w.sv, w.weight, w.windows);
  }

  static void point(const Source& source, Kernel kernel, Workspace& w, int count) {
    if (kernel == Kernel::band_limited)
      w.blocks->point(count, w.face, w.windows);
    else
      source.point(kernel, count, w.face, w.windows);
  }

  // Density relative to neighbours at n equal steps along a row of the tile: bilinear between the plan's nodes, and on
  // beyond them.  x and y in texels from the tile's corner.
  static void densities(const TilePlan& plan, const Tile& tile, double x, double step, double y, int n,
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

  // One sample in each texel, which needs no weights: several rows at once.
  void point_pass(const Source& source, Workspace& w, const Tile& tile, EnvImage& out, int first_channel) {
    constexpr int batch = 256;
    static_assert(batch >= largest_tile);
    Image& face = out.faces[static_cast<std::size_t>(tile.face)];
    const int n = tile.width, rows = batch / n;
    const double first = u_from_texel(tile.x0, face.width(), out.placement);
    const double step = texel_extent(face.width(), out.placement);
    for (int row = 0; row < rows; ++row)
      for (int i = 0; i < n; ++i) w.u[row * n + i] = static_cast<float>(first + i * step);
    const int stored = source_.channels.count(), channels = std::min(4, stored - first_channel);
    float lowest[4];
    lowest_values(source, lowest);
    std::fill_n(w.weight, batch, 1.0f);
    for (int j = 0; j < tile.height; j += rows) {
      const int count = std::min(rows, tile.height - j) * n;
      const auto padded = (static_cast<std::size_t>(count) + 15) / 16 * 16;
      for (int s = 0, y = tile.y0 + j; s < count; s += n, ++y)
        std::fill_n(w.v + s, n, static_cast<float>(u_from_texel(y, face.height(), out.placement)));
      std::fill(w.u + count, w.u + padded, w.u[0]), std::fill(w.v + count, w.v + padded, w.v[0]);
      out.layout->directions(tile.face, padded, w.u, w.v, w.x, w.y, w.z);
      find_windows(source, filter_.kernel, w, count);
      point(source, filter_.kernel, w, count);
      sum_windows(filter_.kernel, source.channels(), count, w.windows, w.weight, w.samples);
      for (int s = 0, y = tile.y0 + j; s < count; s += n, ++y)
        store_texels(n, w.samples + 4 * s, {}, lowest, channels, stored, face.at(tile.x0, y) + first_channel);
    }
  }

  // Samples the tile on a grid that its texels share.  False, with nothing to be kept, when Kernel::drooping, which
  // reads the source as it is, met a highlight: the base that is left of these is in the prefiltered blocks.
  bool grid_pass(const Source& source, Workspace& w, const Tile& tile, const TilePlan& plan, Kernel kernel,
                 const GridQuadrature& qu, const GridQuadrature& qv, Met& met, EnvImage& out, int first_channel) {
    Image& face = out.faces[static_cast<std::size_t>(tile.face)];
    const Highlights& highlights = source.highlights();
    const bool even = out.layout->info().equal_area;
    const bool apart = source.channels() == 4;  // three channels leave a float for the density
    const int nu = qu.samples(tile.width), nv = qv.samples(tile.height), ring = qv.taps;
    const auto padded = (static_cast<std::size_t>(nu) + 15) / 16 * 16;
    const double step_u = static_cast<double>(qu.texels) / qu.steps, first_u = (0.5 - qu.before()) * step_u;
    const double step_v = static_cast<double>(qv.texels) / qv.steps;
    const auto room = [](std::vector<float>& v, std::size_t n) {
      if (v.size() < n) v.resize(n);
    };
    room(w.samples_rows, static_cast<std::size_t>(ring) * padded * 4), room(w.combined, padded * 4);
    room(w.density_rows, static_cast<std::size_t>(ring) * padded), room(w.combined_density, padded);
    const double u = u_from_texel(tile.x0 - 0.5 + first_u, face.width(), out.placement);
    const double du = texel_extent(face.width(), out.placement) * step_u;
    for (int i = 0; i < nu; ++i) w.u[i] = static_cast<float>(u + i * du);
    std::fill(w.u + nu, w.u + padded, w.u[0]);
    std::fill_n(w.weight, padded, 1.0f);
    float lowest[4];
    lowest_values(source, lowest);
    const int stored = source_.channels.count(), channels = std::min(4, stored - first_channel);
    int texel = 0;  // row of the tile that is next
    for (int row = 0; row < nv; ++row) {
      const double y = (row - qv.before() + 0.5) * step_v;
      const float v = static_cast<float>(u_from_texel(tile.y0 - 0.5 + y, face.height(), out.placement));
      std::fill_n(w.v, padded, v);
      if (!even) densities(plan, tile, first_u, step_u, y, nu, w.weight);
      out.layout->directions(tile.face, padded, w.u, w.v, w.x, w.y, w.z);
      find_windows(source, kernel, w, nu);
      if (highlights.any()) {
        if (kernel == Kernel::drooping)
          for (int s = 0; s < nu; ++s)
            if (highlights.touch(source.faces()[static_cast<std::size_t>(w.face[s])], w.windows.x[s], w.windows.y[s]))
              return false;
        const int j = static_cast<int>(std::floor(y));
        for_each_near_highlight(source, w, nu, [&](int s) {
          const int i = static_cast<int>(std::floor(first_u + s * step_u + 0.5));
          // With two texels around: between samples there are others.
          for (const int d : {-2, 2})
            met.add(tile.x0 + std::clamp(i + d, 0, tile.width - 1), tile.y0 + std::clamp(j + d, 0, tile.height - 1));
        });
      }
      point(source, kernel, w, nu);
      const auto slot = static_cast<std::size_t>(row % ring);
      sum_windows(kernel, source.channels(), nu, w.windows, w.weight, w.samples_rows.data() + slot * padded * 4);
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
        combine_samples(tile.width, qu.texels, qu.steps, qu.taps, qu.first.data(), qu.weight.data(), into, w.row);
        if (apart) {
          combine_rows(nu, ring, weight, density, w.combined_density.data());
          combine_densities(qu, tile.width, w.combined_density.data() + qu.before(), w.total);
        }
        store_texels(tile.width, w.row, apart ? Totals{w.total, 1} : Totals{w.row + 3, 4}, lowest, channels, stored,
                     face.at(tile.x0, tile.y0 + texel) + first_channel);
      }
    }
    ENVCONV_ASSERT(texel == tile.height);
    return true;
  }

  // visit(s) for every sample that reads an excess.  Neighbours mostly share a block.
  template <class Visit>
  static void for_each_near_highlight(const Source& source, const Workspace& w, int n, const Visit& visit) {
    constexpr int side = Highlights::side;
    int block_x = -1, block_y = -1;
    float face = -1;
    const Highlights::Mask* mask = nullptr;
    for (int s = 0; s < n; ++s) {
      const Place p = place_of(w.windows, s);
      if (p.x / side != block_x || p.y / side != block_y || w.face[s] != face) {
        block_x = p.x / side, block_y = p.y / side, face = w.face[s];
        mask = source.highlights().mask_at(source.faces()[static_cast<std::size_t>(face)], p.x, p.y);
      }
      if (mask && (mask->rows[p.y % side] >> (p.x % side) & 1)) visit(s);
    }
  }

  // The texels that a bilinear read takes, and their blocks; absent ones are nullptr.  Samples in a row mostly share
  // them.
  template <class Block>
  struct Quad {
    float face = -1;
    int x = 0, y = 0;
    Block* block[4] = {};
    int texel[4] = {};

    bool is_at(float f, const Place& p) const { return f == face && p.x == x && p.y == y; }
    template <class AnyHighlights>
    void move(AnyHighlights& highlights, const SourceFace& source_face, float f, const Place& p) {
      face = f, x = p.x, y = p.y;
      for (int k = 0; k < 4; ++k) {
        const int xx = x + (k & 1), yy = y + (k >> 1);
        const std::int32_t index = highlights.index[Highlights::block_number(source_face, xx, yy)];
        block[k] = index < 0 ? nullptr : &highlights.blocks[static_cast<std::size_t>(index)];
        texel[k] = Highlights::place(xx, yy);
      }
    }
    static float weight(int k, const Place& p) { return (k & 1 ? p.fx : 1 - p.fx) * (k >> 1 ? p.fy : 1 - p.fy); }
  };

  static void combine_densities(const GridQuadrature& q, int n, const float* in, float* out) {
    for (int i = 0; i < n; ++i) {
      const auto phase = static_cast<std::size_t>(i % q.texels);
      const float* from = in + i / q.texels * q.steps + q.first[phase];
      const float* weight = q.weight.data() + phase * static_cast<std::size_t>(q.taps);
      out[i] = 0;
      for (int k = 0; k < q.taps; ++k) out[i] += weight[k] * from[k];
    }
  }

  // A limited filter does not go below black where the source never does.
  void lowest_values(const Source& source, float lowest[4]) const {
    for (int c = 0; c < 4; ++c)
      lowest[c] = filter_.limited ? std::min(source.lowest()[c], 0.0f) : -std::numeric_limits<float>::infinity();
  }

  // w.row over w.total to row j of the tile.
  void store_row(const Source& source, Workspace& w, const Tile& tile, int j, Image& face, int first_channel) const {
    const int stored = source_.channels.count(), channels = std::min(4, stored - first_channel);
    float lowest[4];
    lowest_values(source, lowest);
    store_texels(tile.width, w.row, {w.total, 1}, lowest, channels, stored,
                 face.at(tile.x0, tile.y0 + j) + first_channel);
  }

  // Calls visit(first sample's texel row, n) for every batch of samples of row j of the tile, with the workspace's
  // face, su, sv and weight filled in.  workspace.total holds each texel's sum of weights from the start.
  template <class Visit>
  void sample_row(const Source& source, Kernel kernel, const Tile& tile, const TilePlan& plan, const Quadrature& qu,
                  const Quadrature& qv, const EnvImage& out, int j, Workspace& w, const Visit& visit) const {
    const Image& face = out.faces[static_cast<std::size_t>(tile.face)];
    const int n = tile.width;
    alignas(64) float gx[largest_tile], gy[largest_tile];  // relative change of the density per texel
    density_slopes(plan, tile, j, gx, gy);
    const bool disc = out.layout->info().domain == Domain::disc;
    bool outside[largest_tile];
    for (int i = 0; i < n; ++i) {
      outside[i] = false;
      w.total[i] = 1.0f;
      if (disc || static_cast<double>(std::abs(gx[i]) + std::abs(gy[i])) * filter_.window <= 2.0) continue;
      double sum = 0;  // some weights are cut off at 0
      for (int m = 0; m < qv.count(); ++m)
        for (int k = 0; k < qu.count(); ++k) sum += sample_weight(qu, qv, k, m, gx[i], gy[i]);
      w.total[i] = static_cast<float>(sum);
    }
    const auto centred = [&](int i, int k, double offset_y, double& a, double& b) {
      a = 2 * u_from_texel(tile.x0 + i + qu.offset[static_cast<std::size_t>(k)], face.width(), out.placement) - 1;
      b = 2 * u_from_texel(tile.y0 + j + offset_y, face.height(), out.placement) - 1;
    };
    if (disc) {
      // Only samples inside the disc count; a texel without any takes the nearest rim's radiance.
      for (int i = 0; i < n; ++i) {
        double sum = 0;
        for (int m = 0; m < qv.count(); ++m)
          for (int k = 0; k < qu.count(); ++k) {
            double a, b;
            centred(i, k, qv.offset[static_cast<std::size_t>(m)], a, b);
            if (a * a + b * b <= 1) sum += sample_weight(qu, qv, k, m, gx[i], gy[i]);
          }
        outside[i] = !(sum > 0);
        w.total[i] = outside[i] ? 1.0f : static_cast<float>(sum);
        if (outside[i]) gx[i] = gy[i] = 0;
      }
    }
    const int per_call = std::max(1, most_samples / n);
    for (int m = 0; m < qv.count(); ++m) {
      const double offset_y = qv.offset[static_cast<std::size_t>(m)];
      const float v = static_cast<float>(u_from_texel(tile.y0 + j + offset_y, face.height(), out.placement));
      for (int k0 = 0; k0 < qu.count(); k0 += per_call) {
        const int columns = std::min(per_call, qu.count() - k0);
        const int count = columns * n;
        int s = 0;
        for (int k = k0; k < k0 + columns; ++k) {
          const double offset_x = qu.offset[static_cast<std::size_t>(k)];
          const double q = qu.weight[static_cast<std::size_t>(k)] * qv.weight[static_cast<std::size_t>(m)];
          // u is affine in the texel's index.
          const double first = u_from_texel(tile.x0 + offset_x, face.width(), out.placement);
          const double step = texel_extent(face.width(), out.placement);
          const float ox = static_cast<float>(offset_x), oy = static_cast<float>(offset_y), qf = static_cast<float>(q);
          float* __restrict us = w.u + s;
          float* __restrict ws = w.weight + s;
          for (int i = 0; i < n; ++i) us[i] = static_cast<float>(first + i * step);
          for (int i = 0; i < n; ++i) ws[i] = qf * std::max(0.0f, 1.0f + gx[i] * ox + gy[i] * oy);
          std::fill_n(w.v + s, n, v);
          s += n;
          if (!disc) continue;
          for (int i = 0; i < n; ++i) {
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
        for (int p = count; p % 16; ++p) w.u[p] = w.u[0], w.v[p] = w.v[0], w.weight[p] = 0;
        const std::size_t padded = (static_cast<std::size_t>(count) + 15) / 16 * 16;
        ENVCONV_ASSERT(padded <= std::size(w.u) && std::ranges::none_of(std::span(w.weight, padded), is_no_weight));
        out.layout->directions(tile.face, padded, w.u, w.v, w.x, w.y, w.z);
        find_windows(source, kernel, w, count);
        visit(count);
      }
    }
  }

  // The relative change of the density per texel, along both axes, at the texels of row j: bilinear between the plan's
  // nodes. A centre on a singular point has no slope to speak of; elsewhere |slope| <= 2, its value next to a pole.
  static void density_slopes(const TilePlan& plan, const Tile& tile, int j, float* __restrict gx,
                             float* __restrict gy) {
    const double wide = static_cast<double>(tile.width) / (TilePlan::nodes_x - 1);
    const double high = static_cast<double>(tile.height) / (TilePlan::nodes_y - 1);
    const int k = std::min(static_cast<int>((j + 0.5) / high), TilePlan::nodes_y - 2);
    const double t = (j + 0.5) / high - k;
    for (int cell = 0, i = 0; cell < TilePlan::nodes_x - 1; ++cell) {
      const double a = plan.density[k][cell], b = plan.density[k][cell + 1];
      const double c = plan.density[k + 1][cell], d = plan.density[k + 1][cell + 1];
      const float left = static_cast<float>(a + t * (c - a)), right = static_cast<float>(b + t * (d - b));
      const float across = static_cast<float>((right - left) / wide);
      const float down_left = static_cast<float>((c - a) / high), down_right = static_cast<float>((d - b) / high);
      const int end = cell + 2 == TilePlan::nodes_x ? tile.width : static_cast<int>(std::ceil((cell + 1) * wide - 0.5));
      const float scale = static_cast<float>(1 / wide), first = static_cast<float>(0.5 - cell * wide);
      for (; i < end; ++i) {
        const float x = (static_cast<float>(i) + first) * scale;
        const float here = left + x * (right - left);
        const float inverse = here > 0 ? 1.0f / here : 0.0f;
        gx[i] = std::clamp(across * inverse, -2.0f, 2.0f);
        gy[i] = std::clamp((down_left + x * (down_right - down_left)) * inverse, -2.0f, 2.0f);
      }
    }
  }

  [[maybe_unused]] static bool is_no_weight(float weight) { return !(weight >= 0); }

  static double sample_weight(const Quadrature& qu, const Quadrature& qv, int k, int m, double gx, double gy) {
    return qu.weight[static_cast<std::size_t>(k)] * qv.weight[static_cast<std::size_t>(m)] *
           std::max(0.0, 1 + gx * qu.offset[static_cast<std::size_t>(k)] + gy * qv.offset[static_cast<std::size_t>(m)]);
  }

  const Quadrature& nodes(int n) {
    const std::lock_guard lock(quadratures_mutex_);
    auto& q = quadratures_[n];
    if (!q) q = std::make_unique<Quadrature>(quadrature(filter_, n));
    return *q;
  }

  // For n texels whose sides are `need` source texels; nothing when that takes more steps than a grid has.
  std::optional<GridQuadrature> grid(double need, const SourceWave& wave, Kernel kernel, int n) {
    const double spacing = kernel == Kernel::drooping ? direct_spacing : grid_spacing;
    int steps = options_.samples, texels = 1;
    if (steps == 0) {
      steps = 1;
      while (need > spacing * steps / texels && steps <= most_grid_steps) {
        // 1, 3/2, 2, 3, 4 ...
        if (steps == 1 && n % 2 == 0)
          steps = 3, texels = 2;
        else
          steps = steps / texels + 1, texels = 1;
      }
    }
    if (steps > most_grid_steps) return std::nullopt;
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
  const GridQuadrature& table(const std::array<int, 5>& key) {
    const std::lock_guard lock(quadratures_mutex_);
    auto& q = grids_[key];
    if (!q) {
      const double density = static_cast<double>(key[0]) / key[1];
      q = std::make_unique<GridQuadrature>(
          grid_quadrature(key[0], key[1], key[2] / 8.0 * density, {key[3] / 8.0 / density, key[4] / 8.0 / density}));
    }
    return *q;
  }

  void first_pass(Source& source, Workspace& w, const Tile& tile, Met& met, EnvImage& out, int first_channel) {
    const TilePlan tile_plan = plan(source, tile, out);
    if (w.blocks) w.blocks->next_tile();
    if (filter_.kernel == Kernel::band_limited && tile_plan.smooth && !tile.slivers) {
      const bool wide = tile_plan.least >= direct_ratio;
      if ((wide && on_grid(source, w, tile, tile_plan, Kernel::drooping, met, out, first_channel)) ||
          on_grid(source, w, tile, tile_plan, Kernel::band_limited, met, out, first_channel)) {
        if (met.any()) receive(source, w, tile, met, out);
        return;
      }
    }
    if (tile_plan.ku == 1 && tile_plan.kv == 1 && !filter_.limited && out.layout->info().domain != Domain::disc)
      return point_pass(source, w, tile, out, first_channel);
    texel_pass(source, w, tile, tile_plan, out, first_channel);
    if (!source.highlights().any()) return;
    met.add(tile.x0, tile.y0), met.add(tile.x0 + tile.width - 1, tile.y0 + tile.height - 1);
    receive(source, w, tile, met, out);
  }

  bool on_grid(const Source& source, Workspace& w, const Tile& tile, const TilePlan& tile_plan, Kernel kernel, Met& met,
               EnvImage& out, int first_channel) {
    const std::optional<GridQuadrature> u = grid(tile_plan.need_u, tile_plan.wave_u, kernel, tile.width);
    const std::optional<GridQuadrature> v = grid(tile_plan.need_v, tile_plan.wave_v, kernel, tile.height);
    return u && v && grid_pass(source, w, tile, tile_plan, kernel, *u, *v, met, out, first_channel);
  }

  // Samples every texel for itself, with positive weights.
  void texel_pass(const Source& source, Workspace& w, const Tile& tile, const TilePlan& tile_plan, EnvImage& out,
                  int first_channel) {
    const Quadrature &qu = nodes(tile_plan.ku), &qv = nodes(tile_plan.kv);
    Image& face = out.faces[static_cast<std::size_t>(tile.face)];
    for (int j = 0; j < tile.height; ++j) {
      // A texel on a singular point may take millions of samples: batches are added up in double.
      double sum[largest_tile][4] = {};
      sample_row(source, filter_.kernel, tile, tile_plan, qu, qv, out, j, w, [&](int count) {
        point(source, filter_.kernel, w, count);
        sum_windows(filter_.kernel, source.channels(), count, w.windows, w.weight, w.samples);
        std::fill_n(w.row, 4 * tile.width, 0.0f);
        for (int s = 0; s < count; s += tile.width)
          for (int i = 0; i < 4 * tile.width; ++i) w.row[i] += w.samples[4 * s + i];
        for (int i = 0; i < 4 * tile.width; ++i) sum[i / 4][i % 4] += static_cast<double>(w.row[i]);
      });
      for (int i = 0; i < 4 * tile.width; ++i) w.row[i] = static_cast<float>(sum[i / 4][i % 4]);
      store_row(source, w, tile, j, face, first_channel);
    }
  }

  static Tile part_of(const Tile& tile, const Met& met) {
    return {tile.face, met.left, met.top, met.right - met.left, met.bottom - met.top, tile.slivers};
  }

  // Counts what the texels that met highlights receive of them.
  void receive(Source& source, Workspace& w, const Tile& whole, Met& met, const EnvImage& out) {
    const Tile tile = part_of(whole, met);
    const TilePlan tile_plan = plan(source, tile, out);
    const Quadrature &qu = nodes(tile_plan.ku), &qv = nodes(tile_plan.kv);
    const Image& face = out.faces[static_cast<std::size_t>(tile.face)];
    Highlights& highlights = source.highlights();
    std::vector<double> omega;  // of the texels, once a highlight is met
    Quad<Highlights::Block> quad;
    std::uint64_t received[4] = {};  // by its texels, so far
    const auto flush = [&] {
      for (int k = 0; k < 4; ++k) {
        if (quad.block[k] && received[k] > 0) {
          const float* e = quad.block[k]->excess[quad.texel[k]];
          if (e[0] != 0 || e[1] != 0 || e[2] != 0)
            std::atomic_ref<std::uint64_t>(quad.block[k]->received[quad.texel[k]])
                .fetch_add(received[k], std::memory_order_relaxed);
        }
        received[k] = 0;
      }
    };
    for (int j = 0; j < tile.height; ++j) {
      double scale[largest_tile];  // of weights to units of what is received; negative: not known yet
      std::fill_n(scale, tile.width, -1.0);
      sample_row(source, Kernel::bilinear, tile, tile_plan, qu, qv, out, j, w, [&](int count) {
        for_each_near_highlight(source, w, count, [&](int s) {
          if (omega.empty()) {
            omega.resize(static_cast<std::size_t>(tile.width) * static_cast<std::size_t>(tile.height));
            texel_solid_angles(*out.layout, tile.face, {face.width(), face.height()}, out.placement, tile.x0, tile.y0,
                               tile.width, tile.height, omega.data());
          }
          const SourceFace& f = source.faces()[static_cast<std::size_t>(w.face[s])];
          const Place p = place_of(w.windows, s);
          const int i = s % tile.width;
          if (!(scale[i] >= 0))
            scale[i] = omega[static_cast<std::size_t>(j * tile.width + i)] /
                       (static_cast<double>(w.total[i]) * Highlights::received_unit);
          const double share = scale[i] * static_cast<double>(w.weight[s]);
          ENVCONV_ASSERT(share >= 0);
          if (!quad.is_at(w.face[s], p)) {
            flush();
            quad.move(highlights, f, w.face[s], p);
          }
          for (int k = 0; k < 4; ++k)
            received[k] +=
                static_cast<std::uint64_t>(share * static_cast<double>(Quad<Highlights::Block>::weight(k, p)));
        });
      });
    }
    flush();
    if (omega.empty()) met = {};
  }

  // Adds the highlights to the texels that met them.
  void second_pass(const Source& source, Workspace& w, const Tile& whole, const Met& met, EnvImage& out,
                   int first_channel) {
    const Tile tile = part_of(whole, met);
    const TilePlan tile_plan = plan(source, tile, out);
    const Quadrature &qu = nodes(tile_plan.ku), &qv = nodes(tile_plan.kv);
    Image& face = out.faces[static_cast<std::size_t>(tile.face)];
    const int channels = std::min(4, source_.channels.count() - first_channel);
    const Highlights& highlights = source.highlights();
    Quad<const Highlights::Block> quad;
    for (int j = 0; j < tile.height; ++j) {
      double sum[largest_tile][4] = {};
      sample_row(source, Kernel::bilinear, tile, tile_plan, qu, qv, out, j, w, [&](int count) {
        for_each_near_highlight(source, w, count, [&](int s) {
          const SourceFace& f = source.faces()[static_cast<std::size_t>(w.face[s])];
          const Place p = place_of(w.windows, s);
          if (!quad.is_at(w.face[s], p)) quad.move(highlights, f, w.face[s], p);
          float value[4] = {};
          for (int k = 0; k < 4; ++k) {
            if (!quad.block[k]) continue;
            const float weight = w.weight[s] * Quad<const Highlights::Block>::weight(k, p);
            const float* excess = quad.block[k]->excess[quad.texel[k]];
            for (int c = 0; c < 4; ++c) value[c] += weight * excess[c];
          }
          double* to = sum[s % tile.width];
          for (int c = 0; c < 4; ++c) to[c] += static_cast<double>(value[c]);
        });
      });
      float* to = face.at(tile.x0, tile.y0 + j) + first_channel;
      for (int i = 0; i < tile.width; ++i, to += source_.channels.count())
        for (int c = 0; c < channels; ++c) to[c] += static_cast<float>(sum[i][c] / static_cast<double>(w.total[i]));
    }
  }

  const EnvImage& source_;
  const ResampleOptions& options_;
  const Filter& filter_;
  Mat3 source_from_out_;
  float matrix_[9];
  std::vector<Tile> tiles_;
  std::vector<Met> met_;  // by tile
  int tile_side_ = largest_tile;
  std::map<int, std::unique_ptr<Quadrature>> quadratures_;
  std::map<std::array<int, 5>, std::unique_ptr<GridQuadrature>> grids_;
  std::mutex quadratures_mutex_;
  std::atomic<bool> stopped_{false};
  double share_done_ = 0, share_step_ = 1;
};

}  // namespace

Result<EnvImage> resample(const EnvImage& source, const ResampleOptions& options, EnvImage recycled) {
  if (!source.layout || static_cast<int>(source.faces.size()) != source.layout->face_count() ||
      source.channels.count() == 0)
    return Error{ErrorCode::unsupported, "the source has no pixels"};
  if (!options.layout || options.height < 1) return Error{ErrorCode::usage, "no output layout or size"};
  if (options.height > tallest_face) return Error{ErrorCode::limit, "the output has too many texels"};
  const Filter& filter = options.filter ? *options.filter : all_filters().front();
  try {
    Resampler resampler(source, options, filter);
    // More than there are cores gain nothing, and make TBB print.
    const int cores = tbb::info::default_concurrency();
    tbb::task_arena arena(options.threads > 0 ? std::min(options.threads, cores) : cores);
    return arena.execute([&] { return resampler.run(std::move(recycled)); });
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::limit, "not enough memory to resample (about " +
                                       std::to_string(resample_bytes(source, options) >> 20) + " MiB are needed)"};
  } catch (const std::length_error& error) {
    return Error{ErrorCode::limit, error.what()};
  }
}

std::size_t resample_bytes(const EnvImage& source, const ResampleOptions& options) {
  const std::size_t out = static_cast<std::size_t>(texel_count(*options.layout, options.height)) *
                          static_cast<std::size_t>(source.channels.count()) * sizeof(float);
  const Filter& filter = options.filter ? *options.filter : all_filters().front();
  if (Resampler(source, options, filter).is_copy()) return out;
  // Strips around the faces, and a copy where pixels cannot be read in place.
  const int apron = apron_width(filter.kernel) + 8;
  const bool in_place =
      (source.channels.count() == 3 || source.channels.count() == 4) && source.layout->info().domain == Domain::square;
  std::size_t strips = 0, copy = 0;
  for (const Image& face : source.faces) {
    strips += static_cast<std::size_t>(face.width() + face.height()) * 4 * static_cast<std::size_t>(apron);
    copy += in_place ? 0 : face.pixel_count();
  }
  const std::size_t blocks = filter.kernel == Kernel::band_limited
                                 ? SourceBlocks::worth_keeping(source, block_memory) *
                                       SourceBlocks::bytes(source.channels.count() == 3 ? 3 : 4)
                                 : 0;
  const auto cores = static_cast<std::size_t>(std::max(1, tbb::info::default_concurrency()));
  const std::size_t threads = options.threads > 0 ? std::min(cores, static_cast<std::size_t>(options.threads)) : cores;
  constexpr std::size_t work = std::size_t{1} << 20;  // of each thread, besides its blocks
  // Highlights, of which there may be many.
  const std::size_t rest = filter.limited ? source.texel_count() : 0;
  return out + (strips + copy) * 4 * sizeof(float) + rest + threads * (blocks + work);
}

}  // namespace envconv
