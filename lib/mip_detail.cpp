// SPDX-License-Identifier: Apache-2.0
#include "mip_detail.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "analyze.h"
#include "assertion.h"
#include "face_reader.h"
#include "solid_angle.h"

namespace envconv {
namespace {

constexpr double limit_over_mean = 4.0;  // brightness beyond which a highlight is left to the box
constexpr int finer = 3;                 // levels between a level and the one whose texels sample its kernel
constexpr int finer_on_sphere = 2;       // the same for the smallest levels, where every pair of texels is looked at
constexpr int table_steps = 512;         // of the kernel's table, in a texel
constexpr double least_weight = 0.25;    // of a kernel's sum over the box's: below it the kernel sees too little

double sinc(double t) { return t == 0 ? 1 : std::sin(M_PI * t) / (M_PI * t); }
double triangle(double t) { return 1 - std::abs(t); }
double lanczos3(double t) { return sinc(t) * sinc(t / 3); }
// beta 4: the stop band of Kaiser-windowed texture tools (Blinn, Dirty Pixels, 1998).
double kaiser3(double t) {
  const double r = t / 3;
  return sinc(t) * std::cyl_bessel_i(0.0, 4 * std::sqrt(std::max(0.0, 1 - r * r))) / std::cyl_bessel_i(0.0, 4.0);
}

}  // namespace

std::span<const MipFilter> all_mip_filters() {
  static constexpr MipFilter filters[] = {
      {.name = "box", .note = "exact mean over each texel's own footprint"},
      {.name = "triangle", .note = "two texels wide: the softest", .radius = 1, .kernel = triangle},
      {.name = "kaiser", .note = "sinc under a Kaiser window, six texels wide: sharp", .radius = 3, .kernel = kaiser3},
      {.name = "lanczos",
       .note = "sinc of three lobes, six texels wide: the sharpest",
       .radius = 3,
       .kernel = lanczos3},
  };
  return filters;
}

const MipFilter* find_mip_filter(std::string_view name) {
  for (const MipFilter& f : all_mip_filters())
    if (f.name == name) return &f;
  return nullptr;
}

// Cells of one face and beyond its edges: density x channels, then the density itself.
struct MipDetail::Grown {
  int width = 0, rows = 0, apron_x = 0, apron_y = 0;
  std::size_t values = 0;  // in a cell
  std::vector<float> cells;
  float* at(int x, int y) {
    return &cells[(static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)) *
                  values];
  }
};

// For each texel of a level the cells along one axis that it takes, and their weights.
struct MipDetail::Kernel {
  std::vector<int> first, count;
  std::vector<float> weights;  // those of texel i from i * most on
  int most = 0;

  // `cells` finer texels, after an apron; a null kernel is the texel's own footprint.
  Kernel(int texels, int cells, Placement placement, int apron, double (*kernel)(double), double radius) {
    const double ratio = texel_extent(texels, placement) / texel_extent(cells, placement);
    const double begin = texel_from_u(0, cells, placement), end = texel_from_u(1, cells, placement);
    most = static_cast<int>(std::ceil(2 * radius * ratio)) + 2;
    weights.assign(static_cast<std::size_t>(texels) * static_cast<std::size_t>(most), 0.0f);
    for (int i = 0; i < texels; ++i) {
      const double centre = texel_from_u(u_from_texel(i, texels, placement), cells, placement);
      const int from = static_cast<int>(std::floor(centre - radius * ratio + 0.5 - 1e-9));
      float* w = &weights[static_cast<std::size_t>(i) * static_cast<std::size_t>(most)];
      int n = 0;
      for (int x = from; x <= centre + radius * ratio + 0.5 - 1e-9 && n < most; ++x, ++n) {
        const double t = (x - centre) / ratio;
        if (kernel)
          w[n] = std::abs(t) < radius ? static_cast<float>(kernel(t)) : 0.0f;
        else
          w[n] = static_cast<float>(std::max(
              0.0, std::min({x + 0.5, centre + 0.5 * ratio, end}) - std::max({x - 0.5, centre - 0.5 * ratio, begin})));
      }
      first.push_back(from + apron);
      count.push_back(n);
    }
  }
  const float* of(int i) const { return &weights[static_cast<std::size_t>(i) * static_cast<std::size_t>(most)]; }
};

MipDetail::MipDetail(const EnvImage& level0, std::vector<EnvImage>& levels,
                     const std::vector<std::vector<std::vector<double>>>& omega, const MipFilter& filter)
    : level0_(level0), levels_(levels), omega_(omega), filter_(filter) {
  const auto channels = static_cast<std::size_t>(level0.channels.count());
  lowest_.assign(channels, std::numeric_limits<float>::max());
  for (const Image& face : level0.faces)
    for (int y = 0; y < face.height(); ++y) {
      const float* v = face.row(y);
      for (int x = 0; x < face.width(); ++x)
        for (std::size_t c = 0; c < channels; ++c, ++v) lowest_[c] = std::min(lowest_[c], *v);
    }
  const Layout& layout = *level0.layout;
  for (std::size_t f = 0; f < level0.faces.size() && layout.info().domain != Domain::square; ++f) {
    const Image& face = level0.faces[f];
    std::vector<double>& own = owned_.emplace_back(face.pixel_count());
    tbb::parallel_for(0, face.height(), [&](int y) {
      for (int x = 0; x < face.width(); ++x)
        own[static_cast<std::size_t>(y) * static_cast<std::size_t>(face.width()) + static_cast<std::size_t>(x)] =
            layout.owns(static_cast<int>(f), u_from_texel(x, face.width(), level0.placement),
                        u_from_texel(y, face.height(), level0.placement));
    });
  }
  for (int i = 0; i <= filter.radius * table_steps; ++i)
    table_.push_back(filter.kernel(static_cast<double>(i) / table_steps));
  // Level 1 has level 0's mean exactly; brightness is looked at where there are few texels left.
  mean_.assign(channels, 0.0);
  double total = 0;
  for (std::size_t f = 0; f < level0.faces.size(); ++f) {
    const float* v = levels[0].faces[f].data();
    for (const double w : omega[0][f]) {
      total += w;
      for (std::size_t c = 0; c < channels; ++c) mean_[c] += w * static_cast<double>(*v++);
    }
  }
  for (double& m : mean_) m /= total;
  const std::size_t coarse = std::min<std::size_t>(2, levels.size() - 1);
  limit_ = std::numeric_limits<double>::max();
  for (int step = 0; step < 20; ++step) {
    double sum = 0;
    for (std::size_t f = 0; f < level0.faces.size(); ++f) {
      const float* v = levels[coarse].faces[f].data();
      for (const double w : omega[coarse][f]) {
        double brightness = 0;
        for (std::size_t c = 0; c < channels; ++c, ++v)
          if (static_cast<int>(c) != level0.channels.alpha)
            brightness = std::max(brightness, std::abs(static_cast<double>(*v)));
        sum += w * std::min(brightness, limit_);
      }
    }
    limit_ = limit_over_mean * sum / total;
  }
}

double MipDetail::kernel_at(double t) const {
  t = std::abs(t) * table_steps;
  const auto i = static_cast<std::size_t>(t);
  return i + 1 < table_.size() ? table_[i] + (t - static_cast<double>(i)) * (table_[i + 1] - table_[i]) : 0;
}

float MipDetail::limit_factor(const float* texel) const {
  double brightness = 0;
  for (int c = 0; c < level0_.channels.count(); ++c)
    if (c != level0_.channels.alpha) brightness = std::max(brightness, std::abs(static_cast<double>(texel[c])));
  return brightness > limit_ ? static_cast<float>(limit_ / brightness) : 1.0f;
}

void MipDetail::read(int k, const Location& at, double* value) const {
  if (k > 0 || owned_.empty()) return read_clamped(level(k), at, value);
  const auto f = static_cast<std::size_t>(at.face);
  const Image& face = level0_.faces[f];
  read_owned(face, owned_[f], texel_from_u(at.u, face.width(), level0_.placement),
             texel_from_u(at.v, face.height(), level0_.placement), value);
}

MipDetail::Grown MipDetail::grow(int k, int f, int apron_x, int apron_y) const {
  const EnvImage& image = level(k);
  const Layout& layout = *image.layout;
  const Image& face = image.faces[static_cast<std::size_t>(f)];
  const int channels = face.channels(), alpha = image.channels.alpha;
  Grown grown;
  grown.apron_x = apron_x, grown.apron_y = apron_y;
  grown.width = face.width() + 2 * apron_x, grown.rows = face.height() + 2 * apron_y;
  grown.values = static_cast<std::size_t>(channels) + 1;
  grown.cells.resize(static_cast<std::size_t>(grown.width) * static_cast<std::size_t>(grown.rows) * grown.values);
  // Cells on an edge are whole here: what lies beyond it is read too.  All cells are alike in u and v, so their density
  // is their weight; it varies slowly, and is taken at every so many of them, in units of its mean.
  const int step = std::max(1, std::min(face.width(), face.height()) / 64);
  const double unit = layout.face_count() / (4 * M_PI);
  const int across = grown.width / step + 2;
  const auto column = [&](int x) { return u_from_texel(x - apron_x, face.width(), image.placement); };
  const auto row = [&](int y) { return u_from_texel(y - apron_y, face.height(), image.placement); };
  std::vector<float> density(static_cast<std::size_t>(across) * static_cast<std::size_t>(grown.rows / step + 2));
  tbb::parallel_for(0, grown.rows / step + 2, [&](int y) {
    for (int x = 0; x < across; ++x)
      density[static_cast<std::size_t>(y) * static_cast<std::size_t>(across) + static_cast<std::size_t>(x)] =
          static_cast<float>(unit * layout.density(f, column(x * step), row(y * step)));
  });
  constexpr int band = 32;
  tbb::parallel_for(0, (grown.rows + band - 1) / band, [&](int b) {
    const int y0 = b * band, y1 = std::min(y0 + band, grown.rows);
    std::vector<double> value(static_cast<std::size_t>(channels));
    std::vector<float> texel(static_cast<std::size_t>(channels));
    for (int y = y0; y < y1; ++y)
      for (int x = 0; x < grown.width; ++x) {
        const int i = x - apron_x, j = y - apron_y;
        const bool inside = i >= 0 && i < face.width() && j >= 0 && j < face.height();
        if (inside &&
            (k > 0 || owned_.empty() ||
             owned_[static_cast<std::size_t>(f)][static_cast<std::size_t>(j) * static_cast<std::size_t>(face.width()) +
                                                 static_cast<std::size_t>(i)] > 0)) {
          std::copy_n(face.at(i, j), channels, texel.begin());
        } else {
          const Vec3 d = layout.direction(f, column(x), row(y));
          read(k, layout.locate(d), value.data());
          std::transform(value.begin(), value.end(), texel.begin(), [](double v) { return static_cast<float>(v); });
        }
        const float* corner = &density[static_cast<std::size_t>(y / step) * static_cast<std::size_t>(across) +
                                       static_cast<std::size_t>(x / step)];
        const float s = static_cast<float>(x % step) / static_cast<float>(step);
        const float t = static_cast<float>(y % step) / static_cast<float>(step);
        const float weight =
            (1 - t) * ((1 - s) * corner[0] + s * corner[1]) + t * ((1 - s) * corner[across] + s * corner[across + 1]);
        const float limited = weight * limit_factor(texel.data());
        float* to = grown.at(x, y);
        for (int c = 0; c < channels; ++c) to[c] = (c == alpha ? weight : limited) * texel[static_cast<std::size_t>(c)];
        to[channels] = weight;
      }
  });
  return grown;
}

void MipDetail::add_difference(EnvImage& image, int f, int i, int j, const double* wide, double wide_weight,
                               const double* box, double box_weight) const {
  if (!(box_weight > 0) || !(wide_weight > least_weight * box_weight)) return;
  float* to = image.faces[static_cast<std::size_t>(f)].at(i, j);
  for (int c = 0; c < image.channels.count(); ++c)
    to[c] += static_cast<float>(wide[c] / wide_weight - box[c] / box_weight);
}

void MipDetail::add_to_face(int to, int from, int f) {
  EnvImage& image = levels_[static_cast<std::size_t>(to - 1)];
  const Image& face = image.faces[static_cast<std::size_t>(f)];
  const Image& source = level(from).faces[static_cast<std::size_t>(f)];
  const Placement placement = image.placement;
  const auto apron = [&](int texels, int cells) {
    return static_cast<int>(
               std::ceil(filter_.radius * texel_extent(texels, placement) / texel_extent(cells, placement))) +
           2;
  };
  const int apron_x = apron(face.width(), source.width()), apron_y = apron(face.height(), source.height());
  Grown grown = grow(from, f, apron_x, apron_y);
  const auto kernel = [&](int texels, int cells, int margin, bool wide) {
    return Kernel(texels, cells, placement, margin, wide ? filter_.kernel : nullptr, wide ? filter_.radius : 0.5);
  };
  const Kernel columns[2] = {kernel(face.width(), source.width(), apron_x, false),
                             kernel(face.width(), source.width(), apron_x, true)};
  const Kernel rows[2] = {kernel(face.height(), source.height(), apron_y, false),
                          kernel(face.height(), source.height(), apron_y, true)};
  const std::size_t values = grown.values, line = static_cast<std::size_t>(face.width()) * values;
  // Along rows, the box in front and the wide kernel after it; then along columns.
  std::vector<float> halfway(2 * line * static_cast<std::size_t>(grown.rows));
  tbb::parallel_for(0, grown.rows, [&](int y) {
    float* out = &halfway[2 * line * static_cast<std::size_t>(y)];
    for (const Kernel& k : columns)
      for (int i = 0; i < face.width(); ++i, out += values) {
        const float* w = k.of(i);
        const float* cell = grown.at(k.first[static_cast<std::size_t>(i)], y);
        for (int n = 0; n < k.count[static_cast<std::size_t>(i)]; ++n, cell += values)
          for (std::size_t c = 0; c < values; ++c) out[c] += w[n] * cell[c];
      }
  });
  tbb::parallel_for(0, face.height(), [&](int j) {
    std::vector<double> sum[2];
    for (std::size_t which = 0; which < 2; ++which) {
      const Kernel& k = rows[which];
      sum[which].assign(line, 0.0);
      for (int n = 0; n < k.count[static_cast<std::size_t>(j)]; ++n) {
        const auto w = static_cast<double>(k.of(j)[n]);
        const float* from_row =
            &halfway[(2 * static_cast<std::size_t>(k.first[static_cast<std::size_t>(j)] + n) + which) * line];
        for (std::size_t x = 0; x < line; ++x) sum[which][x] += w * static_cast<double>(from_row[x]);
      }
    }
    for (int i = 0; i < face.width(); ++i) {
      const std::size_t x = static_cast<std::size_t>(i) * values;
      add_difference(image, f, i, j, &sum[1][x], sum[1][x + values - 1], &sum[0][x], sum[0][x + values - 1]);
    }
  });
}

// Levels so small that the kernel reaches around the sphere: every cell is placed in the plane that touches the sphere
// at the texel's centre, at its angle (azimuthal equidistant), and measured by the texel's sides there.
void MipDetail::add_on_sphere(int to, int from) {
  EnvImage& image = levels_[static_cast<std::size_t>(to - 1)];
  const EnvImage& source = level(from);
  const Layout& layout = *image.layout;
  const auto channels = static_cast<std::size_t>(image.channels.count());
  struct Cell {
    Vec3 d;
    int face;
    double u, v, weight;
    const float* texel;
  };
  std::vector<Cell> cells;
  for (int f = 0; f < layout.face_count(); ++f) {
    const Image& face = source.faces[static_cast<std::size_t>(f)];
    std::vector<double> own(face.pixel_count());
    texel_solid_angles(layout, f, {face.width(), face.height()}, image.placement, 0, 0, face.width(), face.height(),
                       own.data());
    for (int y = 0; y < face.height(); ++y)
      for (int x = 0; x < face.width(); ++x) {
        const double weight =
            own[static_cast<std::size_t>(y) * static_cast<std::size_t>(face.width()) + static_cast<std::size_t>(x)];
        if (!(weight > 0)) continue;
        const double u = u_from_texel(x, face.width(), image.placement),
                     v = u_from_texel(y, face.height(), image.placement);
        cells.push_back({layout.direction(f, u, v), f, u, v, weight, face.at(x, y)});
      }
  }
  for (int f = 0; f < layout.face_count(); ++f) {
    const Image& face = image.faces[static_cast<std::size_t>(f)];
    const double width = texel_extent(face.width(), image.placement),
                 height = texel_extent(face.height(), image.placement);
    tbb::parallel_for(0, face.width() * face.height(), [&](int index) {
      const int i = index % face.width(), j = index / face.width();
      const double u = u_from_texel(i, face.width(), image.placement),
                   v = u_from_texel(j, face.height(), image.placement);
      const DirectionJet jet = layout.direction_jet(f, u, v);
      const Vec3 a = width * jet.du, b = height * jet.dv;
      const double aa = dot(a, a), ab = dot(a, b), bb = dot(b, b), det = aa * bb - ab * ab;
      if (!(det > 1e-6 * aa * bb)) return;  // on a singular point there are no sides
      std::vector<double> wide(channels), box(channels);
      double wide_weight = 0, box_weight = 0;
      for (const Cell& cell : cells) {
        const Vec3 across = cell.d - dot(cell.d, jet.d) * jet.d;
        const double sine = length(across), angle = std::atan2(sine, dot(cell.d, jet.d));
        const double scale = sine > 1e-12 ? angle / sine : 1;
        const double pa = scale * dot(across, a), pb = scale * dot(across, b);
        const double s = (bb * pa - ab * pb) / det, t = (aa * pb - ab * pa) / det;
        const bool inside = cell.face == f && std::abs(cell.u - u) < 0.5 * width && std::abs(cell.v - v) < 0.5 * height;
        const double w = kernel_at(s) * kernel_at(t) * cell.weight;
        if (w == 0 && !inside) continue;
        const auto factor = static_cast<double>(limit_factor(cell.texel));
        for (std::size_t c = 0; c < channels; ++c) {
          const double value =
              static_cast<double>(cell.texel[c]) * (static_cast<int>(c) == image.channels.alpha ? 1 : factor);
          wide[c] += w * value;
          if (inside) box[c] += cell.weight * value;
        }
        wide_weight += w;
        if (inside) box_weight += cell.weight;
      }
      add_difference(image, f, i, j, wide.data(), wide_weight, box.data(), box_weight);
    });
  }
}

// Negative lobes end at the source's floor, and a gain gives back what the mean has lost.
void MipDetail::finish(int k) {
  EnvImage& image = levels_[static_cast<std::size_t>(k - 1)];
  const std::size_t channels = mean_.size();
  std::vector<double> value(channels), magnitude(channels);
  double total = 0;
  for (std::size_t f = 0; f < image.faces.size(); ++f) {
    float* v = image.faces[f].data();
    for (const double w : omega_[static_cast<std::size_t>(k - 1)][f]) {
      total += w;
      for (std::size_t c = 0; c < channels; ++c, ++v) {
        *v = std::max(*v, std::min(lowest_[c], 0.0f));
        value[c] += w * static_cast<double>(*v);
        magnitude[c] += w * static_cast<double>(std::abs(*v));
      }
    }
  }
  for (std::size_t c = 0; c < channels; ++c) {
    if (!(magnitude[c] > 0)) continue;
    const double share = (mean_[c] * total - value[c]) / magnitude[c];
    for (Image& face : image.faces)
      for (std::size_t i = c; i < face.value_count(); i += channels)
        face.data()[i] += static_cast<float>(share * static_cast<double>(std::abs(face.data()[i])));
  }
}

void MipDetail::add_to(int to) {
  const EnvImage& image = levels_[static_cast<std::size_t>(to - 1)];
  bool small = false;
  for (const Image& face : image.faces)
    small = small || filter_.radius * texel_extent(std::min(face.width(), face.height()), image.placement) > 0.5;
  if (small)
    add_on_sphere(to, std::max(0, to - finer_on_sphere));
  else
    for (int f = 0; f < image.layout->face_count(); ++f) add_to_face(to, std::max(0, to - finer), f);
  finish(to);
}

}  // namespace envconv
