// SPDX-License-Identifier: Apache-2.0
// Lines through a block's texels, a block a lane, and where along them the texels are.  Included once per SIMD target
// by bc6h_search.cpp.

// Once per target.
#if defined(ENVCONV_BC6H_LINES_TARGET) == defined(HWY_TARGET_TOGGLE)
#ifdef HWY_TARGET_TOGGLE
#undef ENVCONV_BC6H_LINES_TARGET
#else
#define ENVCONV_BC6H_LINES_TARGET
#endif

HWY_BEFORE_NAMESPACE();
namespace envconv::bc6h::HWY_NAMESPACE {

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

}  // namespace envconv::bc6h::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // once per target
