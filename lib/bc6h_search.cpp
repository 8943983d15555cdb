// SPDX-License-Identifier: Apache-2.0
#include "bc6h_search.h"

#include <algorithm>
#include <array>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "bc6h_search.cpp"
#include "lane-inl.h"
// After it, since it brings Lane.
#include "bc6h_lanes-inl.h"
#include "bc6h_lines-inl.h"

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

// Blocks of four colours, rows or columns being alike, do best with two of them a region: replaces the last of the
// partitions by that.  Which one does best at first is a matter of luck in rounding.
HWY_INLINE void add_halves(const Target& t, Least<partition_count>& partitions) {
  constexpr double left_and_right = 0, upper_and_lower = 13;
  LaneMask rows = equal(t.u[0][0], t.u[0][0]), columns = rows;
  for (int k = 1; k < 16; ++k)
    for (int c = 0; c < 3; ++c) {
      rows = rows & equal(t.u[k][c], t.u[k / 4 * 4][c]);
      columns = columns & equal(t.u[k][c], t.u[k % 4][c]);
    }
  const Lane halves = select(rows, Lane(upper_and_lower), left_and_right);
  Lane& last = partitions.id[partitions.n - 1];
  const Lane kept = select(equal(partitions.id[0], halves), last, halves);
  last = select(rows | columns, kept, last);
}

// How a partition is tried.
struct Depth {
  int spans, refinements;
  int combined = 0, combined_modes = 0;
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

// All parts, the longest first; of two regions' lines also some the other way round.
template <int regions>
constexpr auto all_spans = [] {
  constexpr int last = regions == 1 ? 15 : 7;
  std::array<std::array<double, 2>, most_combined[regions - 1]> all{
      {{6, 1}, {6, 0}, {5, 2}, {5, 1}, {5, 0}, {4, 2}, {4, 1}, {4, 0}, {3, 1}, {3, 0}, {2, 0}, {3, 2}}};
  std::rotate(all.begin(), all.begin() + 12, all.end());
  std::size_t n = 0;
  for (int length = last; length > 0; --length)
    for (int from = 0; from + length <= last; ++from)
      all[n++] = {static_cast<double>(from), static_cast<double>(from + length)};
  return all;
}();

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
      try_indices(index, best);
    }
    if (depth.combined > 0) combine(whole, best);
    for (int line = 0; depth.other_lines && line < other_lines(regions); ++line) {
      project_other<regions>(s_, r_, line, index);
      for (int k = 0; k < 16; ++k) index[k] = index_at<regions>(index[k], 0);
      try_indices(index, best);
    }
    if constexpr (regions == 2) {
      if (depth.spans > 1) try_indices(parts_index_, best);
      for (int round = 0; round < depth.exchanges; ++round) exchange(whole, best);
    }
    return least_;
  }

 private:
  static constexpr int first_mode = regions == 1 ? two_region_modes : 0;
  static constexpr int end_mode = regions == 1 ? mode_count : two_region_modes;

  // In the mode whose rounding suits these indices.
  HWY_ATTR HWY_NOINLINE void try_indices(const Lane index[16], Candidate& best) {
    Fit ends[regions][3];
    least_squares<regions, false>(s_.target, r_, nullptr, nullptr, index, ends);
    Least<1> least(1);
    for (int mode = first_mode; mode < end_mode; ++mode) {
      Lane cost[regions];
      rounding_costs<regions>(ends, format_of(mode), cost);
      least.offer(regions == 1 ? cost[0] : cost[0] + cost[regions - 1], mode);
    }
    try_mode(ends, least.id[0], best);
  }

  // In one mode.
  HWY_ATTR HWY_NOINLINE void try_mode(const Fit ends[regions][3], Lane mode, Candidate& best) {
    const Format f = format_of(mode);
    Candidate a;
    a.mode = mode;
    a.partition = partition_;
    round_ends<regions>(ends, f, a.ends);
    for (int round = 0;; ++round) {
      const Lane second = evaluate<regions>(s_.target, r_, f, a);
      least_ = min(least_, a.error);
      keep_better<regions>(a, best);
      if constexpr (regions == 2) keep_parts(a, second);
      if (round == depth_.refinements) break;
      Fit fit[regions][3];
      least_squares<regions, true>(s_.target, r_, &f, &a, a.index, fit);
      round_ends<regions>(fit, f, a.ends);
    }
  }

  // The part of a region's line that suits it best in a mode.
  struct Part {
    Lane cost, from, to;
  };

  // By what least squares leave of the error and rounding adds to it.
  HWY_ATTR HWY_NOINLINE void find_parts(const Lane place[16], int count, Part parts[mode_count][regions]) {
    for (int mode = first_mode; mode < end_mode; ++mode)
      for (int g = 0; g < regions; ++g) parts[mode][g] = {most, 0.0, 0.0};
    for (int span = 0; span < count; ++span) {
      const auto& [from, to] = all_spans<regions>[static_cast<std::size_t>(span)];
      Lane index[16];
      for (int k = 0; k < 16; ++k) index[k] = round(place[k] * (to - from) + from);
      Fit ends[regions][3];
      least_squares<regions, false>(s_.target, r_, nullptr, nullptr, index, ends);
      for (int mode = first_mode; mode < end_mode; ++mode) {
        Lane cost[regions];
        rounding_costs<regions>(ends, format_of(mode), cost);
        for (int g = 0; g < regions; ++g) {
          Part& part = parts[mode][g];
          const Lane now = cost[g] - (ends[g][0].explained + ends[g][1].explained + ends[g][2].explained);
          const LaneMask better = now < part.cost;
          part = {min(now, part.cost), select(better, from, part.from), select(better, to, part.to)};
        }
      }
    }
  }

  // The regions' best parts together, in the modes where they cost least.
  HWY_ATTR HWY_NOINLINE void combine(const Lane place[16], Candidate& best) {
    Part parts[mode_count][regions];
    find_parts(place, depth_.combined, parts);
    Least<mode_count> ranking(depth_.combined_modes);
    for (int mode = first_mode; mode < end_mode; ++mode)
      ranking.offer(regions == 1 ? parts[mode][0].cost : parts[mode][0].cost + parts[mode][regions - 1].cost, mode);
    for (int i = 0; i < ranking.n; ++i) {
      Lane from[regions], to[regions], index[16];
      for (int g = 0; g < regions; ++g) {
        from[g] = to[g] = 0.0;
        for (int mode = first_mode; mode < end_mode; ++mode) {
          const LaneMask chosen = equal(ranking.id[i], mode);
          from[g] = select(chosen, parts[mode][g].from, from[g]);
          to[g] = select(chosen, parts[mode][g].to, to[g]);
        }
      }
      for (int k = 0; k < 16; ++k) {
        const Lane start = by_region<regions>(r_, k, from[0], from[regions - 1]);
        index[k] = round(place[k] * (by_region<regions>(r_, k, to[0], to[regions - 1]) - start) + start);
      }
      Fit ends[regions][3];
      least_squares<regions, false>(s_.target, r_, nullptr, nullptr, index, ends);
      try_mode(ends, ranking.id[i], best);
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
        try_indices(index, best);
      }
    }
    try_indices(parts_index_, best);
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
  const Regions r = regions == 2 ? regions_of(best.partition) : Regions();
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

HWY_INLINE void store(const Target& t, const Candidate& a, const Lane difference[3], int n, Found* found) {
  const LaneTag tag;
  alignas(64) float values[hn::MaxLanes(tag)];
  const auto each = [&](Lane lane, auto set) HWY_ATTR {
    hn::Store(lane.v, tag, values);
    for (int i = 0; i < n; ++i) set(found[i], values[i]);
  };
  each(a.error, [](Found& b, float value) { b.error = value; });
  each(a.mode, [](Found& b, float value) { b.block.mode = static_cast<int>(value); });
  each(a.partition, [](Found& b, float value) { b.block.partition = static_cast<int>(value); });
  for (std::size_t c = 0; c < 3; ++c) {
    each(t.sum[c], [=](Found& b, float value) { b.sum[c] = value; });
    each(difference[c], [=](Found& b, float value) { b.difference[c] = value; });
    for (std::size_t e = 0; e < 4; ++e)
      each(a.ends[e][c], [=](Found& b, float value) { b.block.ends[e][c] = static_cast<int>(value); });
  }
  for (std::size_t k = 0; k < 16; ++k)
    each(a.index[k], [=](Found& b, float value) { b.block.index[k] = static_cast<std::uint8_t>(value); });
}

void search(const Texels& texels, int n, const Settings& settings, Found* found) {
  const int lanes = static_cast<int>(hn::Lanes(LaneTag()));
  const auto depth = [&](int regions) -> Depth {
    const int i = regions - 1;
    return {settings.spans[i],       settings.refinements, settings.combined[i],
            settings.combined_modes, settings.exchanges,   settings.other_lines};
  };
  const Depth first_look{settings.first_spans, 0};
  for (int first = 0; first < n; first += lanes) {
    Search s;
    load(texels, first, s.target);
    load(s.target.level, s.levels);
    load(s.target.u, s.bits);
    Candidate one, two;
    clear(one);
    clear(two);
    try_box(s, one);
    Trial<1>(s, 0.0).run(depth(1), one);
    polish<1>(s, settings, one);
    Least<partition_count> likely(settings.partitions), survivors(settings.survivors);
    rank_partitions(s.levels, likely);
    for (int i = 0; i < likely.n; ++i) survivors.offer(Trial<2>(s, likely.id[i]).run(first_look, two), likely.id[i]);
    add_halves(s.target, survivors);
    for (int i = 0; i < survivors.n; ++i) {
      Candidate a;
      clear(a);
      Trial<2>(s, survivors.id[i]).run(depth(2), a);
      if (settings.polish_all) polish<2>(s, settings, a);
      keep_better<2>(a, two);
    }
    if (!settings.polish_all) polish<2>(s, settings, two);
    Lane difference[3], of_two[3];
    find_differences<1>(s.target, Regions(), format_of(one.mode), one, difference);
    find_differences<2>(s.target, regions_of(two.partition), format_of(two.mode), two, of_two);
    const LaneMask better = two.error < one.error;
    for (int c = 0; c < 3; ++c) difference[c] = select(better, of_two[c], difference[c]);
    keep_better<2>(two, one);
    store(s.target, one, difference, std::min(lanes, n - first), found + first);
  }
}

}  // namespace envconv::bc6h::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace envconv::bc6h {

HWY_EXPORT(search);

void search(const Texels& texels, int n, const Settings& settings, Found* found) {
  HWY_DYNAMIC_DISPATCH(search)(texels, n, settings, found);
}

}  // namespace envconv::bc6h
#endif
