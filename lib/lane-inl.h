// SPDX-License-Identifier: Apache-2.0
// SIMD registers of floats with the words of kernel_math.h, for files that are compiled once per target:
//
//     #undef HWY_TARGET_INCLUDE
//     #define HWY_TARGET_INCLUDE "NAME.cpp"
//     #include "lane-inl.h"

// Once per file, whatever the number of targets.
#ifndef ENVCONV_LANE_ONCE
#define ENVCONV_LANE_ONCE
// SVE and RVV vectors cannot be members of a class; SSSE3 and the Ice Lake target bring nothing over their neighbours.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV | HWY_SSSE3 | HWY_AVX3_DL)
#include "kernel_math.h"
#endif

#include "hwy/foreach_target.h"
#include "hwy/highway.h"

// Once per target.
#if defined(ENVCONV_LANE_TARGET) == defined(HWY_TARGET_TOGGLE)
#ifdef HWY_TARGET_TOGGLE
#undef ENVCONV_LANE_TARGET
#else
#define ENVCONV_LANE_TARGET
#endif

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using LaneTag = hn::ScalableTag<float>;

// Words of the vocabulary must vanish into the loops, and g++ gives in-class friends the target only when told.
#undef ENVCONV_WORD
#define ENVCONV_WORD friend HWY_ATTR HWY_INLINE

/// Result of comparing lanes.
struct LaneMask {
  hn::Mask<LaneTag> m;
  ENVCONV_WORD LaneMask operator&(LaneMask a, LaneMask b) { return {hn::And(a.m, b.m)}; }
  ENVCONV_WORD LaneMask operator|(LaneMask a, LaneMask b) { return {hn::Or(a.m, b.m)}; }
};

/// One SIMD register of floats with the words of kernel_math.h.
struct Lane {
  hn::Vec<LaneTag> v;

  Lane() = default;
  HWY_ATTR HWY_INLINE Lane(hn::Vec<LaneTag> vector) : v(vector) {}  // NOLINT: wraps
  HWY_ATTR HWY_INLINE Lane(double constant)
      : v(hn::Set(LaneTag(), static_cast<float>(constant))) {}  // NOLINT: constants convert

  ENVCONV_WORD Lane operator+(Lane a, Lane b) { return hn::Add(a.v, b.v); }
  ENVCONV_WORD Lane operator-(Lane a, Lane b) { return hn::Sub(a.v, b.v); }
  ENVCONV_WORD Lane operator*(Lane a, Lane b) { return hn::Mul(a.v, b.v); }
  ENVCONV_WORD Lane operator/(Lane a, Lane b) { return hn::Div(a.v, b.v); }
  ENVCONV_WORD Lane operator-(Lane a) { return hn::Neg(a.v); }
  ENVCONV_WORD LaneMask operator<(Lane a, Lane b) { return {hn::Lt(a.v, b.v)}; }
  ENVCONV_WORD LaneMask operator<=(Lane a, Lane b) { return {hn::Le(a.v, b.v)}; }
  ENVCONV_WORD LaneMask operator>(Lane a, Lane b) { return {hn::Gt(a.v, b.v)}; }
  ENVCONV_WORD LaneMask operator>=(Lane a, Lane b) { return {hn::Ge(a.v, b.v)}; }
  ENVCONV_WORD Lane abs(Lane a) { return hn::Abs(a.v); }
  ENVCONV_WORD Lane min(Lane a, Lane b) { return hn::Min(a.v, b.v); }
  ENVCONV_WORD Lane max(Lane a, Lane b) { return hn::Max(a.v, b.v); }
  ENVCONV_WORD Lane sqrt(Lane a) { return hn::Sqrt(a.v); }
  ENVCONV_WORD Lane floor(Lane a) { return hn::Floor(a.v); }
  ENVCONV_WORD Lane copysign(Lane magnitude, Lane sign) { return hn::CopySign(magnitude.v, sign.v); }
  ENVCONV_WORD Lane select(LaneMask condition, Lane yes, Lane no) { return hn::IfThenElse(condition.m, yes.v, no.v); }
  ENVCONV_WORD Lane named(Lane a, const char*) { return a; }

  template <std::size_t N>
  ENVCONV_WORD Lane lookup(const Table<N>& table, Lane i) {
    const LaneTag d;
    const hn::RebindToSigned<LaneTag> di;
    const auto index = hn::ConvertTo(di, i.v);
    // Gathers are slow: tables that fit into a vector or two are permuted.
    constexpr std::size_t lanes = hn::MaxLanes(LaneTag());
    if constexpr (lanes >= 8 && N <= 2 * lanes) {
      const auto in = [&](std::size_t first) HWY_ATTR { return hn::LoadU(d, table.f + first); };
      const auto within = hn::IndicesFromVec(d, hn::And(index, hn::Set(di, static_cast<std::int32_t>(lanes) - 1)));
      const auto low = hn::TableLookupLanes(in(0), within);
      if constexpr (N <= lanes) return low;
      const auto beyond = hn::RebindMask(d, hn::Gt(index, hn::Set(di, static_cast<std::int32_t>(lanes) - 1)));
      return hn::IfThenElse(beyond, hn::TableLookupLanes(in(lanes), within), low);
    } else {
      return hn::GatherIndex(d, table.f, index);
    }
  }

  // Polynomials: minimax fits by iteratively reweighted Chebyshev least squares; the errors given are of the exact
  // polynomial, and float rounding comes on top.
  ENVCONV_WORD void sincos_turns(Lane t, Lane& s, Lane& c) {
    const hn::RebindToSigned<LaneTag> di;
    const auto quarter = hn::Floor(hn::Add(hn::Mul(t.v, hn::Set(LaneTag(), 4.0f)), hn::Set(LaneTag(), 0.5f)));
    const Lane r = t - Lane(quarter) * 0.25;  // |r| <= 1/8, exact
    const Lane r2 = r * r;
    // sin(2 pi r) / r, relative error 4e-9; cos(2 pi r), absolute error 5e-11.
    const Lane s0 = r * (6.283185288 + r2 * (-41.34166262 + r2 * (81.59255101 + r2 * -75.40193838)));
    const Lane c0 = 1.0 + r2 * (-19.73920865 + r2 * (64.93931619 + r2 * (-85.44284938 + r2 * 59.22030684)));
    const auto q = hn::ConvertTo(di, quarter);
    const auto one = hn::Set(di, 1), two = hn::Set(di, 2);
    const auto odd = hn::RebindMask(LaneTag(), hn::Eq(hn::And(q, one), one));
    // Signs: the sine's changes in quarters 2 and 3, the cosine's in 1 and 2.
    const auto s_sign = hn::BitCast(LaneTag(), hn::ShiftLeft<30>(hn::And(q, two)));
    const auto c_sign = hn::BitCast(LaneTag(), hn::ShiftLeft<30>(hn::And(hn::Add(q, one), two)));
    s = hn::Xor(hn::IfThenElse(odd, c0.v, s0.v), s_sign);
    c = hn::Xor(hn::IfThenElse(odd, s0.v, c0.v), c_sign);
  }

  ENVCONV_WORD Lane atan2_turns(Lane y, Lane x) {
    const Lane ax = abs(x), ay = abs(y);
    const Lane big = max(ax, ay), small = min(ax, ay);
    const Lane q = select(big > 0.0, small / big, 0.0);
    const Lane q2 = q * q;
    // atan(q) / (2 pi q) on [0,1], relative error 1.8e-8.
    const Lane p =
        1.591549409e-01 +
        q2 * (-5.305126670e-02 +
              q2 * (3.181993347e-02 +
                    q2 * (-2.261135205e-02 +
                          q2 * (1.695743202e-02 +
                                q2 * (-1.199018813e-02 +
                                      q2 * (6.849892584e-03 + q2 * (-2.591499094e-03 + q2 * 4.621091555e-04)))))));
    Lane a = q * p;
    a = select(ay > ax, 0.25 - a, a);
    a = select(x < 0.0, 0.5 - a, a);
    return copysign(a, y);
  }

  ENVCONV_WORD Lane exp(Lane x) {
    // exp(x/4) to the fourth; on |x/4| <= 0.6 the polynomial's relative error is 6e-9.
    const Lane t = x * 0.25;
    const Lane p =
        9.999999967e-01 +
        t * (9.999999971e-01 +
             t * (5.000002917e-01 +
                  t * (1.666667558e-01 +
                       t * (4.166261870e-02 + t * (8.332568906e-03 + t * (1.406846565e-03 + t * 2.009063774e-04))))));
    const Lane p2 = p * p;
    return p2 * p2;
  }

  ENVCONV_WORD Lane atanh(Lane x) {
    // atanh x = 2 atanh(x / (1 + sqrt(1 - x^2))) brings |x| <= 0.75 below 0.46; relative error 2e-8 there.
    const Lane t = x / (1.0 + sqrt(1.0 - x * x));
    const Lane t2 = t * t;
    return 2.0 * t *
           (9.999999787e-01 +
            t2 * (3.333392439e-01 +
                  t2 * (1.997356293e-01 + t2 * (1.471353480e-01 + t2 * (8.060744310e-02 + t2 * 1.844615507e-01)))));
  }
};

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // once per target
