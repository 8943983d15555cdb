// SPDX-License-Identifier: Apache-2.0
// What the BC6H search computes with, a block a lane: the error metric, formats, candidates, their error, and the end
// points that suit given indices.  Included once per SIMD target by bc6h_search.cpp.

// Once per file, whatever the number of targets.
#ifndef ENVCONV_BC6H_LANES_ONCE
#define ENVCONV_BC6H_LANES_ONCE
#include <array>

#include "bc6h_search.h"

namespace envconv::bc6h {

// The modes as tables that lanes gather from.
struct FormatTable {
  std::array<float, mode_count> step, inverse, offset, top;
  std::array<std::array<float, mode_count>, 3> low, high;
  FormatTable() {
    for (std::size_t m = 0; m < mode_count; ++m) {
      const Mode& mode = modes[m];
      step[m] = static_cast<float>(1 << (16 - mode.end_bits));
      inverse[m] = 1 / step[m];
      offset[m] = mode.end_bits == 16 ? 0 : step[m] / 2;
      top[m] = static_cast<float>((1 << mode.end_bits) - 1);
      for (std::size_t c = 0; c < 3; ++c) {
        const int reach = 1 << (mode.transformed ? mode.rest_bits[c] - 1 : mode.end_bits);
        low[c][m] = static_cast<float>(-reach);
        high[c][m] = static_cast<float>(reach - 1);
      }
    }
  }
};
inline const FormatTable& format_table() {
  static const FormatTable table;
  return table;
}

struct PartitionTable {
  std::array<std::int32_t, partition_count> mask, anchor;
  PartitionTable() {
    for (std::size_t i = 0; i < partition_count; ++i) mask[i] = partition_masks[i], anchor[i] = second_anchor[i];
  }
};
inline const PartitionTable& partition_table() {
  static const PartitionTable table;
  return table;
}

}  // namespace envconv::bc6h
#endif

// Once per target.
#if defined(ENVCONV_BC6H_LANES_TARGET) == defined(HWY_TARGET_TOGGLE)
#ifdef HWY_TARGET_TOGGLE
#undef ENVCONV_BC6H_LANES_TARGET
#else
#define ENVCONV_BC6H_LANES_TARGET
#endif

HWY_BEFORE_NAMESPACE();
namespace envconv::bc6h::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;
using envconv::HWY_NAMESPACE::Lane;
using envconv::HWY_NAMESPACE::LaneMask;
using envconv::HWY_NAMESPACE::LaneTag;
using IntTag = hn::RebindToSigned<LaneTag>;
using Ints = hn::Vec<IntTag>;

constexpr double most = 1e30;  // worse than any error

HWY_INLINE Ints ints(int value) { return hn::Set(IntTag(), value); }
HWY_INLINE Ints to_ints(Lane a) { return hn::ConvertTo(IntTag(), a.v); }
HWY_INLINE Lane from_ints(Ints a) { return hn::ConvertTo(LaneTag(), a); }
HWY_INLINE Ints bits_of(Lane a) { return hn::BitCast(IntTag(), a.v); }
HWY_INLINE Lane lane_of_bits(Ints a) { return hn::BitCast(LaneTag(), a); }
HWY_INLINE LaneMask lane_mask(hn::Mask<IntTag> m) { return {hn::RebindMask(LaneTag(), m)}; }
HWY_INLINE LaneMask equal(Lane a, Lane b) { return {hn::Eq(a.v, b.v)}; }
HWY_INLINE Lane round(Lane a) { return hn::Round(a.v); }  // halves to even
HWY_INLINE Lane clamp(Lane x, Lane low, Lane high) { return min(max(x, low), high); }
HWY_INLINE Lane where(LaneMask m, Lane x) { return hn::IfThenElseZero(m.m, x.v); }

// What unsigned halves can hold.
HWY_INLINE Lane within_halves(Lane radiance) { return min(where(radiance > 0.0, radiance), 65504.0); }

// The half bit pattern, as a number, that is nearest to x in 0 to 65504.
HWY_INLINE Lane half_code(Lane x) {
  const Ints bits = bits_of(x);
  const Ints odd = hn::And(hn::ShiftRight<13>(bits), ints(1));
  const Ints rounded = hn::ShiftRight<13>(hn::Add(bits, hn::Add(odd, ints(0xFFF))));
  return select(x < 0x1p-14, round(x * 0x1p24), from_ints(hn::Sub(rounded, ints(112 << 10))));
}

// --- the metric

// Errors are squared differences of log2(x + 1/1024), x the radiance of a channel.  Equal ratios of radiance look
// equally different, which the half bit patterns that BC6H interpolates between follow on their own, but for two
// things: they are straight within an octave, and they spend 14 of their 30 octaves below 1/1024, where nothing is seen
// beside what is brighter.  Without the second, black corners of a block would spoil the rest of it (2 dB in
// interiors). Texels of more than twice their block's mean count as many times more: a sun among black texels is what
// lights the scene, and to the logarithm it is no more than they are.
struct Level {
  Lane value;  // log2(x + 1/1024), within 0.01
  Lane slope;  // its derivative in the space of interpolation (64/31 of half bit patterns)
};
HWY_INLINE Level level_and_slope(Lane code) {
  const Ints exponent = ints(0x7F800000), one = ints(127 << 23);
  // Subnormal halves come out as a little more than they are, which 1/1024 drowns.
  const Ints x = hn::Add(hn::ShiftLeft<13>(to_ints(code)), ints(112 << 23));
  const Ints sum = bits_of(lane_of_bits(x) + 0x1p-10);
  const Lane m = lane_of_bits(hn::Or(hn::AndNot(exponent, sum), one));  // 1 to 2
  const Lane whole = from_ints(hn::Sub(sum, one)) * 0x1p-23;            // exponent + m - 1
  constexpr double bulge = 0.343;                                       // log2(m) = m - 1 + bulge (m - 1) (2 - m)
  const Lane octaves = lane_of_bits(hn::Add(hn::Sub(hn::And(x, exponent), hn::And(sum, exponent)), one));
  constexpr double scale = 31.0 / 65536;
  return {whole + (m - 1.0) * (2.0 - m) * bulge, octaves * (m * (-2 * bulge * scale) + (1 + 3 * bulge) * scale)};
}
HWY_INLINE Lane level_of(Lane code) { return level_and_slope(code).value; }

// Half bit pattern (2^-12) whose slope stands for all smaller ones: theirs vanishes, and texels would pull no more.
constexpr double darkest = 3072;
constexpr double brightest = 31743;  // 65504

// What blocks should become.
struct Target {
  Lane level[16][3];
  Lane u[16][3];       // in the space of interpolation, relative to base
  Lane emphasis[16];   // of the texel's error
  Lane weight[16][3];  // emphasis, times the squared slope of the level at u
  Lane base[3];
  Lane sum[3];  // of radiance
  float price[3];
  bool balanced;  // some price is not 0
};

HWY_INLINE void load(const Texels& texels, int first, Target& t) {
  t.balanced = false;
  for (int c = 0; c < 3; ++c) {
    t.price[c] = texels.price[c];
    t.balanced = t.balanced || t.price[c] > 0;
    t.sum[c] = 0.0;
  }
  Lane brightness[16], mean = 0.0;
  for (int k = 0; k < 16; ++k) {
    brightness[k] = 0.0;
    for (int c = 0; c < 3; ++c) {
      const Lane x = within_halves(hn::Load(LaneTag(), texels.radiance[k][c] + first)), code = half_code(x);
      const Lane u = (code + 0.5) * (64.0 / 31);  // the middle of what decodes to the code
      if (k == 0) t.base[c] = u;
      t.sum[c] = t.sum[c] + x;
      t.u[k][c] = u - t.base[c];
      t.level[k][c] = level_of(code);
      const Lane slope = level_and_slope(max(code, darkest)).slope;
      t.weight[k][c] = slope * slope;
      brightness[k] = brightness[k] + x;
    }
    mean = mean + brightness[k] * (1.0 / 16);
  }
  const Lane half_inverse = 0.5 / max(mean, 1e-30);
  for (int k = 0; k < 16; ++k) {
    t.emphasis[k] = max(brightness[k] * half_inverse, 1.0);
    for (int c = 0; c < 3; ++c) t.weight[k][c] = t.weight[k][c] * t.emphasis[k];
  }
}

// --- formats and candidates

// A mode a lane: how its end points are rounded, and how far they may be from the first one.
struct Format {
  Lane mode, step, inverse, offset, top, low[3], high[3];
};
HWY_INLINE Format format_of(int mode) {
  const FormatTable& t = format_table();
  const auto m = static_cast<std::size_t>(mode);
  return {static_cast<double>(mode),
          t.step[m],
          t.inverse[m],
          t.offset[m],
          t.top[m],
          {t.low[0][m], t.low[1][m], t.low[2][m]},
          {t.high[0][m], t.high[1][m], t.high[2][m]}};
}
HWY_INLINE Format format_of(Lane mode) {
  const FormatTable& t = format_table();
  const Ints i = to_ints(mode);
  const auto get = [i](const std::array<float, mode_count>& table)
                       HWY_ATTR -> Lane { return hn::GatherIndex(LaneTag(), table.data(), i); };
  return {mode,
          get(t.step),
          get(t.inverse),
          get(t.offset),
          get(t.top),
          {get(t.low[0]), get(t.low[1]), get(t.low[2])},
          {get(t.high[0]), get(t.high[1]), get(t.high[2])}};
}
// bc6h::unquantize and its inverse.
HWY_INLINE Lane unquantize(const Format& f, Lane q) {
  return select(equal(q, 0.0), q, select(equal(q, f.top), 65535.0, q * f.step + f.offset));
}
HWY_INLINE Lane quantize(const Format& f, Lane u) { return clamp(round((u - f.offset) * f.inverse), 0.0, f.top); }

// An encoding a lane; as bc6h::Block.
struct Candidate {
  Lane error, mode, partition;
  Lane ends[4][3];
  Lane index[16];
};
inline void clear(Candidate& a) {
  a.error = most;
  a.mode = a.partition = 0.0;
  for (auto& end : a.ends)
    for (Lane& q : end) q = 0.0;
  for (Lane& index : a.index) index = 0.0;
}
template <int regions>
HWY_INLINE void keep_better(const Candidate& a, Candidate& best) {
  const LaneMask better = a.error < best.error;
  best.error = min(a.error, best.error);
  best.mode = select(better, a.mode, best.mode);
  best.partition = select(better, a.partition, best.partition);
  for (int e = 0; e < 2 * regions; ++e)
    for (int c = 0; c < 3; ++c) best.ends[e][c] = select(better, a.ends[e][c], best.ends[e][c]);
  for (int k = 0; k < 16; ++k) best.index[k] = select(better, a.index[k], best.index[k]);
}

// A partition a lane.
struct Regions {
  LaneMask second[16];        // texel is of region 1
  LaneMask anchor2, anchor8;  // region 1's anchor is texel 2, texel 8; else it is texel 15
};
inline Regions regions_of(Lane partition) {
  const PartitionTable& table = partition_table();
  const Ints p = to_ints(partition);
  const Ints mask = hn::GatherIndex(IntTag(), table.mask.data(), p);
  const Ints anchor = hn::GatherIndex(IntTag(), table.anchor.data(), p);
  Regions r;
  for (int k = 0; k < 16; ++k) r.second[k] = lane_mask(hn::TestBit(mask, ints(1 << k)));
  r.anchor2 = lane_mask(hn::Eq(anchor, ints(2)));
  r.anchor8 = lane_mask(hn::Eq(anchor, ints(8)));
  return r;
}
template <int regions>
HWY_INLINE Lane by_region(const Regions& r, int texel, Lane first, Lane second) {
  return regions == 1 ? first : select(r.second[texel], second, first);
}

// Error of an index that a texel cannot have, its highest bit not being stored.
template <int regions>
HWY_INLINE Lane forbid_at_anchor(const Regions& r, int texel, Lane error) {
  if (regions == 1) return error;
  if (texel == 2) return select(r.anchor2, most, error);
  if (texel == 8) return select(r.anchor8, most, error);
  if (texel == 15) return select(r.anchor2 | r.anchor8, error, most);
  return error;
}

// Levels of what a decoder makes of the indices between two end points of one channel.
template <int regions>
HWY_INLINE void palette_of(const Format& f, Lane first, Lane second, Lane palette[regions == 1 ? 16 : 8]) {
  const Lane p = unquantize(f, first), difference = unquantize(f, second) - p;
  for (int i = 0; i < (regions == 1 ? 16 : 8); ++i) {
    const Lane u = floor(difference * (bc6h::weight(regions, i) / 64.0) + p + 0.5);
    palette[i] = level_of(floor(u * (31.0 / 64)));
  }
}

// The radiance of a half bit pattern.
HWY_INLINE Lane radiance_of(Lane code) {
  const Ints bits = hn::Add(hn::ShiftLeft<13>(to_ints(code)), ints(112 << 23));
  return select(code < 1024.0, code * 0x1p-24, lane_of_bits(bits));
}

// How far channels' sums are from what they should be, of a candidate with its indices.
template <int regions>
HWY_NOINLINE void find_differences(const Target& t, const Regions& r, const Format& f, const Candidate& a,
                                   Lane difference[3]) {
  for (int c = 0; c < 3; ++c) {
    Lane start[2], length[2], sum = 0.0;
    for (int g = 0; g < regions; ++g) {
      start[g] = unquantize(f, a.ends[2 * g][c]);
      length[g] = unquantize(f, a.ends[2 * g + 1][c]) - start[g];
    }
    for (int k = 0; k < 16; ++k) {
      const Lane w = round(a.index[k] * (regions == 1 ? 64.0 / 15 : 64.0 / 7)) * (1.0 / 64);
      const Lane u = by_region<regions>(r, k, length[0], length[regions - 1]) * w +
                     by_region<regions>(r, k, start[0], start[regions - 1]);
      sum = sum + radiance_of(floor(floor(u + 0.5) * (31.0 / 64)));
    }
    difference[c] = sum - t.sum[c];
  }
}

// Sets the best indices for the candidate's end points, and the error: of what a decoder makes of them, bit for bit.
// Returns the second region's part of the texels' error.
template <int regions>
HWY_NOINLINE Lane evaluate(const Target& t, const Regions& r, const Format& f, Candidate& a) {
  constexpr int count = regions == 1 ? 16 : 8;
  Lane palette[2][3][count];
  for (int g = 0; g < regions; ++g)
    for (int c = 0; c < 3; ++c) palette_of<regions>(f, a.ends[2 * g][c], a.ends[2 * g + 1][c], palette[g][c]);
  a.error = 0.0;
  Lane second = 0.0;
  for (int k = 0; k < 16; k += 2) {  // two at once, whose comparisons do not wait for each other
    Lane least[2] = {most, most}, index[2] = {0.0, 0.0};
    const auto compare = [&](int j, int i, Lane added) HWY_ATTR {
      Lane error = added;
      for (int c = 0; c < 3; ++c) {
        const Lane e = by_region<regions>(r, k + j, palette[0][c][i], palette[regions - 1][c][i]) - t.level[k + j][c];
        error = error + e * e;
      }
      index[j] = select(error < least[j], i, index[j]);
      least[j] = min(error, least[j]);
    };
#pragma GCC unroll 8
    for (int i = 0; i < count / 2; ++i) compare(0, i, 0.0), compare(1, i, 0.0);
    const Lane added[2] = {k == 0 ? Lane(most) : forbid_at_anchor<regions>(r, k, 0.0),
                           forbid_at_anchor<regions>(r, k + 1, 0.0)};
#pragma GCC unroll 8
    for (int i = count / 2; i < count; ++i) compare(0, i, added[0]), compare(1, i, added[1]);
    for (int j = 0; j < 2; ++j) {
      a.index[k + j] = index[j];
      least[j] = least[j] * t.emphasis[k + j];
      a.error = a.error + least[j];
      if constexpr (regions == 2) second = second + where(r.second[k + j], least[j]);
    }
  }
  if (t.balanced) {
    Lane difference[3];
    find_differences<regions>(t, r, f, a, difference);
    for (int c = 0; c < 3; ++c) a.error = a.error + abs(difference[c]) * static_cast<double>(t.price[c]);
  }
  return second;
}

// --- end points for given indices

// Where a region's end points should be in one channel: for end points x and y the error is
// first (x - a)^2 + second (y - b + slope (x - a))^2 and something that does not depend on them.
struct Fit {
  Lane first, second, slope, a, b;
  Lane explained;  // what is left of the error is less than the texels' own sum of squares by so much
};
// Sums over texels of weight s, the second end point's share w, and the wanted u.
struct Moments {
  Lane s, sw, sww, su, swu;
};
HWY_INLINE Moments operator-(const Moments& a, const Moments& b) {
  return {a.s - b.s, a.sw - b.sw, a.sww - b.sww, a.su - b.su, a.swu - b.swu};
}
HWY_INLINE Fit solve(const Moments& m, Lane base) {
  Fit f;
  const Lane bb = m.sww, ab = m.sw - m.sww, aa = m.s - m.sw - ab;  // of the quadratic form
  f.second = bb;
  f.slope = ab / max(bb, 1e-30);
  f.first = max(aa - ab * f.slope, 0.0);
  const Lane au = m.su - m.swu, bu = m.swu;
  const Lane determinant = aa * bb - ab * ab;
  const LaneMask regular = determinant > m.s * m.s * 1e-4;  // else all indices are alike
  const Lane inverse = 1.0 / select(regular, determinant, 1.0);
  const Lane mean = m.su / max(m.s, 1e-30);
  const Lane a = select(regular, inverse * (au * bb - bu * ab), mean);
  const Lane b = select(regular, inverse * (bu * aa - au * ab), mean);
  f.explained = a * au + b * bu;
  f.a = base + a;
  f.b = base + b;
  return f;
}

// Least squares.  With a candidate in its format, the metric's tangents at what it decodes to are used (a Gauss-Newton
// step); without, those at the texels.
template <int regions, bool tangent>
HWY_NOINLINE void least_squares(const Target& t, const Regions& r, const Format* f, const Candidate* now,
                                const Lane index[16], Fit fit[regions][3]) {
  const Moments none{0.0, 0.0, 0.0, 0.0, 0.0};
  Moments all[3] = {none, none, none}, second[3] = {none, none, none};
  Lane start[2][3], length[2][3];
  if constexpr (tangent)
    for (int g = 0; g < regions; ++g)
      for (int c = 0; c < 3; ++c) {
        start[g][c] = unquantize(*f, now->ends[2 * g][c]);
        length[g][c] = unquantize(*f, now->ends[2 * g + 1][c]) - start[g][c];
      }
  for (int k = 0; k < 16; ++k) {
    const Lane w = round(index[k] * (regions == 1 ? 64.0 / 15 : 64.0 / 7)) * (1.0 / 64);
    for (int c = 0; c < 3; ++c) {
      Lane s = t.weight[k][c], su = s * t.u[k][c];
      if constexpr (tangent) {
        const Lane u = by_region<regions>(r, k, start[0][c], start[regions - 1][c]) +
                       by_region<regions>(r, k, length[0][c], length[regions - 1][c]) * w;
        const Lane code = clamp(u * (31.0 / 64), darkest, brightest);
        const Level level = level_and_slope(code);
        const Lane pull = t.emphasis[k] * level.slope;
        s = pull * level.slope;
        su = s * (code * (64.0 / 31) - t.base[c]) - pull * (level.value - t.level[k][c]);
      }
      const Lane sw = s * w, sww = sw * w, swu = su * w;
      const auto add = [&](Moments& m) HWY_ATTR { m = {m.s + s, m.sw + sw, m.sww + sww, m.su + su, m.swu + swu}; };
      const auto add_where = [&](LaneMask in, Moments& m) HWY_ATTR {
        m = {m.s + where(in, s), m.sw + where(in, sw), m.sww + where(in, sww), m.su + where(in, su),
             m.swu + where(in, swu)};
      };
      add(all[c]);
      if constexpr (regions == 2) add_where(r.second[k], second[c]);
    }
  }
  for (int c = 0; c < 3; ++c) {
    fit[0][c] = solve(all[c] - second[c], t.base[c]);
    if constexpr (regions == 2) fit[1][c] = solve(second[c], t.base[c]);
  }
}

// A region's two end points of one channel in a format, the first one rounded to q, the second one to suit it; all but
// the first region's first one are within reach of `origin`.
struct Rounded {
  Lane q[2], cost;
};
HWY_INLINE Rounded round_pair(const Fit& x, const Format& f, int channel, Lane q, const Lane* origin) {
  const auto within = [&](Lane end, Lane first) HWY_ATTR {
    return clamp(clamp(end, first + f.low[channel], first + f.high[channel]), 0.0, f.top);
  };
  Rounded r;
  r.q[0] = origin ? within(q, *origin) : q;
  const Lane da = unquantize(f, r.q[0]) - x.a;
  const Lane suited = x.b - x.slope * da;
  r.q[1] = within(quantize(f, suited), origin ? *origin : r.q[0]);
  const Lane off = unquantize(f, r.q[1]) - suited;
  r.cost = x.first * (da * da) + x.second * (off * off);
  return r;
}

// What rounding a fit to a format costs, by region.
template <int regions>
HWY_INLINE void rounding_costs(const Fit fit[regions][3], const Format& f, Lane cost[regions]) {
  for (int g = 0; g < regions; ++g) cost[g] = 0.0;
  for (int c = 0; c < 3; ++c) {
    const Rounded first = round_pair(fit[0][c], f, c, quantize(f, fit[0][c].a), nullptr);
    cost[0] = cost[0] + first.cost;
    if constexpr (regions == 2)
      cost[1] = cost[1] + round_pair(fit[1][c], f, c, quantize(f, fit[1][c].a), &first.q[0]).cost;
  }
}

// Rounds the end points of a fit to a format: the first ones both ways, each second one to suit its first one.
template <int regions>
HWY_INLINE void round_ends(const Fit fit[regions][3], const Format& f, Lane ends[4][3]) {
  for (int c = 0; c < 3; ++c)
    for (int g = 0; g < regions; ++g) {
      const Lane* origin = g == 0 ? nullptr : &ends[0][c];
      const Lane a = fit[g][c].a, q = quantize(f, a);
      const Lane other = clamp(q + select(a > unquantize(f, q), Lane(1.0), -1.0), 0.0, f.top);
      const Rounded nearest = round_pair(fit[g][c], f, c, q, origin);
      const Rounded farther = round_pair(fit[g][c], f, c, other, origin);
      const LaneMask better = farther.cost < nearest.cost;
      for (int e = 0; e < 2; ++e) ends[2 * g + e][c] = select(better, farther.q[e], nearest.q[e]);
    }
}

}  // namespace envconv::bc6h::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // once per target
