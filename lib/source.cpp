// SPDX-License-Identifier: Apache-2.0
#include "source.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "analyze.h"
#include "assertion.h"
#include "solid_angle.h"

namespace envconv {
namespace {

// 0.344^10 = 2e-5: how far a prefilter must run over true texels before its start is forgotten.
constexpr int prefilter_margin = 10;

// Pixel position whose fraction is a rounding error counts as the pixel itself.
constexpr double on_texel = 1e-6;

// Interpolating kernel for texels read from across seams: sinc under a Kaiser window (beta 7.5), eight taps.
constexpr int adopt_taps = 8;
std::array<float, adopt_taps> adopt_weights(double f) {
  std::array<double, adopt_taps> w;
  double sum = 0;
  for (int k = 0; k < adopt_taps; ++k) {
    const double t = k - (adopt_taps / 2 - 1) - f;
    const double r = t / (adopt_taps / 2);
    double value = 0;
    if (std::abs(r) < 1)
      value = std::cyl_bessel_i(0.0, 7.5 * std::sqrt(1 - r * r)) * (t == 0 ? 1.0 : std::sin(M_PI * t) / (M_PI * t));
    w[static_cast<std::size_t>(k)] = value;
    sum += value;
  }
  std::array<float, adopt_taps> out;
  for (std::size_t k = 0; k < adopt_taps; ++k) out[k] = static_cast<float>(w[k] / sum);
  return out;
}

// The same from a table: 1024 steps, linear between them.
struct AdoptTable {
  std::array<std::array<float, adopt_taps>, 1025> rows;
  AdoptTable() {
    for (std::size_t i = 0; i < rows.size(); ++i) rows[i] = adopt_weights(static_cast<double>(i) / 1024);
  }
  std::array<float, adopt_taps> at(double f) const {
    const double x = f * 1024;
    const std::size_t i = std::min<std::size_t>(static_cast<std::size_t>(x), 1023);
    const float t = static_cast<float>(x - static_cast<double>(i));
    std::array<float, adopt_taps> w;
    for (std::size_t k = 0; k < adopt_taps; ++k) w[k] = rows[i][k] + t * (rows[i + 1][k] - rows[i][k]);
    return w;
  }
};

}  // namespace

int apron_width(Kernel kernel) {
  const int reach = taps(kernel) / 2 + 1;
  return kernel == Kernel::omoms ? prefilter_margin + reach : std::max(reach, 4);
}

Source::Source(const EnvImage& image, int first_channel, const Filter& filter)
    : layout_(image.layout), placement_(image.placement) {
  ENVCONV_ASSERT(image.faces.size() == layout_->info().faces.size() && first_channel < image.channels.count());
  apron_ = apron_width(filter.kernel);
  std::int64_t total = 0;
  std::int32_t blocks = 0;
  for (int f = 0; f < layout_->face_count(); ++f) {
    const Image& face = image.faces[static_cast<std::size_t>(f)];
    ENVCONV_ASSERT(!face.empty() && face.channels() == image.channels.count());
    SourceFace s;
    s.size = {face.width(), face.height()};
    s.pitch = s.size.width + 2 * apron_;
    s.rows = s.size.height + 2 * apron_;
    s.first = static_cast<std::int32_t>(total);
    total += static_cast<std::int64_t>(s.pitch) * s.rows;
    if (total > std::numeric_limits<std::int32_t>::max()) throw std::length_error("the source has too many texels");
    const auto affine = [&](int n, float& scale, float& bias) {
      bias = static_cast<float>(texel_from_u(0.0, n, placement_) + apron_);
      scale = static_cast<float>(texel_from_u(1.0, n, placement_) - texel_from_u(0.0, n, placement_));
    };
    affine(s.size.width, s.scale_u, s.bias_u);
    affine(s.size.height, s.scale_v, s.bias_v);
    s.blocks = (s.pitch + Highlights::side - 1) / Highlights::side;
    s.first_block = blocks;
    blocks += s.blocks * ((s.rows + Highlights::side - 1) / Highlights::side);
    faces_.push_back(s);
  }
  texels_ = Image(4, static_cast<int>(total), 1);  // one texel a "row": faces differ in width
  copy_texels(image, first_channel);
  highlights_.index.assign(static_cast<std::size_t>(blocks), -1);
  highlights_.reachable.assign(static_cast<std::size_t>(blocks), 0);
  if (filter.limited) {
    split_highlights();
    if (highlights_.any()) spread_highlights();
  }
  std::vector<Orphan> orphans;
  find_orphans(orphans);
  adopt(orphans);
  if (highlights_.any()) copy_highlights(orphans);
  if (filter.kernel == Kernel::omoms) prefilter();
}

SourceView Source::view() const {
  SourceView view;
  ENVCONV_ASSERT(faces_.size() <= most_faces);
  view.texels = texels_.data();
  view.texel_count = static_cast<std::int64_t>(texels_.pixel_count());
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    const SourceFace& s = faces_[f];
    view.scale_u[f] = s.scale_u, view.bias_u[f] = s.bias_u;
    view.scale_v[f] = s.scale_v, view.bias_v[f] = s.bias_v;
    view.first[f] = s.first, view.pitch[f] = s.pitch;
  }
  return view;
}

void Source::copy_texels(const EnvImage& image, int first_channel) {
  std::fill_n(lowest_, 4, std::numeric_limits<float>::max());
  const int channels = image.channels.count();
  const int count = std::min(4, channels - first_channel);
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    const SourceFace& s = faces_[f];
    const Image& face = image.faces[f];
    std::vector<std::array<float, 4>> low(static_cast<std::size_t>(s.size.height));
    tbb::parallel_for(0, s.rows, [&](int y) {
      float* to = texels_.data() + 4 * (static_cast<std::size_t>(s.first) +
                                        static_cast<std::size_t>(y) * static_cast<std::size_t>(s.pitch));
      if (y < apron_ || y >= apron_ + s.size.height) {
        std::memset(to, 0, static_cast<std::size_t>(s.pitch) * 4 * sizeof(float));
        return;
      }
      std::memset(to, 0, static_cast<std::size_t>(apron_) * 4 * sizeof(float));
      to += 4 * apron_;
      const float* from = face.row(y - apron_) + first_channel;
      std::array<float, 4> lowest;
      lowest.fill(std::numeric_limits<float>::max());
      for (int x = 0; x < s.size.width; ++x, from += channels, to += 4) {
        for (int c = 0; c < count; ++c) {
          to[c] = from[c];
          lowest[static_cast<std::size_t>(c)] = std::min(lowest[static_cast<std::size_t>(c)], from[c]);
        }
        for (int c = count; c < 4; ++c) to[c] = 0;
      }
      std::memset(to, 0, static_cast<std::size_t>(apron_) * 4 * sizeof(float));
      low[static_cast<std::size_t>(y - apron_)] = lowest;
    });
    for (const auto& row : low)
      for (std::size_t c = 0; c < 4; ++c) lowest_[c] = std::min(lowest_[c], row[c]);
  }
}

void Source::find_orphans(std::vector<Orphan>& orphans) const {
  // Rows are searched in parallel, and their finds joined in order.
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    const SourceFace& s = faces_[f];
    std::vector<std::vector<Orphan>> rows(static_cast<std::size_t>(s.rows));
    const bool whole = layout_->info().domain == Domain::square;
    tbb::parallel_for(0, s.rows, [&](int y) {
      const bool inside_row = y >= apron_ && y < apron_ + s.size.height;
      for (int x = 0; x < s.pitch; ++x) {
        if (inside_row && whole && x == apron_) x += s.size.width;  // all owned
        const double u = u_from_texel(x - apron_, s.size.width, placement_);
        const double v = u_from_texel(y - apron_, s.size.height, placement_);
        if (inside_row && x >= apron_ && x < apron_ + s.size.width && layout_->owns(static_cast<int>(f), u, v))
          continue;
        const Location at = layout_->locate(layout_->direction(static_cast<int>(f), u, v));
        const SourceFace& o = faces_[static_cast<std::size_t>(at.face)];
        rows[static_cast<std::size_t>(y)].push_back({static_cast<std::int32_t>(f), x, y, at.face,
                                                     texel_from_u(at.u, o.size.width, placement_) + apron_,
                                                     texel_from_u(at.v, o.size.height, placement_) + apron_});
      }
    });
    for (const auto& row : rows) orphans.insert(orphans.end(), row.begin(), row.end());
  }
}

void Source::adopt(std::vector<Orphan>& orphans) {
  static const AdoptTable table;
  using Texel = std::array<float, 4>;
  float* texels = texels_.data();
  const auto texel = [&](int face, int x, int y) {
    const SourceFace& s = faces_[static_cast<std::size_t>(face)];
    ENVCONV_ASSERT(x >= 0 && x < s.pitch && y >= 0 && y < s.rows);
    return texels + 4 * (static_cast<std::size_t>(s.first) +
                         static_cast<std::size_t>(y) * static_cast<std::size_t>(s.pitch) + static_cast<std::size_t>(x));
  };
  // Taps may fall on orphans themselves, near seams' ends: the first pass takes the nearest owned texel, the next ones
  // refine.  Each pass reads the one before only, so that the order (and the thread count) does not matter.
  std::vector<bool> orphaned;
  if (layout_->info().domain != Domain::square) {
    orphaned.resize(texels_.pixel_count());
    for (const Orphan& o : orphans) {
      const SourceFace& s = faces_[static_cast<std::size_t>(o.face)];
      orphaned[static_cast<std::size_t>(s.first) + static_cast<std::size_t>(o.y) * static_cast<std::size_t>(s.pitch) +
               static_cast<std::size_t>(o.x)] = true;
    }
  }
  const auto nearest_owned = [&](const Orphan& o) -> const float* {
    const SourceFace& s = faces_[static_cast<std::size_t>(o.from_face)];
    const float* best = nullptr;
    double best_distance = 1e30;
    const int cx = static_cast<int>(std::lround(o.from_x)), cy = static_cast<int>(std::lround(o.from_y));
    for (int radius = 0; radius <= 3 && !best; ++radius)
      for (int y = cy - radius; y <= cy + radius; ++y)
        for (int x = cx - radius; x <= cx + radius; ++x) {
          const int xx = std::clamp(x, apron_, apron_ + s.size.width - 1),
                    yy = std::clamp(y, apron_, apron_ + s.size.height - 1);
          if (!orphaned.empty() &&
              orphaned[static_cast<std::size_t>(s.first) +
                       static_cast<std::size_t>(yy) * static_cast<std::size_t>(s.pitch) + static_cast<std::size_t>(xx)])
            continue;
          const double distance = (xx - o.from_x) * (xx - o.from_x) + (yy - o.from_y) * (yy - o.from_y);
          if (distance < best_distance) best_distance = distance, best = texel(o.from_face, xx, yy);
        }
    return best;
  };
  std::vector<Texel> values(orphans.size());
  for (int pass = 0; pass < 4; ++pass) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, orphans.size(), 256), [&](const auto& range) {
      for (std::size_t i = range.begin(); i != range.end(); ++i) {
        const Orphan& o = orphans[i];
        const SourceFace& s = faces_[static_cast<std::size_t>(o.from_face)];
        const double nearest_x = std::round(o.from_x), nearest_y = std::round(o.from_y);
        const bool exact = std::abs(o.from_x - nearest_x) < on_texel && std::abs(o.from_y - nearest_y) < on_texel;
        if (pass == 0 || exact) {
          if (const float* owner = nearest_owned(o))
            std::copy_n(owner, 4, values[i].data());
          else
            values[i] = {};
          continue;
        }
        const int x0 = static_cast<int>(std::floor(o.from_x)), y0 = static_cast<int>(std::floor(o.from_y));
        const auto wx = table.at(o.from_x - x0), wy = table.at(o.from_y - y0);
        Texel sum{};
        for (int j = 0; j < adopt_taps; ++j) {
          const int y = std::clamp(y0 + j - (adopt_taps / 2 - 1), 0, s.rows - 1);
          Texel row{};
          for (int k = 0; k < adopt_taps; ++k) {
            const int x = std::clamp(x0 + k - (adopt_taps / 2 - 1), 0, s.pitch - 1);
            const float* t = texel(o.from_face, x, y);
            for (std::size_t c = 0; c < 4; ++c) row[c] += wx[static_cast<std::size_t>(k)] * t[c];
          }
          for (std::size_t c = 0; c < 4; ++c) sum[c] += wy[static_cast<std::size_t>(j)] * row[c];
        }
        values[i] = sum;
      }
    });
    for (std::size_t i = 0; i < orphans.size(); ++i)
      std::copy_n(values[i].data(), 4, texel(orphans[i].face, orphans[i].x, orphans[i].y));
  }
}

// Rows, then columns, through 1/B(z) as two first-order recursions of unit gain at zero frequency (Unser 1999, box 2):
// forwards y[n] = (1-p) x[n] + p y[n-1], backwards alike.  Beyond its ends a line counts as constant.
void Source::prefilter() {
  constexpr float p = static_cast<float>(omoms_pole), g = 1.0f - p;
  constexpr int lines = 8;  // recursions run abreast
  for (const SourceFace& s : faces_) {
    float* base = texels_.data() + 4 * static_cast<std::size_t>(s.first);
    const std::size_t pitch = static_cast<std::size_t>(s.pitch) * 4;
    tbb::parallel_for(tbb::blocked_range<int>(0, s.rows, lines), [&](const tbb::blocked_range<int>& range) {
      for (int y0 = range.begin(); y0 < range.end(); y0 += lines) {
        const int n = std::min(lines, range.end() - y0);
        float state[lines][4];
        for (int k = 0; k < n; ++k) std::copy_n(base + static_cast<std::size_t>(y0 + k) * pitch, 4, state[k]);
        for (int x = 0; x < s.pitch; ++x)
          for (int k = 0; k < n; ++k) {
            float* t = base + static_cast<std::size_t>(y0 + k) * pitch + 4 * static_cast<std::size_t>(x);
            for (int c = 0; c < 4; ++c) t[c] = state[k][c] = g * t[c] + p * state[k][c];
          }
        for (int x = s.pitch - 1; x >= 0; --x)
          for (int k = 0; k < n; ++k) {
            float* t = base + static_cast<std::size_t>(y0 + k) * pitch + 4 * static_cast<std::size_t>(x);
            for (int c = 0; c < 4; ++c) t[c] = state[k][c] = g * t[c] + p * state[k][c];
          }
      }
    });
    constexpr std::size_t strip = 256;  // floats: a strip of columns stays in the cache from end to end
    const std::size_t strips = (pitch + strip - 1) / strip;
    tbb::parallel_for(std::size_t{0}, strips, [&](std::size_t k) {
      const std::size_t x0 = k * strip, n = std::min(strip, pitch - x0);
      float state[strip];
      std::copy_n(base + x0, n, state);
      for (int y = 0; y < s.rows; ++y) {
        float* t = base + static_cast<std::size_t>(y) * pitch + x0;
        for (std::size_t i = 0; i < n; ++i) t[i] = state[i] = g * t[i] + p * state[i];
      }
      for (int y = s.rows - 1; y >= 0; --y) {
        float* t = base + static_cast<std::size_t>(y) * pitch + x0;
        for (std::size_t i = 0; i < n; ++i) t[i] = state[i] = g * t[i] + p * state[i];
      }
    });
  }
}

}  // namespace envconv
