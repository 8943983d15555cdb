// SPDX-License-Identifier: Apache-2.0
#include "grid_kernels.h"

#include <algorithm>

#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV | HWY_SSSE3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "grid_kernels.cpp"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

void combine_rows(int n, int count, const float* HWY_RESTRICT weight, const float* const* rows,
                  float* HWY_RESTRICT out) {
  const hn::ScalableTag<float> d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int i = 0; i < n; i += lanes) {
    auto sum = hn::Mul(hn::Set(d, weight[0]), hn::LoadU(d, rows[0] + i));
    for (int k = 1; k < count; ++k) sum = hn::MulAdd(hn::Set(d, weight[k]), hn::LoadU(d, rows[k] + i), sum);
    hn::StoreU(sum, d, out + i);
  }
}

// Four floats at a time: the scalar target has one.
using Four = hn::CappedTag<float, 4>;

#if HWY_TARGET != HWY_SCALAR
// A vector's texels of four floats added up.
template <class V>
HWY_INLINE hn::Vec<Four> sum_of_fours(V v) {
  if constexpr (hn::MaxLanes(hn::DFromV<V>()) <= 4)
    return v;
  else
    return sum_of_fours(hn::Add(hn::LowerHalf(v), hn::UpperHalf(hn::Half<hn::DFromV<V>>(), v)));
}
#endif

void combine_samples(int n, int phases, int step, int taps, const int* first, const float* HWY_RESTRICT weight,
                     const float* HWY_RESTRICT in, float* HWY_RESTRICT out) {
  const hn::CappedTag<float, 16> wide;
  const int lanes = static_cast<int>(hn::Lanes(wide));
  int i = 0;
  if (phases == 1 && step == 1) {
    // Whole vectors of texels: as many as lie side by side.
    const int texels = lanes / 4;
    const float* HWY_RESTRICT from = in + 4 * first[0];
    for (; texels > 0 && i + texels <= n; i += texels, from += 4 * texels, out += 4 * texels) {
      auto sum = hn::Mul(hn::Set(wide, weight[0]), hn::LoadU(wide, from));
      for (int k = 1; k < taps; ++k) sum = hn::MulAdd(hn::Set(wide, weight[4 * k]), hn::LoadU(wide, from + 4 * k), sum);
      hn::StoreU(sum, wide, out);
    }
  }
  const int floats = 4 * taps;
  for (int phase = i % phases, base = i / phases * step; i < n; ++i, out += 4) {
    const float* HWY_RESTRICT from = in + 4 * (base + first[phase]);
    const float* HWY_RESTRICT w = weight + phase * floats;
#if HWY_TARGET == HWY_SCALAR
    for (int l = 0; l < 4; ++l) {
      out[l] = 0;
      for (int k = 0; k < floats; k += 4) out[l] += w[k] * from[k + l];
    }
#else
    auto sum = hn::Zero(wide);
    int k = 0;
    for (; k + lanes <= floats; k += lanes) sum = hn::MulAdd(hn::LoadU(wide, w + k), hn::LoadU(wide, from + k), sum);
    auto texel = sum_of_fours(sum);
    for (const Four d; k < floats; k += 4) texel = hn::MulAdd(hn::LoadU(d, w + k), hn::LoadU(d, from + k), texel);
    hn::StoreU(texel, Four(), out);
#endif
    if (++phase == phases) phase = 0, base += step;
  }
}

template <bool divide>
void store_of(int n, const float* HWY_RESTRICT in, const Totals& totals, const float lowest[4], int channels,
              int stored, float* HWY_RESTRICT to) {
  const Four d;
  // Whole vectors, but for the last of three channels, after which comes what is another's.
  const bool whole = hn::Lanes(d) == 4 && (stored == 4 || stored == 3) && channels == stored;
  const int vectors = whole ? n - (stored == 3) : 0;
  const auto low = hn::LoadU(d, lowest);
  int i = 0;
  for (; i < vectors; ++i, in += 4, to += stored) {
    auto value = hn::LoadU(d, in);
    if constexpr (divide) value = hn::Div(value, hn::Set(d, totals.of[i * totals.step]));
    hn::StoreU(hn::Max(low, value), d, to);  // in this order, what is no number stays none
  }
  for (; i < n; ++i, in += 4, to += stored) {
    const float total = divide ? totals.of[i * totals.step] : 1.0f;
    for (int c = 0; c < channels; ++c) to[c] = std::max(in[c] / total, lowest[c]);
  }
}

void store_texels(int n, const float* in, const Totals& totals, const float lowest[4], int channels, int stored,
                  float* to) {
  totals.of ? store_of<true>(n, in, totals, lowest, channels, stored, to)
            : store_of<false>(n, in, totals, lowest, channels, stored, to);
}

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace envconv {

HWY_EXPORT(combine_rows);
HWY_EXPORT(combine_samples);
HWY_EXPORT(store_texels);

void combine_rows(int n, int count, const float* weight, const float* const* rows, float* out) {
  HWY_DYNAMIC_DISPATCH(combine_rows)(n, count, weight, rows, out);
}

void combine_samples(int n, int phases, int step, int taps, const int* first, const float* weight, const float* in,
                     float* out) {
  HWY_DYNAMIC_DISPATCH(combine_samples)(n, phases, step, taps, first, weight, in, out);
}

void store_texels(int n, const float* in, const Totals& totals, const float lowest[4], int channels, int stored,
                  float* to) {
  HWY_DYNAMIC_DISPATCH(store_texels)(n, in, totals, lowest, channels, stored, to);
}

}  // namespace envconv
#endif
