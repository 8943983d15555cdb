// SPDX-License-Identifier: Apache-2.0
// What stands in a Source's texels that no face owns: beyond the faces' edges, and inside faces that a layout fills
// only in part.  Every such orphan takes the radiance of its own direction, read where that direction is owned.
#include <tbb/blocked_range.h>
#include <tbb/concurrent_vector.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "assertion.h"
#include "source.h"
#include "sum_kernels.h"

namespace envconv {
namespace {

// Pixel position whose fraction is a rounding error counts as the pixel itself.
constexpr double on_texel = 1e-6;

constexpr int adopt_taps = sinc_taps, adopt_before = adopt_taps / 2 - 1;
constexpr int most_together = 64;  // orphans interpolated at once

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
    for (const UnreadPatch& patch : orphans.unread) {
      const SourceFace& s = source.faces_[static_cast<std::size_t>(patch.face)];
      for (int y = patch.y; y < patch.y + patch.height; ++y)
        for (int x = patch.x; x < patch.x + patch.width; ++x)
          if (source.in_face(s, x, y)) orphaned_[static_cast<std::size_t>(patch.face)][place(s, x, y)] = 1;
    }
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
    std::uint64_t any = 0;
    for (int j = 0; j < adopt_taps; ++j) {
      std::uint64_t row;
      static_assert(sizeof row == adopt_taps);
      std::memcpy(&row, &orphaned_[static_cast<std::size_t>(o.from_face)][place(s, x, y + j)], sizeof row);
      any |= row;
    }
    return any == 0;
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
      orphans.unread.insert(orphans.unread.end(), some.unread.begin(), some.unread.end());
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

void Source::SmoothPatch::row(int j, Orphan* out) const {
  const double t = height > 1 ? 2.0 * j / (height - 1) - 1 : 0;
  double across_x[4], across_y[4];  // polynomials of s
  for (int m = 0; m < 4; ++m) {
    across_x[m] = ((from_x[3][m] * t + from_x[2][m]) * t + from_x[1][m]) * t + from_x[0][m];
    across_y[m] = ((from_y[3][m] * t + from_y[2][m]) * t + from_y[1][m]) * t + from_y[0][m];
  }
  for (int i = 0; i < width; ++i) {
    const double s = width > 1 ? 2.0 * i / (width - 1) - 1 : 0;
    const auto value = [&](const double(&c)[4]) { return ((c[3] * s + c[2]) * s + c[1]) * s + c[0]; };
    out[i] = {face, x + i, y + j, from_face, value(across_x), value(across_y), false};
  }
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
  constexpr int around = 25;
  const auto is_fine = [&](int margin) {
    return (std::max(width, height) + 2 * margin) * fine <= std::max(s.size.width, s.size.height);
  };
  // Of points of the rectangle and so many texels around it.
  const auto owned_around = [&](int margin) {
    int count = 0;
    for (int k = 0; k < around; ++k)
      count +=
          owned(x - margin + k % 5 * (width - 1 + 2 * margin) / 4, y - margin + k / 5 * (height - 1 + 2 * margin) / 4)
              ? 1
              : 0;
    return count;
  };
  if (!whole && !orphaned && is_fine(1)) {
    const int count = owned_around(1);
    if (count == around) return;
    orphaned = count == 0;
    // Windows reach as far as the apron.
    if (orphaned && is_fine(apron_ + 1) && owned_around(apron_ + 1) == 0) {
      orphans.unread.push_back({face, x, y, width, height});
      return;
    }
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
  constexpr int most = most_together, least = 32;  // longest side, and texels, below which nothing is gained
  constexpr double tolerance = 1e-5;               // texels
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
    Orphan row[most];
    patch.row(j, row);
    const Orphan truth = orphan_at(face, x + i, y + j), &o = row[i];
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
  // Images hold anything there, and recursions run over it.
  tbb::parallel_for(std::size_t{0}, orphans.unread.size(), [&](std::size_t i) {
    const UnreadPatch& patch = orphans.unread[i];
    const std::vector<float> black(static_cast<std::size_t>(patch.width * channels_));
    for (int j = 0; j < patch.height; ++j) write_row(patch.face, patch.x, patch.y + j, patch.width, black.data());
  });
  tbb::parallel_for(std::size_t{0}, orphans.exact.size(), [&](std::size_t i) { adopt_patch(orphans.exact[i]); });
  const Ownership ownership(*this, orphans);
  // Most read nothing but what is owned.  The windows of the rest, near seams' ends, hold orphans themselves: they take
  // the nearest owned texel first, and refine.
  tbb::concurrent_vector<Orphan> open;
  // `n` neighbours in a row.
  const auto first = [&](int n, const Orphan* row) {
    Texel values[most_together];
    Orphan settled[most_together];
    int place[most_together], count = 0;
    for (int i = 0; i < n; ++i) {
      const bool whole = ownership.window_owned(row[i]);
      if (whole && !row[i].exact) {
        settled[count] = row[i], place[count++] = i;
        continue;
      }
      values[i] = nearest_owned(row[i], ownership);
      if (!whole && !row[i].exact) open.push_back(row[i]);
    }
    Texel interpolated[most_together];
    interpolate(count, settled, interpolated);
    for (int k = 0; k < count; ++k) values[place[k]] = interpolated[k];
    write_texels(n, row, values);
  };
  // Runs of texels that are neighbours in a row.
  const auto each_run = [](const auto& all, const auto& visit) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, all.size(), 256), [&](const auto& range) {
      for (std::size_t i = range.begin(), end; i != range.end(); i = end) {
        const auto follows = [&](std::size_t k) {
          return all[k].face == all[i].face && all[k].y == all[i].y &&
                 all[k].x == all[i].x + static_cast<std::int32_t>(k - i);
        };
        for (end = i + 1; end != range.end() && end - i < most_together && follows(end);) ++end;
        visit(i, static_cast<int>(end - i));
      }
    });
  };
  each_run(orphans.others, [&](std::size_t i, int n) { first(n, &orphans.others[i]); });
  tbb::parallel_for(std::size_t{0}, orphans.smooth.size(), [&](std::size_t k) {
    const SmoothPatch& patch = orphans.smooth[k];
    Orphan row[most_together];
    for (int j = 0; j < patch.height; ++j) {
      patch.row(j, row);
      first(patch.width, row);
    }
  });
  // The fixed point of interpolating them all, by Chebyshev's semi-iteration (Golub & Varga 1961), which needs half as
  // many passes as plain ones: a tennis ball's seam then costs nothing, where three plain ones left 16 dB of error.
  // Eigenvalues of the interpolation are taken to lie between these.  Each pass reads the one before only, so that the
  // order (and the thread count) does not matter.
  constexpr double least = -0.75, most = 0.55;
  constexpr double step = 2 / (2 - least - most), spread = (most - least) / (2 - least - most);
  constexpr int passes = 5;
  const std::vector<Orphan> refined(open.begin(), open.end());
  std::vector<Texel> interpolated(refined.size()), values(refined.size()), before(refined.size());
  for (std::size_t i = 0; i < refined.size(); ++i) {
    faces_[static_cast<std::size_t>(refined[i].face)].image->texels_touched();
    copy_row(refined[i].face, refined[i].x, refined[i].y, 1, values[i].data());
  }
  double weight = 1;
  for (int pass = 0; pass < passes; ++pass) {
    each_run(refined, [&](std::size_t i, int n) { interpolate(n, &refined[i], &interpolated[i]); });
    if (pass > 0) weight = 1 / (1 - spread * spread * weight / (pass == 1 ? 2 : 4));
    each_run(refined, [&](std::size_t i, int n) {
      for (std::size_t k = i; k < i + static_cast<std::size_t>(n); ++k)
        for (std::size_t c = 0; c < 4; ++c) {
          const float next = values[k][c] + static_cast<float>(step) * (interpolated[k][c] - values[k][c]);
          before[k][c] = std::exchange(values[k][c], before[k][c] + static_cast<float>(weight) * (next - before[k][c]));
        }
      write_texels(n, &refined[i], &values[i]);
    });
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

void Source::interpolate(int n, const Orphan* orphans, Texel* values) const {
  constexpr int copied = adopt_taps * adopt_taps * 4 + 16;
  constexpr int batch = 16;
  float copies[batch][copied];
  SincWindow windows[batch];
  for (int begin = 0; begin < n; begin += batch) {
    const int count = std::min(batch, n - begin);
    for (int i = 0; i < count; ++i) {
      const Orphan& o = orphans[begin + i];
      faces_[static_cast<std::size_t>(o.from_face)].image->texels_touched();
      const int x = static_cast<int>(std::floor(o.from_x)), y = static_cast<int>(std::floor(o.from_y));
      const Rectangle window =
          rectangle(o.from_face, x - adopt_before, y - adopt_before, adopt_taps, adopt_taps, copies[i]);
      windows[i] = {window.texels, window.pitch, static_cast<float>(o.from_x - x), static_cast<float>(o.from_y - y)};
    }
    interpolate_sinc(channels_, count, windows, values[begin].data());
  }
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

// Of neighbours in a row.
void Source::write_texels(int n, const Orphan* orphans, const Texel* values) {
  float row[most_together * 4];
  for (int i = 0; i < n; ++i) std::copy_n(values[i].data(), channels_, row + i * channels_);
  write_row(orphans[0].face, orphans[0].x, orphans[0].y, n, row);
}

// To the pixels where it is inside the face, and to every strip that holds some of it.
void Source::write_row(int face, int x, int y, int count, const float* texels) {
  const auto f = static_cast<std::size_t>(face);
  faces_[f].image->texels_touched();
  const auto put = [&](Image& image, int left, int top) {  // whose first texel is the padded texel (left, top)
    if (y < top || y >= top + image.height()) return;
    const int begin = std::max(x, left), end = std::min(x + count, left + image.width());
    if (begin < end)
      std::copy_n(texels + (begin - x) * channels_, (end - begin) * channels_, image.at(begin - left, y - top));
  };
  if (!writable_.empty()) put(*writable_[f], apron_, apron_);
  for (Strip& strip : strips_[f]) put(strip.pixels, strip.x, strip.y);
}

}  // namespace envconv
