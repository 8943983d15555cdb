// SPDX-License-Identifier: Apache-2.0
// Tiles of the output, in parallel.  Each texel's footprint is sampled in the output's own (u, v): ku x kv points, each
// located exactly in the source, so that curved footprints, poles and seams are no special case.
//
// How many samples: the distance between them is bounded in source texels, along each axis of the output apart.  Where
// the source's texels are slivers (latlong at its poles) their short side counts as no less than the long one over
// sliver_limit; for plain filters only the long one counts.
//
// Where in the source samples lie is computed for each of them only where it must be: most tiles see one face, and see
// it so smoothly that a polynomial through a few points of theirs is the formula to 2e-4 texels (TileMap).
//
// The integral over a footprint is over solid angle.  It is taken in one of three ways.
// - Grid, for "auto" where the density is smooth.  Samples lie in equal steps over the tile and a few beyond it, as
//   densely as the source's texels (grid_spacing), not the output's: 1, 5/4, 3/2 ... in a texel.  Every texel takes
//   its own and some of its neighbours' with the weights of grid_quadrature(), whose sum is the integral of every wave
//   that the source holds.  A sample counts by the density |dd/du x dd/dv| there; the sums of weights times density
//   divide. They are read with Kernel::band_limited from prefiltered blocks (band_limited_wide when growing, or when
//   many samples were asked for); where a texel spans many of the source's, with Kernel::drooping from the source
//   itself, which costs no prefilter, and the weights divide by what it loses. Where the map has a crease (an
//   octahedron's edges, the diagonals of isocube's polar faces) weights that reach across it see waves that are none:
//   texels near it are sampled once more, each for itself, and those on it in triangles that it parts (find_creases).
// - Texel, elsewhere.  Gauss-Legendre nodes in each texel; never a negative weight.  A sample's weight is the node's
//   times the density relative to that at the texel's centre, to first order: 1 + g . offset.  The nodes lie
//   symmetrically, so these weights still add up to 1.  At a disc's rim, to which tiles are quartered, texels take
//   nodes outwards, as many as the map's stretch asks for, and few along the rim (RimTexel).
// - Point, for plain filters where one sample is enough.
// All leave a constant constant.
//
// Highlights are read bilinearly and added.  That takes two passes over the texels that meet one, always sampled by
// texel, as densely as the narrowest highlight asks for.  In the first every one of them reports the share of solid
// angle by which it received each highlight (integers, so that the order does not matter); the highlights are then
// scaled to conserve their energy (Source::conserve_highlights), and the second pass adds them where they were met.
#include "resample.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>
#include <new>
#include <numeric>
#include <stdexcept>
#include <utility>
#include <vector>

#include "solid_angle.h"
#include "source.h"
#include "source_blocks.h"
#include "tile_sampler.h"

namespace envconv {
namespace {

constexpr int tallest_face = 1 << 24;                       // more texels than any memory
constexpr std::size_t block_memory = std::size_t{4} << 20;  // bytes of prefiltered blocks that a thread keeps

// The bits of x and y in turn.
std::uint64_t morton_code(int x, int y) {
  const auto spread = [](int value) {
    auto v = static_cast<std::uint64_t>(value);
    v = (v | v << 16) & 0x0000ffff0000ffff;
    v = (v | v << 8) & 0x00ff00ff00ff00ff;
    v = (v | v << 4) & 0x0f0f0f0f0f0f0f0f;
    v = (v | v << 2) & 0x3333333333333333;
    return (v | v << 1) & 0x5555555555555555;
  };
  return spread(x) | spread(y) << 1;
}

// The filter that the options name, as it suits this pair of sizes.
Filter filter_of(const EnvImage& source, const ResampleOptions& options) {
  // Means over texels larger than the source's take away most of a kernel's errors; a finer output keeps them.
  constexpr double growing = 0.8;  // source texels per texel of the output
  // With so many samples a side the kernel's errors are what is left.
  constexpr int many = 2;
  Filter filter = options.filter ? *options.filter : all_filters().front();
  const auto texels = static_cast<double>(texel_count(*options.layout, options.height));
  const bool is_finer = static_cast<double>(source.texel_count()) < growing * texels;
  if (filter.kernel == Kernel::band_limited && (is_finer || options.samples >= many))
    filter.kernel = Kernel::band_limited_wide;
  return filter;
}

class Resampler {
 public:
  // used_up: the source, when it may be written to, or nullptr.
  Resampler(const EnvImage& source, EnvImage* used_up, const ResampleOptions& options)
      : source_(source),
        used_up_(used_up),
        options_(options),
        filter_(filter_of(source, options)),
        tables_(filter_, options.samples) {
    const Mat3 out_from_world = layout_from_world(*options.layout, options.consumer_from_world);
    source_from_out_ =
        layout_from_world(source) * (transpose(rotation_matrix(options.rotation)) * transpose(out_from_world));
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
      if (used_up_)
        out.faces = std::move(used_up_->faces);
      else
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
      Source source(source_, used_up_, 4 * g, filter_);
      share_done_ = static_cast<double>(g) / groups;
      share_step_ = 1.0 / groups;
      run_group(source, out, 4 * g);
      if (g == 0) mean = source.mean();
    }
    if (stopped_) return Error{ErrorCode::output, "stopped"};
    if (filter_.limited) keep_mean(mean, tile_sums_.empty() ? sphere_mean(out) : sum_of_tiles(), out);
    return out;
  }

 private:
  // Sampling leaves the mean over the sphere off by 1e-8 to 1e-3 of itself (most where texel-sized noise is shrunk a
  // little).  What is missing is given back in proportion to each value's magnitude: a gain for radiance, and nothing
  // for a constant, whose mean is exact already.
  void keep_mean(const SphereMean& before, const SphereMean& after, EnvImage& out) const {
    constexpr double most = 0.03;   // more than this is no rounding to be mended: a handful of texels, or singular ones
    constexpr float least = 3e-6f;  // less than this is not worth a walk through the image
    const int channels = out.channels.count();
    std::vector<float> share(static_cast<std::size_t>(channels), 0.0f);
    bool any = false;
    for (std::size_t c = 0; c < share.size(); ++c) {
      const double missing = before.value[c] - after.value[c];
      if (!(after.magnitude[c] > 0) || !(std::abs(missing) <= most * after.magnitude[c])) continue;
      share[c] = static_cast<float>(missing / after.magnitude[c]);
      any = any || std::abs(share[c]) > least;
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
    // A quarter of a face at most: a polynomial through the plan's nodes is the density, and one grid fits.
    tile_side_ = std::clamp(out.faces.front().height() / 4, 8, by_ratio);
    for (int f = 0; f < out.layout->face_count(); ++f) {
      const Image& face = out.faces[static_cast<std::size_t>(f)];
      for (int y = 0; y < face.height(); y += tile_side_)
        for (int x = 0; x < face.width(); x += tile_side_)
          tiles_.push_back({f, x, y, std::min(tile_side_, face.width() - x), std::min(tile_side_, face.height() - y)});
    }
    lights_.resize(tiles_.size());
    // Along a curve that stays close to where it was (Morton's), so that a thread's next tile reads what is in its
    // caches, and what two threads read overlaps little.
    order_.resize(tiles_.size());
    std::iota(order_.begin(), order_.end(), 0u);
    std::ranges::sort(order_, {}, [&](std::uint32_t i) {
      const Tile& t = tiles_[i];
      return std::pair(t.face, morton_code(t.x0 / tile_side_, t.y0 / tile_side_));
    });
  }

  // Texels of the output that see a highlight on a sliver, or are close to seeing it, need so many samples that some
  // fall on it: four across the two texels that a bilinear read spans.
  void mark_slivers(const Source& source, const EnvImage& out) {
    constexpr int most_samples_a_side = 24;
    constexpr double farthest = 6;  // texels
    for (auto& lights : lights_) lights.reset();
    if (source.highlights().slivers.empty()) return;
    std::vector<std::size_t> first;  // index of each face's first tile
    for (std::size_t i = 0; i < tiles_.size(); ++i)
      if (static_cast<std::size_t>(tiles_[i].face) == first.size()) first.push_back(i);
    const Mat3 out_from_source = transpose(source_from_out_);
    for (const Highlights::Sliver& sliver : source.highlights().slivers) {
      const Location at = out.layout->locate(out_from_source * sliver.direction);
      const Image& face = out.faces[static_cast<std::size_t>(at.face)];
      const DirectionJet jet = out.layout->direction_jet(at.face, at.u, at.v);
      const double side_u = length(jet.du) * texel_extent(face.width(), out.placement);
      const double side_v = length(jet.dv) * texel_extent(face.height(), out.placement);
      const double wanted = std::ceil(2 * std::max(side_u, side_v) / std::max(sliver.thin, 1e-9));
      const int samples = wanted < most_samples_a_side ? static_cast<int>(wanted) : most_samples_a_side;
      const auto range = [&](double x, double side, int n, int& low, int& high) {
        const double around = 1.5 + std::min(sliver.wide / std::max(side, 1e-9), farthest);
        low = std::clamp(static_cast<int>(std::floor(x - around + 0.5)), 0, n - 1);
        high = std::clamp(static_cast<int>(std::floor(x + around + 0.5)), 0, n - 1);
      };
      int left, right, top, bottom;
      range(texel_from_u(at.u, face.width(), out.placement), side_u, face.width(), left, right);
      range(texel_from_u(at.v, face.height(), out.placement), side_v, face.height(), top, bottom);
      const int across = (face.width() + tile_side_ - 1) / tile_side_;
      for (int y = top / tile_side_; y <= bottom / tile_side_; ++y)
        for (int x = left / tile_side_; x <= right / tile_side_; ++x) {
          const std::size_t i = first[static_cast<std::size_t>(at.face)] + static_cast<std::size_t>(y * across + x);
          if (!lights_[i]) lights_[i] = std::make_unique<TileHighlights>();
          const Tile& tile = tiles_[i];
          lights_[i]->slivers.add(left - tile.x0, top - tile.y0, right + 1 - tile.x0, bottom + 1 - tile.y0, tile);
          lights_[i]->sliver_samples = std::max(lights_[i]->sliver_samples, samples);
        }
    }
  }

  // Of the tile as it is now, while the cache holds it.
  void sum_tile(const EnvImage& out, std::size_t i) {
    const std::size_t count = sphere_sums(out.channels.count());
    double* sums = &tile_sums_[i * count];
    std::fill_n(sums, count, 0.0);
    add_to_sums(out, tiles_[i].face, tiles_[i].x0, tiles_[i].y0, tiles_[i].width, tiles_[i].height, sums);
  }
  SphereMean sum_of_tiles() const {
    std::vector<double> sums(tile_sums_.size() / tiles_.size(), 0.0);
    for (std::size_t i = 0; i < tile_sums_.size(); ++i) sums[i % sums.size()] += tile_sums_[i];
    return mean_of_sums(sums);
  }

  void run_group(Source& source, EnvImage& out, int first_channel) {
    mark_slivers(source, out);
    const bool sum = filter_.limited && source_.channels.count() <= 4;
    tile_sums_.assign(sum ? tiles_.size() * sphere_sums(out.channels.count()) : 0, 0.0);
    const std::size_t most_blocks = SourceBlocks::worth_keeping(source_, filter_.kernel, block_memory);
    tbb::enumerable_thread_specific<std::unique_ptr<Workspace>> workspaces(
        [&] { return std::make_unique<Workspace>(source, filter_.kernel, most_blocks); });
    std::atomic<std::size_t> done{0};
    TileSampler sampler(source_, source, first_channel, out, source_from_out_, filter_, options_, tables_);
    tbb::parallel_for(std::size_t{0}, order_.size(), [&](std::size_t k) {
      if (stopped_) return;
      const std::size_t i = order_[k];
      sampler.first_pass(*workspaces.local(), tiles_[i], lights_[i]);
      if (sum && !lights_[i]) sum_tile(out, i);
      if (options_.progress && !options_.progress(share_done_ + share_step_ * static_cast<double>(++done) /
                                                                    static_cast<double>(tiles_.size())))
        stopped_ = true;
    });
    if (!source.highlights().any() || stopped_) return;
    const std::vector<StrandedEnergy> stranded = source.conserve_highlights();
    tbb::parallel_for(std::size_t{0}, tiles_.size(), [&](std::size_t i) {
      if (!lights_[i]) return;
      sampler.second_pass(*workspaces.local(), tiles_[i], *lights_[i]);
      if (sum) sum_tile(out, i);
    });
    for (const StrandedEnergy& e : stranded) deposit(e, out, first_channel);
    if (!stranded.empty()) tile_sums_.clear();
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

  const EnvImage& source_;
  EnvImage* used_up_;
  const ResampleOptions& options_;
  const Filter filter_;
  Mat3 source_from_out_;
  std::vector<Tile> tiles_;
  std::vector<std::uint32_t> order_;                     // in which tiles are taken up
  std::vector<std::unique_ptr<TileHighlights>> lights_;  // by tile; those that see none have none
  std::vector<double> tile_sums_;  // by tile: sphere_sums() each; empty when they are not up to date
  int tile_side_ = largest_tile;
  GridTables tables_;
  std::atomic<bool> stopped_{false};
  double share_done_ = 0, share_step_ = 1;
};

Result<EnvImage> resampled(const EnvImage& source, EnvImage* used_up, const ResampleOptions& options,
                           EnvImage recycled) {
  if (!source.layout || static_cast<int>(source.faces.size()) != source.layout->face_count() ||
      source.channels.count() == 0)
    return Error{ErrorCode::unsupported, "the source has no pixels"};
  if (!options.layout || options.height < 1) return Error{ErrorCode::usage, "no output layout or size"};
  if (options.height > tallest_face) return Error{ErrorCode::limit, "the output has too many texels"};
  try {
    Resampler resampler(source, used_up, options);
    // More than there are cores gain nothing, and make TBB print.
    const int cores = tbb::info::default_concurrency();
    tbb::task_arena arena(options.threads > 0 ? std::min(options.threads, cores) : cores);
    return arena.execute([&] { return resampler.run(std::move(recycled)); });
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::limit, "not enough memory to resample (about " +
                                       std::to_string(resample_bytes(source, options, used_up) >> 20) +
                                       " MiB are needed)"};
  } catch (const std::length_error& error) {
    return Error{ErrorCode::limit, error.what()};
  }
}

}  // namespace

Result<EnvImage> resample(const EnvImage& source, const ResampleOptions& options, EnvImage recycled) {
  return resampled(source, nullptr, options, std::move(recycled));
}

Result<EnvImage> resample(EnvImage&& source, const ResampleOptions& options, EnvImage recycled) {
  return resampled(source, &source, options, std::move(recycled));
}

std::size_t resample_bytes(const EnvImage& source, const ResampleOptions& options, bool used_up) {
  const std::size_t out = static_cast<std::size_t>(texel_count(*options.layout, options.height)) *
                          static_cast<std::size_t>(source.channels.count()) * sizeof(float);
  const Filter filter = filter_of(source, options);
  if (Resampler(source, nullptr, options).is_copy()) return used_up ? 0 : out;
  // Strips around the faces, and a copy where pixels cannot be read in place.
  const int apron = apron_width(filter.kernel) + 8;
  const bool in_place = (source.channels.count() == 3 || source.channels.count() == 4) &&
                        (used_up || source.layout->info().domain == Domain::square);
  std::size_t strips = 0, copy = 0;
  for (const Image& face : source.faces) {
    strips += static_cast<std::size_t>(face.width() + face.height()) * 4 * static_cast<std::size_t>(apron);
    copy += in_place ? 0 : face.pixel_count();
  }
  const std::size_t blocks = is_prefiltered(filter.kernel)
                                 ? SourceBlocks::worth_keeping(source, filter.kernel, block_memory) *
                                       SourceBlocks::bytes(filter.kernel, source.channels.count() == 3 ? 3 : 4)
                                 : 0;
  const auto cores = static_cast<std::size_t>(std::max(1, tbb::info::default_concurrency()));
  const std::size_t threads = options.threads > 0 ? std::min(cores, static_cast<std::size_t>(options.threads)) : cores;
  // Of each thread, besides its blocks: rows of samples, and a view of the common size.
  const std::size_t work = std::size_t{is_prefiltered(filter.kernel) ? 2u : 1u} << 19;
  // Highlights, of which there may be more, and which texels are owned, where not all are.
  const std::size_t rest = (filter.limited ? source.texel_count() * Highlights::usual_bytes : 0) +
                           (source.layout->info().domain == Domain::square ? 0 : source.texel_count());
  return out + (strips + copy) * 4 * sizeof(float) + rest + threads * (blocks + work);
}

}  // namespace envconv
