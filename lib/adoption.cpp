// SPDX-License-Identifier: Apache-2.0
// What stands in a Source's texels that no face owns: beyond the faces' edges, and inside faces that a layout fills
// only in part.  Every such orphan takes the radiance of its own direction, read where that direction is owned.
#include <tbb/blocked_range.h>
#include <tbb/concurrent_vector.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "assertion.h"
#include "source.h"

namespace envconv {
namespace {

// Pixel position whose fraction is a rounding error counts as the pixel itself.
constexpr double on_texel = 1e-6;

// The modified Bessel function of the first kind, order 0, to rounding for |x| <= 8: its power series.
double bessel_i0(double x) {
  const double q = 0.25 * x * x;
  double sum = 1, term = 1;
  for (int k = 1; k < 28; ++k) term *= q / (k * k), sum += term;
  return sum;
}

// Interpolating kernel for texels read from across seams: sinc under a Kaiser window (beta 7.5), eight taps.
constexpr int adopt_taps = 8, adopt_before = adopt_taps / 2 - 1;
std::array<float, adopt_taps> adopt_weights(double f) {
  std::array<double, adopt_taps> w;
  double sum = 0;
  const double sine = std::sin(M_PI * f);  // of pi t, but for the sign
  for (int k = 0; k < adopt_taps; ++k) {
    const double t = k - adopt_before - f;
    const double r = t / (adopt_taps / 2);
    double value = 0;
    if (std::abs(r) < 1)
      value = bessel_i0(7.5 * std::sqrt(1 - r * r)) * (t == 0 ? 1.0 : (k % 2 ? -sine : sine) / (M_PI * t));
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
    for (std::size_t i = 0; i <= 512; ++i) {
      const auto row = adopt_weights(static_cast<double>(i) / 1024);
      std::reverse_copy(row.begin(), row.end(), rows[1024 - i].begin());
      rows[i] = row;
    }
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

const AdoptTable& adopt_table() {
  static const AdoptTable table;
  return table;
}

}  // namespace

// Which padded texels hold radiance of their own.  Faces that are filled to their edges own all texels inside.
class Source::Ownership {
 public:
  Ownership(const Source& source, const Orphans& orphans) : source_(source) {
    if (source.layout_->info().domain == Domain::square) return;
    for (const SourceFace& s : source.faces_)
      orphaned_.emplace_back(static_cast<std::size_t>(s.size.width) * static_cast<std::size_t>(s.size.height));
    orphans.for_each([&](const Orphan& o) {
      const SourceFace& s = source.faces_[static_cast<std::size_t>(o.face)];
      if (source.in_face(s, o.x, o.y)) orphaned_[static_cast<std::size_t>(o.face)][place(s, o.x, o.y)] = 1;
    });
  }

  bool owned(int face, int x, int y) const {
    const SourceFace& s = source_.faces_[static_cast<std::size_t>(face)];
    return source_.in_face(s, x, y) &&
           (orphaned_.empty() || !orphaned_[static_cast<std::size_t>(face)][place(s, x, y)]);
  }

  // All of the window that an orphan's interpolation reads.
  bool window_owned(const Orphan& o) const {
    const SourceFace& s = source_.faces_[static_cast<std::size_t>(o.from_face)];
    const int x = static_cast<int>(std::floor(o.from_x)) - adopt_before;
    const int y = static_cast<int>(std::floor(o.from_y)) - adopt_before;
    if (!source_.in_face(s, x, y) || !source_.in_face(s, x + adopt_taps - 1, y + adopt_taps - 1)) return false;
    if (orphaned_.empty()) return true;
    for (int j = 0; j < adopt_taps; ++j) {
      const auto* row = &orphaned_[static_cast<std::size_t>(o.from_face)][place(s, x, y + j)];
      if (std::any_of(row, row + adopt_taps, [](std::uint8_t orphan) { return orphan != 0; })) return false;
    }
    return true;
  }

 private:
  std::size_t place(const SourceFace& s, int x, int y) const {
    return static_cast<std::size_t>(y - source_.apron_) * static_cast<std::size_t>(s.size.width) +
           static_cast<std::size_t>(x - source_.apron_);
  }

  const Source& source_;
  std::vector<std::vector<std::uint8_t>> orphaned_;  // by face, inside it; none where all is owned
};

Source::Orphans Source::find_orphans() const {
  // Pieces are searched in parallel, and their finds joined in order.
  constexpr int length = 256;
  struct Piece {
    int x, y, width, height;
  };
  Orphans orphans;
  for (std::size_t f = 0; f < faces_.size(); ++f) {
    const SourceFace& s = faces_[f];
    std::vector<Piece> pieces;
    const auto cut = [&](int x, int y, int width, int height) {
      for (int j = 0; j < height; j += length)
        for (int i = 0; i < width; i += length)
          pieces.push_back({x + i, y + j, std::min(length, width - i), std::min(length, height - j)});
    };
    if (layout_->info().domain == Domain::square) {
      cut(0, 0, s.columns, apron_);
      cut(0, apron_, apron_, s.size.height);
      cut(apron_ + s.size.width, apron_, apron_, s.size.height);
      cut(0, apron_ + s.size.height, s.columns, apron_);
    } else {
      cut(0, 0, s.columns, s.rows);
    }
    std::vector<Orphans> found(pieces.size());
    tbb::parallel_for(std::size_t{0}, pieces.size(), [&](std::size_t i) {
      const Piece& p = pieces[i];
      find_orphans_in(static_cast<int>(f), p.x, p.y, p.width, p.height, found[i]);
    });
    for (const Orphans& some : found) {
      orphans.exact.insert(orphans.exact.end(), some.exact.begin(), some.exact.end());
      orphans.smooth.insert(orphans.smooth.end(), some.smooth.begin(), some.smooth.end());
      orphans.others.insert(orphans.others.end(), some.others.begin(), some.others.end());
    }
  }
  return orphans;
}

// Where a face's padded place (x, y), in texels, is owned.
Source::Origin Source::origin_of(int face, double x, double y) const {
  const SourceFace& s = faces_[static_cast<std::size_t>(face)];
  const Location at = layout_->locate(layout_->direction(face, u_from_texel(x - apron_, s.size.width, placement_),
                                                         u_from_texel(y - apron_, s.size.height, placement_)));
  const SourceFace& o = faces_[static_cast<std::size_t>(at.face)];
  return {at.face, texel_from_u(at.u, o.size.width, placement_) + apron_,
          texel_from_u(at.v, o.size.height, placement_) + apron_};
}

Source::Orphan Source::orphan_at(int face, int x, int y) const {
  const Origin from = origin_of(face, x, y);
  Orphan orphan{face, x, y, from.face, from.x, from.y};
  const double nearest_x = std::round(orphan.from_x), nearest_y = std::round(orphan.from_y);
  orphan.exact = std::abs(orphan.from_x - nearest_x) < on_texel && std::abs(orphan.from_y - nearest_y) < on_texel;
  return orphan;
}

Source::Orphan Source::ExactPatch::at(int i, int j) const {
  return {face,
          x + i,
          y + j,
          from_face,
          static_cast<double>(from_x + i * right_x + j * down_x),
          static_cast<double>(from_y + i * right_y + j * down_y),
          true};
}

Source::Orphan Source::SmoothPatch::at(int i, int j) const {
  const double s = width > 1 ? 2.0 * i / (width - 1) - 1 : 0, t = height > 1 ? 2.0 * j / (height - 1) - 1 : 0;
  const auto value = [&](const double(&c)[4][4]) {
    double sum = 0;
    for (int n = 3; n >= 0; --n) sum = sum * t + (((c[n][3] * s + c[n][2]) * s + c[n][1]) * s + c[n][0]);
    return sum;
  };
  return {face, x + i, y + j, from_face, value(from_x), value(from_y)};
}

void Source::find_orphans_in(int face, int x, int y, int width, int height, Orphans& orphans) const {
  constexpr int small = 8;
  const SourceFace& s = faces_[static_cast<std::size_t>(face)];
  const bool whole = layout_->info().domain == Domain::square;
  const auto owned = [&](int i, int j) {
    return in_face(s, i, j) && layout_->owns(face, u_from_texel(i - apron_, s.size.width, placement_),
                                             u_from_texel(j - apron_, s.size.height, placement_));
  };
  bool orphaned =
      x + width <= apron_ || y + height <= apron_ || x >= apron_ + s.size.width || y >= apron_ + s.size.height;
  constexpr int fine = 32;  // rectangles in a face's side, of which seams are so smooth that none slips between points
  if (!whole && !orphaned && std::max(width, height) * fine <= std::max(s.size.width, s.size.height)) {
    // Around the rectangle, a texel away from it.
    constexpr int around = 25;
    int owned_around = 0;
    for (int k = 0; k < around; ++k)
      owned_around += owned(x - 1 + k % 5 * (width + 1) / 4, y - 1 + k / 5 * (height + 1) / 4) ? 1 : 0;
    if (owned_around == around) return;
    orphaned = owned_around == 0;
  }
  if (whole && find_exact_patch(face, x, y, width, height, orphans)) return;
  if (orphaned && find_smooth_patch(face, x, y, width, height, orphans)) return;
  if (width <= small && height <= small) {
    for (int j = y; j < y + height; ++j)
      for (int i = x; i < x + width; ++i)
        if (whole || !owned(i, j)) orphans.others.push_back(orphan_at(face, i, j));
    return;
  }
  const int left = width > height ? width / 2 : width, top = width > height ? height : height / 2;
  find_orphans_in(face, x, y, left, top, orphans);
  if (left < width)
    find_orphans_in(face, x + left, y, width - left, height, orphans);
  else
    find_orphans_in(face, x, y + top, width, height - top, orphans);
}

// Many seams join texel to texel (latlong's all do): where a rectangle's corners and its middle are texels of one face
// at the distances that they have here, all in between are, and need no formula.
bool Source::find_exact_patch(int face, int x, int y, int width, int height, Orphans& orphans) const {
  const Orphan first = orphan_at(face, x, y);
  if (!first.exact) return false;
  const auto rounded = [](double a, double b) { return static_cast<int>(std::lround(a - b)); };
  const Orphan right = orphan_at(face, x + width - 1, y), below = orphan_at(face, x, y + height - 1);
  // Steps along the owner's axes for a step right, and for a step down.
  const int wide = std::max(width - 1, 1), high = std::max(height - 1, 1);
  const int right_x = rounded(right.from_x, first.from_x) / wide, right_y = rounded(right.from_y, first.from_y) / wide;
  const int down_x = rounded(below.from_x, first.from_x) / high, down_y = rounded(below.from_y, first.from_y) / high;
  const auto agrees = [&](const Orphan& o) {
    const int i = o.x - x, j = o.y - y;
    return o.exact && o.from_face == first.from_face && rounded(o.from_x, first.from_x) == i * right_x + j * down_x &&
           rounded(o.from_y, first.from_y) == i * right_y + j * down_y;
  };
  if (!agrees(right) || !agrees(below) || !agrees(orphan_at(face, x + width - 1, y + height - 1)) ||
      !agrees(orphan_at(face, x + width / 2, y + height / 2)) ||
      !agrees(orphan_at(face, x + width / 3, y + height / 4)))
    return false;
  orphans.exact.push_back({face, x, y, width, height, first.from_face,
                           static_cast<std::int32_t>(std::lround(first.from_x)),
                           static_cast<std::int32_t>(std::lround(first.from_y)), right_x, right_y, down_x, down_y});
  return true;
}

// Elsewhere the place is interpolated between 4 x 4 nodes (Chebyshev's), where that agrees with the formula at the
// rectangle's corners and between the nodes.
bool Source::find_smooth_patch(int face, int x, int y, int width, int height, Orphans& orphans) const {
  constexpr int most = 64, least = 32;  // longest side, and texels, below which nothing is gained
  constexpr double tolerance = 1e-5;    // texels
  if (std::max(width, height) > most || width * height < least) return false;
  SmoothPatch patch{face, x, y, width, height, -1, {}, {}};
  const auto place = [&](double s, double t) {
    return origin_of(face, x + 0.5 * (s + 1) * (width - 1), y + 0.5 * (t + 1) * (height - 1));
  };
  // Chebyshev coefficients from the nodes, then those of powers.
  constexpr int n = 4;
  double nodes[n], chebyshev[n][n];  // [degree][node]
  for (int k = 0; k < n; ++k) {
    const double angle = M_PI * (k + 0.5) / n;
    nodes[k] = std::cos(angle);
    for (int d = 0; d < n; ++d) chebyshev[d][k] = (d == 0 ? 1.0 : 2.0) / n * std::cos(d * angle);
  }
  constexpr double powers[n][n] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {-1, 0, 2, 0}, {0, -3, 0, 4}};  // of T_d: [d][power]
  double to_power[n][n] = {};                                                                  // [power][node]
  for (int p = 0; p < n; ++p)
    for (int k = 0; k < n; ++k)
      for (int d = 0; d < n; ++d) to_power[p][k] += powers[d][p] * chebyshev[d][k];
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      const Origin o = place(nodes[i], nodes[j]);
      if (patch.from_face < 0) patch.from_face = o.face;
      if (o.face != patch.from_face) return false;
      for (int q = 0; q < n; ++q)
        for (int p = 0; p < n; ++p) {
          patch.from_x[q][p] += to_power[q][j] * to_power[p][i] * o.x;
          patch.from_y[q][p] += to_power[q][j] * to_power[p][i] * o.y;
        }
    }
  const auto agrees = [&](int i, int j) {
    const Orphan truth = orphan_at(face, x + i, y + j), o = patch.at(i, j);
    return truth.from_face == patch.from_face && std::abs(truth.from_x - o.from_x) <= tolerance &&
           std::abs(truth.from_y - o.from_y) <= tolerance;
  };
  const int right = width - 1, bottom = height - 1;
  for (const auto& [i, j] : {std::pair{0, 0},
                             {right, 0},
                             {0, bottom},
                             {right, bottom},
                             {right / 2, bottom / 2},
                             {right / 3, 0},
                             {0, bottom / 3},
                             {right, 2 * bottom / 3},
                             {2 * right / 3, bottom}})
    if (!agrees(i, j)) return false;
  orphans.smooth.push_back(patch);
  return true;
}

void Source::adopt(const Orphans& orphans) {
  tbb::parallel_for(std::size_t{0}, orphans.exact.size(), [&](std::size_t i) { adopt_patch(orphans.exact[i]); });
  const Ownership ownership(*this, orphans);
  // Most read nothing but what is owned.  The windows of the rest, near seams' ends, hold orphans themselves: they take
  // the nearest owned texel first, and refine.
  tbb::concurrent_vector<Orphan> open;
  const auto first = [&](const Orphan& o) {
    const bool settled = o.exact || ownership.window_owned(o);
    const Texel value = settled && !o.exact ? interpolate(o) : nearest_owned(o, ownership);
    write_row(o.face, o.x, o.y, 1, value.data());
    if (!settled) open.push_back(o);
  };
  const auto each = [](std::size_t n, const auto& visit) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, n, 256), [&](const auto& range) {
      for (std::size_t i = range.begin(); i != range.end(); ++i) visit(i);
    });
  };
  each(orphans.others.size(), [&](std::size_t i) { first(orphans.others[i]); });
  tbb::parallel_for(std::size_t{0}, orphans.smooth.size(), [&](std::size_t k) {
    const SmoothPatch& patch = orphans.smooth[k];
    for (int j = 0; j < patch.height; ++j)
      for (int i = 0; i < patch.width; ++i) first(patch.at(i, j));
  });
  // Each pass reads the one before only, so that the order (and the thread count) does not matter.
  std::vector<Texel> values(open.size());
  for (int pass = 0; pass < 3 && !open.empty(); ++pass) {
    each(open.size(), [&](std::size_t i) { values[i] = interpolate(open[i]); });
    each(open.size(), [&](std::size_t i) { write_row(open[i].face, open[i].x, open[i].y, 1, values[i].data()); });
  }
}

void Source::adopt_patch(const ExactPatch& patch) {
  std::vector<float> row(static_cast<std::size_t>(patch.width * channels_));
  for (int j = 0; j < patch.height; ++j) {
    faces_[static_cast<std::size_t>(patch.from_face)].image->texels_touched();
    const int from_x = patch.from_x + j * patch.down_x, from_y = patch.from_y + j * patch.down_y;
    if (patch.right_x == 1 && patch.right_y == 0) {
      copy_row(patch.from_face, from_x, from_y, patch.width, row.data());
    } else {
      for (int i = 0; i < patch.width; ++i)
        copy_row(patch.from_face, from_x + i * patch.right_x, from_y + i * patch.right_y, 1,
                 row.data() + i * channels_);
    }
    write_row(patch.face, patch.x, patch.y + j, patch.width, row.data());
  }
}

Source::Texel Source::interpolate(const Orphan& orphan) const {
  faces_[static_cast<std::size_t>(orphan.from_face)].image->texels_touched();
  const int x = static_cast<int>(std::floor(orphan.from_x)), y = static_cast<int>(std::floor(orphan.from_y));
  const auto wx = adopt_table().at(orphan.from_x - x), wy = adopt_table().at(orphan.from_y - y);
  float copy[adopt_taps * adopt_taps * 4 + 16];
  const Rectangle window =
      rectangle(orphan.from_face, x - adopt_before, y - adopt_before, adopt_taps, adopt_taps, copy);
  Texel sums{};
  sum_window(channels_, window.texels, window.pitch, wx.data(), wy.data(), sums.data());
  return sums;
}

Source::Texel Source::nearest_owned(const Orphan& orphan, const Ownership& ownership) const {
  constexpr int farthest = 3;
  faces_[static_cast<std::size_t>(orphan.from_face)].image->texels_touched();
  const int near_x = static_cast<int>(std::lround(orphan.from_x)),
            near_y = static_cast<int>(std::lround(orphan.from_y));
  Texel texel{};
  for (int radius = 0; radius <= farthest; ++radius) {
    double best = std::numeric_limits<double>::max();
    int best_x = 0, best_y = 0;
    for (int y = near_y - radius; y <= near_y + radius; ++y)
      for (int x = near_x - radius; x <= near_x + radius; ++x) {
        if (!ownership.owned(orphan.from_face, x, y)) continue;
        const double distance = (x - orphan.from_x) * (x - orphan.from_x) + (y - orphan.from_y) * (y - orphan.from_y);
        if (distance < best) best = distance, best_x = x, best_y = y;
      }
    if (best == std::numeric_limits<double>::max()) continue;
    copy_row(orphan.from_face, best_x, best_y, 1, texel.data());
    break;
  }
  return texel;
}

// To the own copy where it is inside the face, and to every strip that holds some of it.
void Source::write_row(int face, int x, int y, int count, const float* texels) {
  const auto f = static_cast<std::size_t>(face);
  faces_[f].image->texels_touched();
  const auto put = [&](Image& image, int left, int top) {  // whose first texel is the padded texel (left, top)
    if (y < top || y >= top + image.height()) return;
    const int begin = std::max(x, left), end = std::min(x + count, left + image.width());
    if (begin < end)
      std::copy_n(texels + (begin - x) * channels_, (end - begin) * channels_, image.at(begin - left, y - top));
  };
  if (layout_->info().domain != Domain::square) put(copies_[f], apron_, apron_);
  for (Strip& strip : strips_[f]) put(strip.pixels, strip.x, strip.y);
}

}  // namespace envconv
