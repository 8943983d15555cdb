// SPDX-License-Identifier: Apache-2.0
// A level is made from the nearest level whose texels' bounds are a refinement of its own: the solid angles and means
// of that one are exact, so theirs are too.  Where sizes don't divide, that is level 0 itself, cut by the level's
// bounds into pieces.
#include "mip.h"

#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <new>

#include "assertion.h"
#include "face_reader.h"
#include "mip_detail.h"
#include "solid_angle.h"

namespace envconv {
namespace {

// Both axes of a face cut by the bounds of the source's texels and of the target's: for each piece its texel in both.
struct Cuts {
  std::vector<double> bounds;
  std::vector<int> source, target;
  std::vector<int> first;  // index of each target texel's first piece; one more at the end
};

constexpr double same_bound = 1e-12;

bool refines(const std::vector<double>& fine, const std::vector<double>& coarse) {
  std::size_t i = 0;
  for (const double bound : coarse) {
    while (i < fine.size() && fine[i] < bound - same_bound) ++i;
    if (i == fine.size() || fine[i] > bound + same_bound) return false;
  }
  return true;
}

Cuts cut(const std::vector<double>& source, const std::vector<double>& target) {
  Cuts cuts;
  cuts.bounds.push_back(source.front());
  std::size_t s = 0, t = 0;
  while (s + 1 < source.size() && t + 1 < target.size()) {
    const double end = std::min(source[s + 1], target[t + 1]);
    if (t == cuts.first.size()) cuts.first.push_back(static_cast<int>(cuts.source.size()));
    cuts.bounds.push_back(end);
    cuts.source.push_back(static_cast<int>(s));
    cuts.target.push_back(static_cast<int>(t));
    if (source[s + 1] <= end + same_bound) ++s;
    if (target[t + 1] <= end + same_bound) ++t;
  }
  cuts.first.push_back(static_cast<int>(cuts.source.size()));
  ENVCONV_ASSERT(cuts.first.size() == target.size());
  return cuts;
}

// sum[target] += w v, total[target] += w, over a row of pieces.
template <std::size_t channels>
void add_pieces(const float* texels, const double* w, const Cuts& columns, double* sum, double* total) {
  for (std::size_t i = 0; i < columns.source.size(); ++i) {
    if (w[i] == 0) continue;  // what owns nothing may hold anything, NaN included
    const float* v = texels + channels * static_cast<std::size_t>(columns.source[i]);
    const auto t = static_cast<std::size_t>(columns.target[i]);
    for (std::size_t c = 0; c < channels; ++c) sum[channels * t + c] += w[i] * static_cast<double>(v[c]);
    total[t] += w[i];
  }
}

void add_pieces(const float* texels, const double* w, const Cuts& columns, std::size_t channels, double* sum,
                double* total) {
  switch (channels) {
    case 1: return add_pieces<1>(texels, w, columns, sum, total);
    case 3: return add_pieces<3>(texels, w, columns, sum, total);
    case 4: return add_pieces<4>(texels, w, columns, sum, total);
    default: break;
  }
  for (std::size_t i = 0; i < columns.source.size(); ++i) {
    if (w[i] == 0) continue;
    const float* v = texels + channels * static_cast<std::size_t>(columns.source[i]);
    const auto t = static_cast<std::size_t>(columns.target[i]);
    for (std::size_t c = 0; c < channels; ++c) sum[channels * t + c] += w[i] * static_cast<double>(v[c]);
    total[t] += w[i];
  }
}

class Chain {
 public:
  Chain(const EnvImage& level0, const MipFilter& filter) : level0_(level0), filter_(filter) {}

  std::vector<EnvImage> make(int count) {
    for (int level = 1; level < count; ++level) add_box_level(level);
    if (filter_.kernel && count > 1) {
      // From the coarsest on, since details are taken from finer levels' box means.
      MipDetail detail(level0_, levels_, omega_, filter_);
      for (int level = count - 1; level >= 1; --level) detail.add_to(level);
      for (int level = 1; level < count; ++level) fill_unowned(level);
    }
    return std::move(levels_);
  }

 private:
  const EnvImage& level(int k) const { return k == 0 ? level0_ : levels_[static_cast<std::size_t>(k - 1)]; }

  std::vector<double> bounds(int k, std::size_t face, bool across) const {
    const Image& image = level(k).faces[face];
    return texel_bounds(across ? image.width() : image.height(), level0_.placement);
  }

  void add_box_level(int k) {
    EnvImage out;
    out.layout = level0_.layout;
    out.placement = level0_.placement;
    out.consumer_from_world = level0_.consumer_from_world;
    out.channels = level0_.channels;
    for (const Image& face : level0_.faces) {
      const Size size = level_size({face.width(), face.height()}, k);
      out.faces.push_back(face.sibling(size.width, size.height, face.channels()));
    }
    levels_.push_back(std::move(out));
    omega_.emplace_back();
    for (std::size_t f = 0; f < level0_.faces.size(); ++f) {
      const std::vector<double> columns = bounds(k, f, true), rows = bounds(k, f, false);
      int from = k - 1;
      while (from > 0 && !(refines(bounds(from, f, true), columns) && refines(bounds(from, f, false), rows))) --from;
      reduce(from, k, f, columns, rows);
    }
    fill_unowned(k);
  }

  void reduce(int from, int to, std::size_t f, const std::vector<double>& column_bounds,
              const std::vector<double>& row_bounds) {
    const Image& source = level(from).faces[f];
    Image& target = levels_[static_cast<std::size_t>(to - 1)].faces[f];
    const Cuts columns = cut(bounds(from, f, true), column_bounds), rows = cut(bounds(from, f, false), row_bounds);
    const std::size_t pieces = columns.source.size(), width = static_cast<std::size_t>(target.width());
    const auto channels = static_cast<std::size_t>(target.channels());
    std::vector<double>& omega = omega_[static_cast<std::size_t>(to - 1)].emplace_back(target.pixel_count());
    // A band holds enough rows of pieces for solid angles to be computed in blocks.
    const int per_row = std::max(1, static_cast<int>(rows.source.size()) / target.height());
    const int band = std::clamp(32 / per_row, 1, target.height());
    tbb::parallel_for(0, (target.height() + band - 1) / band, [&](int b) {
      const int first = b * band, end = std::min(first + band, target.height());
      const int row0 = rows.first[static_cast<std::size_t>(first)], row1 = rows.first[static_cast<std::size_t>(end)];
      std::vector<double> computed;
      if (from == 0) {
        computed.resize(pieces * static_cast<std::size_t>(row1 - row0));
        const std::span<const double> v(&rows.bounds[static_cast<std::size_t>(row0)],
                                        static_cast<std::size_t>(row1 - row0) + 1);
        cell_solid_angles(*level0_.layout, static_cast<int>(f), columns.bounds, v, true, computed.data());
      }
      std::vector<double> sum(width * channels), total(width);
      for (int j = first; j < end; ++j) {
        std::fill(sum.begin(), sum.end(), 0.0);
        std::fill(total.begin(), total.end(), 0.0);
        for (int r = rows.first[static_cast<std::size_t>(j)]; r < rows.first[static_cast<std::size_t>(j) + 1]; ++r) {
          const int y = rows.source[static_cast<std::size_t>(r)];
          const double* w = from == 0
                                ? &computed[static_cast<std::size_t>(r - row0) * pieces]
                                : &omega_[static_cast<std::size_t>(from - 1)][f][static_cast<std::size_t>(y) * pieces];
          add_pieces(source.row(y), w, columns, channels, sum.data(), total.data());
        }
        float* out = target.row(j);
        for (std::size_t i = 0; i < width; ++i)
          for (std::size_t c = 0; c < channels; ++c)
            *out++ = total[i] > 0 ? static_cast<float>(sum[i * channels + c] / total[i]) : 0.0f;
        std::copy(total.begin(), total.end(), omega.begin() + static_cast<std::ptrdiff_t>(width) * j);
      }
    });
  }

  // What stands for a direction that another texel owns is read there; beyond a disc everything stands for the one
  // point of the sphere that the rim is.
  void fill_unowned(int k) {
    const Domain domain = level0_.layout->info().domain;
    if (domain == Domain::square) return;
    EnvImage& image = levels_[static_cast<std::size_t>(k - 1)];
    const auto& omega = omega_[static_cast<std::size_t>(k - 1)];
    for (int f = 0; f < image.layout->face_count(); ++f) {
      Image& face = image.faces[static_cast<std::size_t>(f)];
      const std::vector<double>& own = omega[static_cast<std::size_t>(f)];
      const std::vector<double> rim = domain == Domain::disc ? rim_radiance(image, k, f) : std::vector<double>{};
      tbb::parallel_for(0, face.height(), [&](int j) {
        std::vector<double> value = rim;
        value.resize(static_cast<std::size_t>(face.channels()));
        for (int i = 0; i < face.width(); ++i) {
          if (own[static_cast<std::size_t>(j) * static_cast<std::size_t>(face.width()) + static_cast<std::size_t>(i)] >
              0)
            continue;
          if (domain == Domain::overlap)
            read_at(image, k,
                    image.layout->locate(image.layout->direction(f, u_from_texel(i, face.width(), image.placement),
                                                                 u_from_texel(j, face.height(), image.placement))),
                    value.data());
          std::transform(value.begin(), value.end(), face.at(i, j), [](double v) { return static_cast<float>(v); });
        }
      });
    }
  }

  // From texels that own something only.
  void read_at(const EnvImage& image, int k, const Location& at, double* value) const {
    const Image& owner = image.faces[static_cast<std::size_t>(at.face)];
    read_owned(owner, omega_[static_cast<std::size_t>(k - 1)][static_cast<std::size_t>(at.face)],
               texel_from_u(at.u, owner.width(), image.placement), texel_from_u(at.v, owner.height(), image.placement),
               value);
  }

  // Mean around a disc's rim.
  std::vector<double> rim_radiance(const EnvImage& image, int k, int f) const {
    const int channels = image.channels.count(), points = 4 * image.faces[static_cast<std::size_t>(f)].width();
    std::vector<double> sum(static_cast<std::size_t>(channels)), value(static_cast<std::size_t>(channels));
    for (int p = 0; p < points; ++p) {
      const double angle = 2 * M_PI * p / points;
      read_at(image, k, {f, 0.5 + 0.5 * std::cos(angle), 0.5 + 0.5 * std::sin(angle)}, value.data());
      for (std::size_t c = 0; c < sum.size(); ++c) sum[c] += value[c] / points;
    }
    return sum;
  }

  const EnvImage& level0_;
  const MipFilter& filter_;
  std::vector<EnvImage> levels_;                         // from level 1 on
  std::vector<std::vector<std::vector<double>>> omega_;  // of the same: [level - 1][face][texel]
};

}  // namespace

Size level_size(Size level0, int level) {
  const int shift = std::min(level, 31);
  return {std::max(1, level0.width >> shift), std::max(1, level0.height >> shift)};
}

int level_count(const Layout& layout, int height) {
  int largest = 1;
  for (int f = 0; f < layout.face_count(); ++f) {
    const Size size = face_size(layout, f, height);
    largest = std::max({largest, size.width, size.height});
  }
  int count = 1;
  while (largest >> count) ++count;
  return count;
}

Result<std::vector<EnvImage>> make_mips(const EnvImage& level0, const MipOptions& options) {
  if (!level0.layout || static_cast<int>(level0.faces.size()) != level0.layout->face_count() ||
      level0.channels.count() == 0)
    return Error{ErrorCode::usage, "there are no pixels to make levels of"};
  int largest = 1;
  for (const Image& face : level0.faces) largest = std::max({largest, face.width(), face.height()});
  int count = 1;
  while (largest >> count) ++count;
  if (options.levels > 0) count = std::min(count, options.levels);
  try {
    const int cores = tbb::info::default_concurrency();
    tbb::task_arena arena(options.threads > 0 ? std::min(options.threads, cores) : cores);
    return arena.execute(
        [&] { return Chain(level0, options.filter ? *options.filter : all_mip_filters().front()).make(count); });
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::limit, "not enough memory for the MIP levels"};
  }
}

std::size_t mip_bytes(const Layout& layout, int height, int channels, const MipOptions& options) {
  const int most = level_count(layout, height);
  const int count = options.levels > 0 ? std::min(options.levels, most) : most;
  const auto values = static_cast<std::size_t>(channels);
  std::size_t bytes = 0, largest_face = 0;
  for (int f = 0; f < layout.face_count(); ++f) {
    const Size size = face_size(layout, f, height);
    largest_face = std::max(largest_face, static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height));
    for (int k = 1; k < count; ++k) {
      const Size level = level_size(size, k);
      const auto texels = static_cast<std::size_t>(level.width) * static_cast<std::size_t>(level.height);
      bytes += texels * (values * sizeof(float) + sizeof(double));
    }
  }
  // One face with its apron, and that filtered along one axis.
  if (options.filter && options.filter->kernel && count > 1)
    bytes += largest_face * (values + 1) * sizeof(float) * 2 + largest_face * sizeof(double);
  return bytes;
}

}  // namespace envconv
