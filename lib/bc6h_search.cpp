// SPDX-License-Identifier: Apache-2.0
#include "bc6h_search.h"

#include <algorithm>
#include <array>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "bc6h_search.cpp"
#include "lane-inl.h"
// After it, since it brings Lane.
#include "bc6h_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::bc6h::HWY_NAMESPACE {

constexpr int two_region_modes = 10;  // the first ones of `modes`
constexpr int box_mode = 10;          // one region, end points of 10 bits wherever they are

// The n least of what is offered, a list a lane.
template <int capacity>
struct Least {
  Lane key[capacity], id[capacity];
  int n;
  HWY_ATTR explicit Least(int count) : n(count) {
    for (int i = 0; i < n; ++i) key[i] = most, id[i] = 0.0;
  }
  HWY_ATTR HWY_INLINE void offer(Lane new_key, Lane new_id) {
    for (int i = 0; i < n; ++i) {
      const LaneMask better = new_key < key[i];
      const Lane old_key = key[i], old_id = id[i];
      key[i] = min(new_key, old_key);
      id[i] = select(better, new_id, old_id);
      new_key = max(new_key, old_key);
      new_id = select(better, old_id, new_id);
    }
  }
};

// --- lines through texels

// Sums over a set of texels of 1, of their places (relative to the block's mean) and of the places' products.
struct Spread {
  Lane n, x[3], xx[6];  // xx: 00 01 02 11 12 22
};
HWY_INLINE Spread no_spread() { return {0.0, {0.0, 0.0, 0.0}, {0.0, 0.0, 0.0, 0.0, 0.0, 0.0}}; }
HWY_INLINE Spread operator-(const Spread& a, const Spread& b) {
  Spread s;
  s.n = a.n - b.n;
  for (int c = 0; c < 3; ++c) s.x[c] = a.x[c] - b.x[c];
  for (int i = 0; i < 6; ++i) s.xx[i] = a.xx[i] - b.xx[i];
  return s;
}

struct Lines {
  Lane x[16][3], xx[16][6];
  Spread all;
};
HWY_INLINE void load(const Lane (&texels)[16][3], Lines& lines) {
  lines.all = no_spread();
  for (int c = 0; c < 3; ++c) {
    Lane mean = 0.0;
    for (int k = 0; k < 16; ++k) mean = mean + texels[k][c] * (1.0 / 16);
    for (int k = 0; k < 16; ++k) {
      lines.x[k][c] = texels[k][c] - mean;
      lines.all.x[c] = lines.all.x[c] + lines.x[k][c];
    }
  }
  lines.all.n = 16.0;
  for (int k = 0; k < 16; ++k) {
    const Lane* x = lines.x[k];
    const Lane products[6] = {x[0] * x[0], x[0] * x[1], x[0] * x[2], x[1] * x[1], x[1] * x[2], x[2] * x[2]};
    for (int i = 0; i < 6; ++i) {
      lines.xx[k][i] = products[i];
      lines.all.xx[i] = lines.all.xx[i] + products[i];
    }
  }
}

struct Axis {
  Lane x[3];    // of any length; 0 where the texels are alike
  Lane along;   // sum of squares along it
  Lane across;  // and across it
};
HWY_INLINE Axis principal_axis(const Spread& s) {
  const Lane inverse = 1.0 / max(s.n, 1.0);
  const Lane m[6] = {s.xx[0] - s.x[0] * s.x[0] * inverse, s.xx[1] - s.x[0] * s.x[1] * inverse,
                     s.xx[2] - s.x[0] * s.x[2] * inverse, s.xx[3] - s.x[1] * s.x[1] * inverse,
                     s.xx[4] - s.x[1] * s.x[2] * inverse, s.xx[5] - s.x[2] * s.x[2] * inverse};
  // Columns of the matrix's eighth power point along its first eigenvector.
  Lane p[6] = {m[0], m[1], m[2], m[3], m[4], m[5]};
  for (int squaring = 0; squaring < 3; ++squaring) {
    const Lane scale = 1.0 / max(p[0] + p[3] + p[5], 1e-20);
    const Lane a = p[0] * scale, b = p[1] * scale, c = p[2] * scale, d = p[3] * scale, e = p[4] * scale,
               f = p[5] * scale;
    p[0] = a * a + b * b + c * c, p[1] = a * b + b * d + c * e, p[2] = a * c + b * e + c * f;
    p[3] = b * b + d * d + e * e, p[4] = b * c + d * e + e * f, p[5] = c * c + e * e + f * f;
  }
  const LaneMask first = (p[0] >= p[3]) & (p[0] >= p[5]), last = p[5] > p[3];
  const auto column = [&](Lane a, Lane b, Lane c) HWY_ATTR { return select(first, a, select(last, c, b)); };
  Axis axis;
  Lane* x = axis.x;
  x[0] = column(p[0], p[1], p[2]), x[1] = column(p[1], p[3], p[4]), x[2] = column(p[2], p[4], p[5]);
  const Lane quadratic = x[0] * (m[0] * x[0] + m[1] * x[1] + m[2] * x[2]) +
                         x[1] * (m[1] * x[0] + m[3] * x[1] + m[4] * x[2]) +
                         x[2] * (m[2] * x[0] + m[4] * x[1] + m[5] * x[2]);
  axis.along = quadratic / max(x[0] * x[0] + x[1] * x[1] + x[2] * x[2], 1e-30);
  axis.across = m[0] + m[3] + m[5] - axis.along;
  return axis;
}

// --- the search

struct Search {
  Target target;
  Lines levels, bits;  // in the metric's space, and in that of interpolation
};

// The most promising partitions, best first.
HWY_NOINLINE void rank_partitions(const Lines& lines, Least<partition_count>& ranking) {
  for (int p = 0; p < partition_count; ++p) {
    const int mask = partition_masks[static_cast<std::size_t>(p)];
    Spread second = no_spread();
    for (int k = 0; k < 16; ++k) {
      if (!(mask >> k & 1)) continue;
      second.n = second.n + 1.0;
      for (int c = 0; c < 3; ++c) second.x[c] = second.x[c] + lines.x[k][c];
      for (int i = 0; i < 6; ++i) second.xx[i] = second.xx[i] + lines.xx[k][i];
    }
    const Axis a = principal_axis(lines.all - second), b = principal_axis(second);
    // What is across the axes is lost; of what is along them, eight levels leave about 1/49.
    ranking.offer(a.across + b.across + (a.along + b.along) * (1.0 / 49), p);
  }
}

// Directions of the lines that the two regions' texels are projected on.
struct Directions {
  Lane x[2][3];
};
template <int regions>
HWY_INLINE Directions principal_axes(const Lines& lines, const Regions& r) {
  Spread second = no_spread();
  if constexpr (regions == 2)
    for (int k = 0; k < 16; ++k) {
      const LaneMask in = r.second[k];
      second.n = second.n + where(in, 1.0);
      for (int c = 0; c < 3; ++c) second.x[c] = second.x[c] + where(in, lines.x[k][c]);
      for (int i = 0; i < 6; ++i) second.xx[i] = second.xx[i] + where(in, lines.xx[k][i]);
    }
  const Axis first = principal_axis(lines.all - second), other = principal_axis(second);
  Directions d;
  for (int c = 0; c < 3; ++c) d.x[0][c] = first.x[c], d.x[1][c] = other.x[c];
  return d;
}
// Of one region: a diagonal of the texels' bounding box, 0 to 3.
HWY_INLINE Directions diagonal(const Lines& lines, int number) {
  Directions d;
  for (int c = 0; c < 3; ++c) {
    Lane low = lines.x[0][c], high = low;
    for (int k = 1; k < 16; ++k) low = min(low, lines.x[k][c]), high = max(high, lines.x[k][c]);
    const bool falls = c > 0 && (number >> (c - 1) & 1);
    d.x[0][c] = falls ? low - high : high - low;
  }
  return d;
}

// place[texel] = 0 to 1, along its region's direction from one outermost texel to the other; the region's anchor is in
// the first half, or in the second where the region's bit of `turned` is set.
template <int regions>
HWY_INLINE void project(const Lines& lines, const Regions& r, const Directions& directions, int turned,
                        Lane place[16]) {
  Lane low[2] = {most, most}, high[2] = {-most, -most};
  for (int k = 0; k < 16; ++k) {
    place[k] = 0.0;
    for (int c = 0; c < 3; ++c)
      place[k] = place[k] + by_region<regions>(r, k, directions.x[0][c], directions.x[1][c]) * lines.x[k][c];
    low[0] = min(low[0], by_region<regions>(r, k, place[k], most));
    high[0] = max(high[0], by_region<regions>(r, k, place[k], -most));
    if constexpr (regions == 2) {
      low[1] = min(low[1], select(r.second[k], place[k], most));
      high[1] = max(high[1], select(r.second[k], place[k], -most));
    }
  }
  Lane start[2], scale[2];
  for (int g = 0; g < regions; ++g) {
    const Lane anchor = g == 0 ? place[0] : select(r.anchor2, place[2], select(r.anchor8, place[8], place[15]));
    const Lane past_middle = anchor + anchor - (low[g] + high[g]);
    const LaneMask turn = turned >> g & 1 ? past_middle < 0.0 : past_middle > 0.0;
    const Lane inverse = 1.0 / max(high[g] - low[g], 1e-20);
    start[g] = select(turn, high[g], low[g]);
    scale[g] = select(turn, -inverse, inverse);
  }
  for (int k = 0; k < 16; ++k)
    place[k] = clamp((place[k] - by_region<regions>(r, k, start[0], start[regions - 1])) *
                         by_region<regions>(r, k, scale[0], scale[regions - 1]),
                     0.0, 1.0);
}

// How a partition is tried.
struct Depth {
  int spans, modes, refinements;
  int exchanges = 0;
  bool other_lines = false;
};

// The part of the line between the end points that texels are put on at first, in steps of indices.  Beside all of it:
// end points outside the texels' range often hit them better, where they are rounded coarsely.
template <int regions>
constexpr std::array<std::array<double, 2>, most_spans> spans = {
    {{0, 7}, {0, 5}, {1, 6}, {0, 4}, {2, 7}, {1, 7}, {0, 6}, {3, 7}, {2, 5}, {1, 4}, {1, 3}, {4, 1}}};
// For one region while the other one stays, also short parts and the other way round: the first end point is far from
// the region's texels then, and nearer to the other region's, to which the mode's differences must reach.
constexpr std::array<std::array<double, 2>, 18> exchange_spans = {{{0, 7},
                                                                   {0, 5},
                                                                   {1, 6},
                                                                   {0, 4},
                                                                   {2, 7},
                                                                   {1, 7},
                                                                   {0, 6},
                                                                   {3, 7},
                                                                   {2, 5},
                                                                   {1, 4},
                                                                   {1, 3},
                                                                   {2, 4},
                                                                   {3, 1},
                                                                   {4, 2},
                                                                   {4, 1},
                                                                   {3, 0},
                                                                   {5, 2},
                                                                   {6, 1}}};
template <>
constexpr std::array<std::array<double, 2>, most_spans> spans<1> = {
    {{0, 15}, {1, 14}, {0, 14}, {1, 15}, {0, 13}, {2, 15}, {0, 12}, {3, 15}, {2, 13}, {0, 10}, {4, 11}, {6, 9}}};

// Index of a texel at a place on its line, put on a part of it.
template <int regions>
HWY_INLINE Lane index_at(Lane place, int span) {
  const auto& [from, to] = spans<regions>[static_cast<std::size_t>(span)];
  return round(place * (to - from) + from);
}

// Other lines to start from: the principal axes in the space of interpolation, where black is far from what is dark;
// for one region the diagonals of its box there; for two the other way round, one or both of them, since differences
// are taken from the first end point and how far they reach is not the same both ways.
constexpr int other_lines(int regions) { return regions == 1 ? 5 : 4; }
template <int regions>
HWY_INLINE void project_other(const Search& s, const Regions& r, int number, Lane place[16]) {
  if (number == 0)
    project<regions>(s.bits, r, principal_axes<regions>(s.bits, r), 0, place);
  else if (regions == 1)
    project<regions>(s.bits, r, diagonal(s.bits, number - 1), 0, place);
  else
    project<regions>(s.levels, r, principal_axes<regions>(s.levels, r), number, place);
}

// One partition, from many starts.
template <int regions>
class Trial {
 public:
  HWY_ATTR HWY_INLINE Trial(const Search& search, Lane partition) : s_(search), partition_(partition) {
    if constexpr (regions == 2) r_ = regions_of(partition);
    for (Lane& index : parts_index_) index = 0.0;
  }

  // Returns the least error.
  HWY_ATTR HWY_NOINLINE Lane run(const Depth& depth, Candidate& best) {
    depth_ = depth;
    Lane whole[16], index[16];
    project<regions>(s_.levels, r_, principal_axes<regions>(s_.levels, r_), 0, whole);
    for (int span = 0; span < depth.spans; ++span) {
      for (int k = 0; k < 16; ++k) index[k] = index_at<regions>(whole[k], span);
      try_indices(index, depth.modes, best);
    }
    for (int line = 0; depth.other_lines && line < other_lines(regions); ++line) {
      project_other<regions>(s_, r_, line, index);
      for (int k = 0; k < 16; ++k) index[k] = index_at<regions>(index[k], 0);
      try_indices(index, depth.modes, best);
    }
    if constexpr (regions == 2) {
      if (depth.spans > 1) try_indices(parts_index_, depth.modes, best);
      for (int round = 0; round < depth.exchanges; ++round) exchange(whole, best);
    }
    return least_;
  }

 private:
  // In the modes whose rounding suits these indices.
  HWY_ATTR HWY_NOINLINE void try_indices(const Lane index[16], int modes, Candidate& best) {
    constexpr int first = regions == 1 ? two_region_modes : 0, end = regions == 1 ? mode_count : two_region_modes;
    Fit ends[regions][3];
    least_squares<regions, false>(s_.target, r_, nullptr, nullptr, index, ends);
    Least<mode_count> ranking(std::min(modes, end - first));
    Candidate a;
    for (int mode = first; mode < end; ++mode)
      ranking.offer(round_ends<regions, 1>(ends, format_of(mode), a.ends), mode);
    for (int i = 0; i < ranking.n; ++i) {
      const Format f = format_of(ranking.id[i]);
      a.mode = f.mode;
      a.partition = partition_;
      round_ends<regions, 2>(ends, f, a.ends);
      for (int round = 0;; ++round) {
        const Lane second = evaluate<regions>(s_.target, r_, f, a);
        least_ = min(least_, a.error);
        keep_better<regions>(a, best);
        if constexpr (regions == 2) keep_parts(a, second);
        if (round == depth_.refinements) break;
        Fit fit[regions][3];
        least_squares<regions, true>(s_.target, r_, &f, &a, a.index, fit);
        round_ends<regions, 2>(fit, f, a.ends);
      }
    }
  }

  // What each region did best with, whatever the other one did.
  HWY_ATTR HWY_INLINE void keep_parts(const Candidate& a, Lane error_of_second) {
    const Lane errors[2] = {a.error - error_of_second, error_of_second};
    const LaneMask better[2] = {errors[0] < parts_error_[0], errors[1] < parts_error_[1]};
    for (int g = 0; g < 2; ++g) parts_error_[g] = min(parts_error_[g], errors[g]);
    for (int k = 0; k < 16; ++k) {
      parts_index_[k] = select(r_.second[k], select(better[1], a.index[k], parts_index_[k]),
                               select(better[0], a.index[k], parts_index_[k]));
    }
  }

  // One region from all parts of its line, the other one as it did best.
  HWY_ATTR HWY_NOINLINE void exchange(const Lane whole[16], Candidate& best) {
    for (int g = 0; g < 2; ++g) {
      Lane other[16], index[16];
      for (int k = 0; k < 16; ++k) other[k] = parts_index_[k];
      for (const auto& [from, to] : exchange_spans) {
        for (int k = 0; k < 16; ++k) {
          const Lane here = round(whole[k] * (to - from) + from);
          index[k] = by_region<regions>(r_, k, g == 0 ? here : other[k], g == 1 ? here : other[k]);
        }
        try_indices(index, 1, best);
      }
    }
    try_indices(parts_index_, 1, best);
  }

  const Search& s_;
  Lane partition_;
  Depth depth_{};
  Regions r_;
  Lane least_ = most;
  Lane parts_error_[2] = {most, most}, parts_index_[16];
};

// The diagonals of the texels' bounding box, both ways: the simplest encoding, which no block is to be worse than.
HWY_NOINLINE void try_box(const Search& s, Candidate& best) {
  const Format f = format_of(box_mode);
  Candidate a;
  a.mode = f.mode;
  a.partition = 0.0;
  Lane low[3], high[3], along_green[3];
  for (int c = 0; c < 3; ++c) {
    low[c] = high[c] = s.target.u[0][c];
    along_green[c] = 0.0;
    for (int k = 0; k < 16; ++k) {
      low[c] = min(low[c], s.target.u[k][c]);
      high[c] = max(high[c], s.target.u[k][c]);
      along_green[c] = along_green[c] + s.levels.xx[k][c == 0 ? 1 : c + 2];
    }
  }
  for (const bool turn : {false, true}) {
    for (int c = 0; c < 3; ++c) {
      const LaneMask down = along_green[c] < 0.0;
      const Lane p = quantize(f, s.target.base[c] + select(down, high[c], low[c]));
      const Lane q = quantize(f, s.target.base[c] + select(down, low[c], high[c]));
      a.ends[0][c] = turn ? q : p;
      a.ends[1][c] = turn ? p : q;
    }
    evaluate<1>(s.target, Regions(), f, a);
    keep_better<1>(a, best);
  }
}

// Steps of one channel of one region's line: both end points at once, up to `reach` either way, indices chosen anew.
// The other channels' errors stay what they are, so a step costs a fraction of an evaluation.
template <int regions>
HWY_NOINLINE void step_channel(const Target& t, const Regions& r, const Format& f, int region, int channel, int reach,
                               Candidate& a) {
  constexpr int count = regions == 1 ? 16 : 8;
  Lane rest[16][count], palette[count];
  for (int k = 0; k < 16; ++k)
    for (int i = 0; i < count; ++i) rest[k][i] = 0.0;
  Lane(&ends)[4][3] = a.ends;
  for (int c = 0; c < 3; ++c) {
    if (c == channel) continue;
    palette_of<regions>(f, ends[2 * region][c], ends[2 * region + 1][c], palette);
    for (int k = 0; k < 16; ++k)
      for (int i = 0; i < count; ++i) {
        const Lane e = palette[i] - t.level[k][c];
        rest[k][i] = rest[k][i] + e * e;
      }
  }
  for (int k = 0; k < 16; ++k)
    for (int i = count / 2; i < count; ++i) rest[k][i] = forbid_at_anchor<regions>(r, k, rest[k][i]);
  const Lane first = ends[2 * region][channel], second = ends[2 * region + 1][channel];
  const auto error_of = [&](Lane p, Lane q) HWY_ATTR {
    palette_of<regions>(f, p, q, palette);
    Lane sum = 0.0;
    for (int k = 0; k < 16; ++k) {
      Lane least = most;
      for (int i = 0; i < (k == 0 ? count / 2 : count); ++i) {
        const Lane e = palette[i] - t.level[k][channel];
        least = min(least, rest[k][i] + e * e);
      }
      sum = sum + by_region<regions>(r, k, region == 0 ? least * t.emphasis[k] : 0.0,
                                     region == 1 ? least * t.emphasis[k] : 0.0);
    }
    return sum;
  };
  Lane least = error_of(first, second);
  for (int i = -reach; i <= reach; ++i)
    for (int j = -reach; j <= reach; ++j) {
      if (i == 0 && j == 0) continue;
      const Lane p = first + i, q = second + j;
      LaneMask valid = (p >= 0.0) & (p <= f.top) & (q >= 0.0) & (q <= f.top);
      const Lane base = region == 0 ? p : ends[0][channel];
      const auto reaches = [&](Lane end)
                               HWY_ATTR { return (end >= base + f.low[channel]) & (end <= base + f.high[channel]); };
      valid = valid & reaches(q);
      if (region == 1) valid = valid & reaches(p);
      if (region == 0 && regions == 2) valid = valid & reaches(ends[2][channel]) & reaches(ends[3][channel]);
      const Lane error = select(valid, error_of(p, q), most);
      const LaneMask better = error < least;
      least = min(error, least);
      ends[2 * region][channel] = select(better, p, ends[2 * region][channel]);
      ends[2 * region + 1][channel] = select(better, q, ends[2 * region + 1][channel]);
    }
}

// Whether a candidate's end points are what its mode can hold.
template <int regions>
HWY_INLINE LaneMask holds(const Format& f, const Candidate& a) {
  LaneMask valid = f.top >= 0.0;
  for (int e = 0; e < 2 * regions; ++e)
    for (int c = 0; c < 3; ++c) {
      const Lane q = a.ends[e][c], first = a.ends[0][c];
      valid = valid & (q >= 0.0) & (q <= f.top);
      if (e > 0) valid = valid & (q >= first + f.low[c]) & (q <= first + f.high[c]);
    }
  return valid;
}

// Steps of end points, as long as they help: a channel's two of a region, then an end point or a line as a whole.
template <int regions>
HWY_NOINLINE void polish(const Search& s, const Settings& settings, Candidate& best) {
  Regions r;
  if constexpr (regions == 2) r = regions_of(best.partition);
  const Format f = format_of(best.mode);
  const auto attempt = [&](Candidate a) HWY_ATTR {
    const LaneMask valid = holds<regions>(f, a) & (best.error < most);
    evaluate<regions>(s.target, r, f, a);
    a.error = select(valid, a.error, most);
    keep_better<regions>(a, best);
  };
  const auto shifted = [&](int first, int last, int step) HWY_ATTR {
    Candidate a = best;
    for (int e = first; e <= last; ++e)
      for (Lane& q : a.ends[e]) q = q + step;
    return a;
  };
  for (int round = 0; round < settings.polish; ++round) {
    const Lane before = best.error;
    Candidate a = best;
    for (int g = 0; g < regions; ++g)
      for (int c = 0; c < 3; ++c) step_channel<regions>(s.target, r, f, g, c, settings.reach, a);
    attempt(a);
    for (int g = 0; g < regions; ++g)
      for (const int step : {-1, 1}) {
        attempt(shifted(2 * g, 2 * g, step));
        attempt(shifted(2 * g + 1, 2 * g + 1, step));
        attempt(shifted(2 * g, 2 * g + 1, step));
      }
    for (int e = 0; s.target.balanced && e < 2 * regions;
         ++e)  // single steps, which the first ones chose by texels alone
      for (int c = 0; c < 3; ++c)
        for (const int step : {-2, -1, 1, 2}) {
          Candidate b = best;
          b.ends[e][c] = b.ends[e][c] + step;
          attempt(b);
        }
    if (hn::AllFalse(LaneTag(), (best.error < before).m)) break;
  }
}

HWY_INLINE void store(const Candidate& a, int n, Block* blocks, float* errors) {
  const LaneTag tag;
  alignas(64) float values[hn::MaxLanes(tag)];
  hn::Store(a.error.v, tag, values);
  std::copy_n(values, n, errors);
  const auto each = [&](Lane lane, auto set) HWY_ATTR {
    hn::Store(lane.v, tag, values);
    for (int i = 0; i < n; ++i) set(blocks[i], static_cast<int>(values[i]));
  };
  each(a.mode, [](Block& b, int value) { b.mode = value; });
  each(a.partition, [](Block& b, int value) { b.partition = value; });
  for (std::size_t e = 0; e < 4; ++e)
    for (std::size_t c = 0; c < 3; ++c) each(a.ends[e][c], [=](Block& b, int value) { b.ends[e][c] = value; });
  for (std::size_t k = 0; k < 16; ++k)
    each(a.index[k], [=](Block& b, int value) { b.index[k] = static_cast<std::uint8_t>(value); });
}

void search(const Texels& texels, int n, const Settings& settings, Block* blocks, float* errors) {
  const int lanes = static_cast<int>(hn::Lanes(LaneTag()));
  const Depth depth{settings.spans, settings.modes, settings.refinements, settings.exchanges, settings.other_lines};
  const Depth first_look{settings.first_spans, 1, 0};
  for (int first = 0; first < n; first += lanes) {
    Search s;
    load(texels, first, s.target);
    load(s.target.level, s.levels);
    load(s.target.u, s.bits);
    Candidate one, two;
    clear(one);
    clear(two);
    try_box(s, one);
    Trial<1>(s, 0.0).run(depth, one);
    polish<1>(s, settings, one);
    Least<partition_count> likely(settings.partitions), survivors(settings.survivors);
    rank_partitions(s.levels, likely);
    for (int i = 0; i < likely.n; ++i) survivors.offer(Trial<2>(s, likely.id[i]).run(first_look, two), likely.id[i]);
    for (int i = 0; i < survivors.n; ++i) {
      Candidate a;
      clear(a);
      Trial<2>(s, survivors.id[i]).run(depth, a);
      if (settings.polish_all) polish<2>(s, settings, a);
      keep_better<2>(a, two);
    }
    if (!settings.polish_all) polish<2>(s, settings, two);
    keep_better<2>(two, one);
    store(one, std::min(lanes, n - first), blocks + first, errors + first);
  }
}

}  // namespace envconv::bc6h::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace envconv::bc6h {

HWY_EXPORT(search);

void search(const Texels& texels, int n, const Settings& settings, Block* blocks, float* errors) {
  HWY_DYNAMIC_DISPATCH(search)(texels, n, settings, blocks, errors);
}

}  // namespace envconv::bc6h
#endif
