// SPDX-License-Identifier: Apache-2.0
#include "bc6h_search.h"

#include <algorithm>

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

// The part of the line between the end points that texels are put on at first.  Beside all of it: end points outside
// the texels' range often hit them better, where they are rounded coarsely.
constexpr double spans[most_spans][2] = {{0, 1},           {0, 5. / 7},     {1. / 7, 6. / 7}, {0, 4. / 7},
                                         {2. / 7, 1},      {1. / 7, 1},     {0, 6. / 7},      {3. / 7, 1},
                                         {2. / 7, 5. / 7}, {1. / 7, 4. / 7}};

struct Depth {
  int spans, modes, refinements;
  bool other_lines;
};

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

// Tries a partition from several starts, each in the modes whose rounding suits it; returns the least error.
template <int regions>
HWY_NOINLINE Lane try_partition(const Search& s, Lane partition, Depth depth, Candidate& best) {
  constexpr int first_mode = regions == 1 ? two_region_modes : 0, end = regions == 1 ? mode_count : two_region_modes;
  Regions r;
  if constexpr (regions == 2) r = regions_of(partition);
  Lane place[16], least = most;
  project<regions>(s.levels, r, principal_axes<regions>(s.levels, r), 0, place);
  for (int start = 0; start < depth.spans + (depth.other_lines ? other_lines(regions) : 0); ++start) {
    const int other = start - depth.spans;
    if (other >= 0) project_other<regions>(s, r, other, place);
    const auto& [from, to] = spans[other >= 0 ? 0 : start];
    constexpr double last = regions == 1 ? 15 : 7;
    Lane index[16];
    for (int k = 0; k < 16; ++k) index[k] = round((place[k] * (to - from) + from) * last);
    Fit ends[regions][3];
    least_squares<regions, false>(s.target, r, nullptr, nullptr, index, ends);
    Least<mode_count> ranking(std::min(depth.modes, end - first_mode));
    Candidate a;
    for (int mode = first_mode; mode < end; ++mode)
      ranking.offer(round_ends<regions, 1>(ends, format_of(mode), a.ends), mode);
    for (int i = 0; i < ranking.n; ++i) {
      const Format f = format_of(ranking.id[i]);
      a.mode = f.mode;
      a.partition = partition;
      round_ends<regions, 2>(ends, f, a.ends);
      for (int round = 0;; ++round) {
        evaluate<regions>(s.target, r, f, a);
        least = min(least, a.error);
        keep_better<regions>(a, best);
        if (round == depth.refinements) break;
        Fit fit[regions][3];
        least_squares<regions, true>(s.target, r, &f, &a, a.index, fit);
        round_ends<regions, 2>(fit, f, a.ends);
      }
    }
  }
  return least;
}

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

// Steps of end points, as long as they help: each number on its own, a region's two of a channel together and against
// each other, an end point as a whole.
template <int regions>
HWY_NOINLINE void polish(const Search& s, const Settings& settings, Candidate& best) {
  constexpr int count = 2 * regions;
  Regions r;
  if constexpr (regions == 2) r = regions_of(best.partition);
  const Format f = format_of(best.mode);
  const auto attempt = [&](const double(&move)[4][3], int step) HWY_ATTR {
    Candidate a = best;
    LaneMask valid = best.error <= most;
    for (int e = 0; e < count; ++e)
      for (int c = 0; c < 3; ++c) {
        const Lane q = a.ends[e][c] + move[e][c] * step, first = a.ends[0][c];
        a.ends[e][c] = q;
        valid = valid & (q >= 0.0) & (q <= f.top);
        if (e > 0) valid = valid & (q >= first + f.low[c]) & (q <= first + f.high[c]);
      }
    evaluate<regions>(s.target, r, f, a);
    a.error = select(valid, a.error, most);
    keep_better<regions>(a, best);
  };
  const auto both_ways = [&](const double(&move)[4][3], int step) HWY_ATTR {
    attempt(move, step);
    attempt(move, -step);
  };
  for (int round = 0; round < settings.polish; ++round) {
    const Lane before = best.error;
    for (int step = settings.reach; step > 0; step /= 2)
      for (int e = 0; e < count; ++e) {
        double whole[4][3] = {};
        for (int c = 0; c < 3; ++c) {
          double one[4][3] = {};
          one[e][c] = whole[e][c] = 1;
          both_ways(one, step);
          one[e ^ 1][c] = e & 1 ? 1 : -1;  // the region's other end point
          both_ways(one, step);
        }
        both_ways(whole, step);
      }
    if (hn::AllFalse(LaneTag(), (best.error < before).m)) break;
  }
}

HWY_INLINE void store(const Candidate& a, int n, Block* blocks) {
  const LaneTag tag;
  alignas(64) float values[hn::MaxLanes(tag)];
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

void search(const Texels& texels, int n, const Settings& settings, Block* blocks) {
  const int lanes = static_cast<int>(hn::Lanes(LaneTag()));
  for (int first = 0; first < n; first += lanes) {
    Search s;
    load(texels, first, s.target);
    load(s.target.level, s.levels);
    load(s.target.u, s.bits);
    Candidate one, two;
    clear(one);
    clear(two);
    const Depth depth{settings.spans, settings.modes, settings.refinements, settings.other_lines};
    try_box(s, one);
    try_partition<1>(s, 0.0, depth, one);
    Least<partition_count> likely(settings.partitions), survivors(settings.survivors);
    rank_partitions(s.levels, likely);
    for (int i = 0; i < likely.n; ++i)
      survivors.offer(try_partition<2>(s, likely.id[i], {1, 1, 0, false}, two), likely.id[i]);
    for (int i = 0; i < survivors.n; ++i) try_partition<2>(s, survivors.id[i], depth, two);
    polish<1>(s, settings, one);
    polish<2>(s, settings, two);
    keep_better<2>(two, one);
    store(one, std::min(lanes, n - first), blocks + first);
  }
}

}  // namespace envconv::bc6h::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace envconv::bc6h {

HWY_EXPORT(search);

void search(const Texels& texels, int n, const Settings& settings, Block* blocks) {
  HWY_DYNAMIC_DISPATCH(search)(texels, n, settings, blocks);
}

}  // namespace envconv::bc6h
#endif
