// SPDX-License-Identifier: Apache-2.0
#include "sum_kernels.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "prefetch.h"

#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV | HWY_SSSE3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "sum_kernels.cpp"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

#ifndef ENVCONV_SUM_KERNELS_ONCE
#define ENVCONV_SUM_KERNELS_ONCE
namespace envconv {
// The modified Bessel function of the first kind, order 0, to rounding for |x| <= 8: its power series.
inline double bessel_i0(double x) {
  const double q = 0.25 * x * x;
  double sum = 1, term = 1;
  for (int k = 1; k < 28; ++k) term *= q / (k * k), sum += term;
  return sum;
}

// Of interpolate_sinc(), for 1024 fractions, normalised; linear between them.
struct SincTable {
  static constexpr double beta = 7.5;
  std::array<std::array<float, sinc_taps>, 1025> rows;
  SincTable() {
    for (std::size_t i = 0; i <= 512; ++i) {
      const double f = static_cast<double>(i) / 1024, sine = std::sin(M_PI * f);  // of pi t, but for the sign
      std::array<double, sinc_taps> w;
      double sum = 0;
      for (int k = 0; k < sinc_taps; ++k) {
        const double t = k - (sinc_taps / 2 - 1) - f, r = t / (sinc_taps / 2);
        double value = 0;
        if (std::abs(r) < 1)
          value = bessel_i0(beta * std::sqrt(1 - r * r)) * (t == 0 ? 1.0 : (k % 2 ? -sine : sine) / (M_PI * t));
        w[static_cast<std::size_t>(k)] = value;
        sum += value;
      }
      for (std::size_t k = 0; k < sinc_taps; ++k) rows[i][k] = static_cast<float>(w[k] / sum);
      std::reverse_copy(rows[i].begin(), rows[i].end(), rows[1024 - i].begin());
    }
  }
};
inline const SincTable& sinc_table() {
  static const SincTable table;
  return table;
}

}  // namespace envconv
#endif

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Taps of a row are contiguous texels.  A chunk is as many whole texels as a vector holds; lanes beyond them take part
// and are never looked at.  Rows are summed under the vertical weights first; the horizontal weights, each spread over
// its texel's lanes, come next, and then the texels' lanes are added up.
template <int floats>
using SumLanes = hn::CappedTag<float, (floats <= 8 ? 8 : 16)>;

// Lane l takes lane l + shift.
template <int shift>
struct LaneShift {
  alignas(64) std::int32_t index[16];
  constexpr explicit LaneShift(int lanes) : index() {
    for (int l = 0; l < 16; ++l) index[l] = l + shift < lanes ? l + shift : l % lanes;
  }
};

// Where a lane's weight is among four, in a chunk that starts at tap `first`.
template <int channels>
struct LaneTaps {
  alignas(64) std::int32_t index[16];
  constexpr explicit LaneTaps(int first) : index() {
    for (int l = 0; l < 16; ++l) index[l] = (first + l / channels) % 4;
  }
};

#if HWY_TARGET == HWY_SCALAR
template <Kernel kernel, int channels>
void sum_of(int n, const Windows& s, std::ptrdiff_t, const float* HWY_RESTRICT weight, float* HWY_RESTRICT out) {
  for (int i = 0; i < n; ++i, out += 4) {
    for (int c = 0; c < 4; ++c) out[c] = 0;
    for (int k = 0; k < taps(kernel); ++k) {
      const float across = s.wx[k / 4][4 * i + k % 4];
      const float* from = s.first[i] + k * channels;
      for (int c = 0; c < channels; ++c) {
        float sum = 0;
        for (int j = 0; j < taps(kernel); ++j) sum += s.wy[j][i] * from[j * s.pitch[i] + c];
        out[c] += across * sum;
      }
    }
    if (channels == 3) out[3] = weight[i];
  }
}
#else
template <int shift, class V>
HWY_INLINE V shifted(V v) {
  const hn::DFromV<V> d;
  static constexpr LaneShift<shift> table(static_cast<int>(hn::MaxLanes(hn::DFromV<V>())));
  return hn::TableLookupLanes(v, hn::SetTableIndices(d, table.index));
}

// The first texel's lanes hold the sum of `texels` texels' lanes.
template <int texels, int channels, class V>
HWY_INLINE V add_texels(V v) {
  if constexpr (texels <= 1) {
    return v;
  } else {
    constexpr int half = texels / 2;
    const V folded = add_texels<half, channels>(hn::Add(v, shifted<half * channels>(v)));
    if constexpr (texels % 2 == 0) return folded;
    return hn::Add(folded, shifted<2 * half * channels>(v));
  }
}

template <class V>
HWY_INLINE hn::Vec<hn::CappedTag<float, 4> > first_four(V v) {
  if constexpr (hn::MaxLanes(hn::DFromV<V>()) <= 4)
    return v;
  else
    return first_four(hn::LowerHalf(v));
}

// Where eight lanes' weights are among eight, in vector `which` of a row of three channels without gaps.
struct PackedTaps {
  alignas(64) std::int32_t index[8];
  constexpr explicit PackedTaps(int which) : index() {
    for (int l = 0; l < 8; ++l) index[l] = std::min((8 * which + l) / 3, 7);
  }
};

// The four floats from `at` on of a row of halves of vectors.
template <int at, class V>
HWY_INLINE V four_at(const V* halves) {
  constexpr int half = at / 4, rest = at % 4;
  if constexpr (rest == 0)
    return halves[half];
  else
    return hn::CombineShiftRightBytes<4 * rest>(hn::DFromV<V>(), halves[half + 1], halves[half]);
}
template <int texels, class V>
HWY_INLINE V add_packed(const V* halves) {
  if constexpr (texels == 1)
    return halves[0];
  else
    return hn::Add(add_packed<texels - 1>(halves), four_at<3 * (texels - 1)>(halves));
}

// Window i of three channels where vectors have eight lanes: whole vectors of a row, across its texels.  What lies past
// the window ends up in the fourth float.
template <Kernel kernel, class D>
HWY_INLINE hn::Vec<hn::CappedTag<float, 4> > sum_packed(D d, const Windows& s, int i) {
  constexpr int count = taps(kernel), vectors = (3 * count + 7) / 8;
  const hn::Half<D> half;
  const auto weights = hn::Combine(d, hn::Load(half, s.wx[1] + 4 * i), hn::Load(half, s.wx[0] + 4 * i));
  hn::Vec<hn::Half<D> > halves[2 * vectors];
  for (int k = 0; k < vectors; ++k) {
    const float* HWY_RESTRICT from = s.first[i] + 8 * k;
    auto sum = hn::Mul(hn::Set(d, s.wy[0][i]), hn::LoadU(d, from));
    for (int j = 1; j < count; ++j) sum = hn::MulAdd(hn::Set(d, s.wy[j][i]), hn::LoadU(d, from + j * s.pitch[i]), sum);
    static constexpr PackedTaps tables[3] = {PackedTaps(0), PackedTaps(1), PackedTaps(2)};
    sum = hn::Mul(sum, hn::TableLookupLanes(weights, hn::SetTableIndices(d, tables[k].index)));
    halves[2 * k] = hn::LowerHalf(half, sum), halves[2 * k + 1] = hn::UpperHalf(half, sum);
  }
  return add_packed<count>(halves);
}

template <Kernel kernel, int channels>
void sum_of(int n, const Windows& s, std::ptrdiff_t ahead, const float* HWY_RESTRICT weight, float* HWY_RESTRICT out) {
  constexpr int count = taps(kernel);
  const SumLanes<count * channels> d;
  using V = hn::Vec<decltype(d)>;
  constexpr int lanes = static_cast<int>(hn::MaxLanes(decltype(d)()));
  constexpr int per_chunk = lanes / channels, chunks = (count + per_chunk - 1) / per_chunk;
  const hn::CappedTag<float, 4> d4;
  for (int i = 0; i < n; ++i, out += 4) {
    const std::ptrdiff_t pitch = s.pitch[i];
    if constexpr (kernel == Kernel::drooping) {
      // From memory, not from a block in the cache: two rows' lines, which all samples' together are all lines.
      prefetch(s.first[i], ahead);
      prefetch(s.first[i], ahead + pitch);
    }
    if constexpr (channels == 3 && lanes == 8 && (3 * count + 7) / 8 < chunks) {
      const auto four = sum_packed<kernel>(d, s, i);
      hn::StoreU(hn::IfThenElse(hn::FirstN(d4, 3), four, hn::Set(d4, weight[i])), d4, out);
      continue;
    }
    V total = hn::Zero(d);
    for (int c = 0; c < chunks; ++c) {
      const float* HWY_RESTRICT from = s.first[i] + c * per_chunk * channels;
      V sum = hn::Mul(hn::Set(d, s.wy[0][i]), hn::LoadU(d, from));
      for (int j = 1; j < count; ++j) sum = hn::MulAdd(hn::Set(d, s.wy[j][i]), hn::LoadU(d, from + j * pitch), sum);
      const int first = c * per_chunk, last = std::min(count, first + per_chunk) - 1;
      // What lies past the window may be no number, and no weight makes up for that.
      if (chunks > 1 && last + 1 < first + per_chunk)
        sum = hn::IfThenElseZero(hn::FirstN(d, static_cast<std::size_t>((last + 1 - first) * channels)), sum);
      V across;
      if constexpr (lanes <= 4) {
        across = hn::Set(d, s.wx[first / 4][4 * i + first % 4]);
      } else {
        // Four weights repeat along the vector, so that an index below 4 finds them from any lane.
        static constexpr LaneTaps<channels> tables[4] = {LaneTaps<channels>(0), LaneTaps<channels>(per_chunk),
                                                         LaneTaps<channels>(2 * per_chunk),
                                                         LaneTaps<channels>(3 * per_chunk)};
        static_assert(chunks <= 4);
        const auto index = hn::SetTableIndices(d, tables[c].index);
        const auto spread = [&](int four)
                                HWY_ATTR { return hn::TableLookupLanes(hn::LoadDup128(d, s.wx[four] + 4 * i), index); };
        if (last < 4)
          across = spread(0);
        else if (first >= 4)
          across = spread(1);
        else
          across =
              hn::IfThenElse(hn::FirstN(d, static_cast<std::size_t>((4 - first) * channels)), spread(0), spread(1));
      }
      total = chunks == 1 ? hn::Mul(sum, across) : hn::MulAdd(sum, across, total);
    }
    total = add_texels<std::min(count, per_chunk), channels>(total);
    hn::Vec<decltype(d4)> four = first_four(total);
    if constexpr (channels == 3) four = hn::IfThenElse(hn::FirstN(d4, 3), four, hn::Set(d4, weight[i]));
    hn::StoreU(four, d4, out);
  }
}
#endif

template <int channels>
void sum_of(Kernel kernel, int n, const Windows& windows, std::ptrdiff_t ahead, const float* weight, float* out) {
  switch (kernel) {
    case Kernel::nearest: return sum_of<Kernel::nearest, channels>(n, windows, ahead, weight, out);
    case Kernel::bilinear: return sum_of<Kernel::bilinear, channels>(n, windows, ahead, weight, out);
    case Kernel::catmull_rom: return sum_of<Kernel::catmull_rom, channels>(n, windows, ahead, weight, out);
    case Kernel::band_limited: return sum_of<Kernel::band_limited, channels>(n, windows, ahead, weight, out);
    case Kernel::band_limited_wide: return sum_of<Kernel::band_limited_wide, channels>(n, windows, ahead, weight, out);
    case Kernel::drooping: return sum_of<Kernel::drooping, channels>(n, windows, ahead, weight, out);
    case Kernel::lanczos3: return sum_of<Kernel::lanczos3, channels>(n, windows, ahead, weight, out);
  }
}

void sum_windows(Kernel kernel, int channels, int n, const Windows& windows, const float* weight, float* out,
                 std::ptrdiff_t ahead) {
  channels == 3 ? sum_of<3>(kernel, n, windows, ahead, weight, out) : sum_of<4>(kernel, n, windows, ahead, weight, out);
}

// The weights of taps at fraction f.
HWY_INLINE void sinc_weights(float f, float* HWY_RESTRICT w) {
  const SincTable& table = sinc_table();
  const float x = f * 1024.0f;
  const std::size_t i = std::min<std::size_t>(static_cast<std::size_t>(x), 1023);
  const hn::CappedTag<float, sinc_taps> d;
  const auto t = hn::Set(d, x - static_cast<float>(i));
  for (std::size_t k = 0; k < sinc_taps; k += hn::Lanes(d)) {
    const auto a = hn::LoadU(d, &table.rows[i][k]), b = hn::LoadU(d, &table.rows[i + 1][k]);
    hn::StoreU(hn::MulAdd(t, hn::Sub(b, a), a), d, w + k);
  }
}

// As sum_of(), but for more taps, whose weights along a row come from one vector.
template <int channels>
void interpolate_sinc_of(int n, const SincWindow* HWY_RESTRICT windows, float* HWY_RESTRICT out) {
#if HWY_TARGET == HWY_SCALAR
  for (int i = 0; i < n; ++i, out += 4) {
    float wx[sinc_taps], wy[sinc_taps];
    sinc_weights(windows[i].fx, wx), sinc_weights(windows[i].fy, wy);
    std::fill_n(out, 4, 0.0f);
    for (int k = 0; k < sinc_taps; ++k)
      for (int c = 0; c < channels; ++c) {
        float sum = 0;
        for (int j = 0; j < sinc_taps; ++j) sum += wy[j] * windows[i].first[j * windows[i].pitch + k * channels + c];
        out[c] += wx[k] * sum;
      }
  }
#else
  const SumLanes<sinc_taps * channels> d;
  using V = hn::Vec<decltype(d)>;
  constexpr int lanes = static_cast<int>(hn::MaxLanes(decltype(d)()));
  constexpr int per_chunk = lanes / channels, chunks = (sinc_taps + per_chunk - 1) / per_chunk;
  const hn::CappedTag<float, 4> d4;
  for (int i = 0; i < n; ++i, out += 4) {
    alignas(64) float wx[16] = {}, wy[16];
    sinc_weights(windows[i].fx, wx), sinc_weights(windows[i].fy, wy);
    const std::ptrdiff_t pitch = windows[i].pitch;
    V total = hn::Zero(d);
    for (int c = 0; c < chunks; ++c) {
      const int first = c * per_chunk, last = std::min(sinc_taps, first + per_chunk) - 1;
      const float* HWY_RESTRICT from = windows[i].first + first * channels;
      // Past the window may be no number, or what another thread is writing.
      const auto within = hn::FirstN(d, static_cast<std::size_t>((last + 1 - first) * channels));
      V sum = hn::Mul(hn::Set(d, wy[0]), hn::MaskedLoad(within, d, from));
      for (int j = 1; j < sinc_taps; ++j)
        sum = hn::MulAdd(hn::Set(d, wy[j]), hn::MaskedLoad(within, d, from + j * pitch), sum);
      if constexpr (lanes <= 4) {
        total = hn::MulAdd(sum, hn::Set(d, wx[first]), total);
      } else {
        alignas(64) std::int32_t tap[16];
        for (int l = 0; l < 16; ++l) tap[l] = std::min(first + l / channels, sinc_taps - 1);
        total = hn::MulAdd(sum, hn::TableLookupLanes(hn::Load(d, wx), hn::SetTableIndices(d, tap)), total);
      }
    }
    total = add_texels<std::min(sinc_taps, per_chunk), channels>(total);
    hn::Vec<decltype(d4)> four = first_four(total);
    if constexpr (channels == 3) four = hn::IfThenElseZero(hn::FirstN(d4, 3), four);
    hn::StoreU(four, d4, out);
  }
#endif
}

void interpolate_sinc(int channels, int n, const SincWindow* windows, float* out) {
  channels == 3 ? interpolate_sinc_of<3>(n, windows, out) : interpolate_sinc_of<4>(n, windows, out);
}

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace envconv {

HWY_EXPORT(sum_windows);
HWY_EXPORT(interpolate_sinc);

void sum_windows(Kernel kernel, int channels, int n, const Windows& windows, const float* weight, float* out,
                 std::ptrdiff_t ahead) {
  HWY_DYNAMIC_DISPATCH(sum_windows)(kernel, channels, n, windows, weight, out, ahead);
}

void interpolate_sinc(int channels, int n, const SincWindow* windows, float* out) {
  HWY_DYNAMIC_DISPATCH(interpolate_sinc)(channels, n, windows, out);
}

}  // namespace envconv
#endif
