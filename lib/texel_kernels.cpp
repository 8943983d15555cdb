// SPDX-License-Identifier: Apache-2.0
#include "texel_kernels.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "assertion.h"
#include "filter.h"
#include "prefetch.h"

#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV | HWY_SSSE3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "texel_kernels.cpp"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Both poles' recursions in one sweep, each y[n] = x[n] + p y[n-1].  Forth and back their gain at zero frequency is
// 1 / ((1 - p1) (1 - p2))^2, which the last sweep makes up for.
float last_gain(const Prefilter& f) { return (1 - f.pole1) * (1 - f.pole1) * (1 - f.pole2) * (1 - f.pole2); }

using Sums = hn::CappedTag<float, 16>;
constexpr int sum_lanes = static_cast<int>(hn::MaxLanes(Sums()));

#if HWY_TARGET != HWY_SCALAR
// A texel of each of as many rows as a vector holds, four floats each.
template <class D>
HWY_INLINE hn::Vec<D> load_column(D d, const float* const* rows, std::ptrdiff_t at) {
  if constexpr (hn::MaxLanes(D()) == 4) {
    return hn::LoadU(d, rows[0] + at);
  } else {
    const hn::Half<D> half;
    constexpr std::size_t count = hn::MaxLanes(D()) / 8;
    return hn::Combine(d, load_column(half, rows + count, at), load_column(half, rows, at));
  }
}
template <class D>
HWY_INLINE void store_column(D d, hn::Vec<D> v, float* const* rows, std::ptrdiff_t at) {
  if constexpr (hn::MaxLanes(D()) == 4) {
    hn::StoreU(v, d, rows[0] + at);
  } else {
    const hn::Half<D> half;
    constexpr std::size_t count = hn::MaxLanes(D()) / 8;
    store_column(half, hn::LowerHalf(half, v), rows, at);
    store_column(half, hn::UpperHalf(half, v), rows + count, at);
  }
}
#endif

void prefilter_rows(const Prefilter& filter, int channels, int width, const float* const in[8], float* const out[8],
                    float* HWY_RESTRICT work) {
  const int skip = filter.margin;
  const float pole1 = filter.pole1, pole2 = filter.pole2;
#if HWY_TARGET == HWY_SCALAR
  const float gain = last_gain(filter);
  for (int k = 0; k < 8; ++k)
    for (int c = 0; c < channels; ++c) {
      float y1 = in[k][(width - 1) * channels + c] / (1 - pole1), y2 = y1 / (1 - pole2);
      for (int x = width - 1; x >= 0; --x) {
        y1 = in[k][x * channels + c] + pole1 * y1;
        work[x] = y2 = y1 + pole2 * y2;
      }
      y1 = y2 / (1 - pole1), y2 = y1 / (1 - pole2);
      for (int x = 0; x < width - skip; ++x) {
        y1 = work[x] + pole1 * y1;
        y2 = y1 + pole2 * y2;
        if (x >= skip) out[k][(x - skip) * channels + c] = gain * y2;
      }
    }
#else
  const Sums d;
  constexpr int rows = sum_lanes / 4;
  const auto p1 = hn::Set(d, pole1), p2 = hn::Set(d, pole2);
  const auto start1 = hn::Set(d, 1 / (1 - pole1)), start2 = hn::Set(d, 1 / (1 - pole2)),
             gain = hn::Set(d, last_gain(filter));
  // Several vectors abreast: each waits for its own last step.
  constexpr int abreast = std::min(4, 8 / rows);
  using V = hn::Vec<Sums>;
  for (int k = 0; k < 8; k += abreast * rows) {
    const float* from[abreast * rows];
    float* to[abreast * rows];
    std::copy_n(in + k, abreast * rows, from);
    std::copy_n(out + k, abreast * rows, to);
    V y1[abreast], y2[abreast];
    for (int i = 0; i < abreast; ++i) {
      y1[i] = hn::Mul(start1, load_column(d, from + i * rows, static_cast<std::ptrdiff_t>(width - 1) * channels));
      y2[i] = hn::Mul(start2, y1[i]);
    }
    for (int x = width - 1; x >= 0; --x)
      for (int i = 0; i < abreast; ++i) {
        y1[i] = hn::MulAdd(p1, y1[i], load_column(d, from + i * rows, static_cast<std::ptrdiff_t>(x) * channels));
        y2[i] = hn::MulAdd(p2, y2[i], y1[i]);
        hn::StoreU(y2[i], d, work + (abreast * x + i) * sum_lanes);
      }
    for (int i = 0; i < abreast; ++i) {
      y1[i] = hn::Mul(start1, y2[i]);
      y2[i] = hn::Mul(start2, y1[i]);
    }
    const auto back = [&](int x, int i) HWY_ATTR {
      y1[i] = hn::MulAdd(p1, y1[i], hn::LoadU(d, work + (abreast * x + i) * sum_lanes));
      y2[i] = hn::MulAdd(p2, y2[i], y1[i]);
    };
    for (int x = 0; x < skip; ++x)
      for (int i = 0; i < abreast; ++i) back(x, i);
    // In rising order: a texel of three channels overwrites the fourth float of the one before.
    for (int x = skip; x < width - skip; ++x)
      for (int i = 0; i < abreast; ++i) {
        back(x, i);
        store_column(d, hn::Mul(gain, y2[i]), to + i * rows, static_cast<std::ptrdiff_t>(x - skip) * channels);
      }
  }
#endif
}

void prefilter_columns(const Prefilter& filter, int n, int rows, std::ptrdiff_t pitch, float* texels) {
  const Sums d;
  const float pole1 = filter.pole1, pole2 = filter.pole2;
  const auto p1 = hn::Set(d, pole1), p2 = hn::Set(d, pole2);
  const auto start1 = hn::Set(d, 1 / (1 - pole1)), start2 = hn::Set(d, 1 / (1 - pole2)),
             gain = hn::Set(d, last_gain(filter));
  using V = hn::Vec<Sums>;
  constexpr int abreast = 4;  // vectors
  const auto sweeps = [&](float* from, int vectors) HWY_ATTR {
    V y1[abreast], y2[abreast];
    const auto start = [&](const float* t) HWY_ATTR {
      for (int k = 0; k < vectors; ++k) {
        y1[k] = hn::Mul(start1, hn::LoadU(d, t + k * sum_lanes));
        y2[k] = hn::Mul(start2, y1[k]);
      }
    };
    start(from);
    for (int y = 0; y < rows; ++y) {
      float* t = from + y * pitch;
      for (int k = 0; k < vectors; ++k) {
        y1[k] = hn::MulAdd(p1, y1[k], hn::LoadU(d, t + k * sum_lanes));
        y2[k] = hn::MulAdd(p2, y2[k], y1[k]);
        hn::StoreU(y2[k], d, t + k * sum_lanes);
      }
    }
    start(from + (rows - 1) * pitch);
    for (int y = rows - 1; y >= 0; --y) {
      float* t = from + y * pitch;
      for (int k = 0; k < vectors; ++k) {
        y1[k] = hn::MulAdd(p1, y1[k], hn::LoadU(d, t + k * sum_lanes));
        y2[k] = hn::MulAdd(p2, y2[k], y1[k]);
        hn::StoreU(hn::Mul(gain, y2[k]), d, t + k * sum_lanes);
      }
    }
  };
  for (int x = 0; x < n; x += abreast * sum_lanes) {
    const int vectors = std::min(abreast, (n - x + sum_lanes - 1) / sum_lanes);
    if (vectors == abreast)
      sweeps(texels + x, abreast);
    else
      sweeps(texels + x, vectors);
  }
}

// Rows of a rectangle are pages apart, and the hardware does not see the next ones coming.  What comes eight rows after
// row y, relative to it: below, or on the right, where the next rectangle begins.
HWY_INLINE std::ptrdiff_t row_after(int y, int floats, int height, std::ptrdiff_t pitch) {
  constexpr int rows = 8;
  return y + rows < height ? rows * pitch : (std::min(rows, height) - height) * pitch + floats;
}

// Vector k of texels' channels: lane l is of the texel (lanes k + l) / channels.
template <int channels, int lanes>
struct LaneTexels {
  alignas(64) std::int32_t index[channels][lanes];
  constexpr LaneTexels() : index() {
    for (int k = 0; k < channels; ++k)
      for (int l = 0; l < lanes; ++l) index[k][l] = (lanes * k + l) / channels;
  }
};

// Sums of values and of their magnitudes by channel, over vectors of texels: some rows in floats, which go on in
// double.
template <int channels>
class ChannelSums {
 public:
  static constexpr hn::CappedTag<float, 16> d{};
  static constexpr int lanes = static_cast<int>(hn::MaxLanes(hn::CappedTag<float, 16>()));
  static constexpr int most_rows = 4;  // of floats
  using V = hn::Vec<hn::CappedTag<float, 16>>;

  HWY_INLINE ChannelSums() {
    for (int k = 0; k < channels; ++k) sum_[k] = magnitude_[k] = hn::Zero(d);
  }
  // Vector k of `lanes` texels.
  HWY_INLINE void add(int k, V weight, V value) {
    sum_[k] = hn::MulAdd(weight, value, sum_[k]);
    magnitude_[k] = hn::MulAdd(weight, hn::Abs(value), magnitude_[k]);
  }
  HWY_INLINE void end_row() {
    if (++rows_ < most_rows) return;
    flush();
  }
  HWY_INLINE void add_to(double* sums) {
    flush();
    for (int i = 0; i < channels * lanes; ++i) {
      sums[i % channels] += sum_lanes_[i];
      sums[channels + i % channels] += magnitude_lanes_[i];
    }
  }

 private:
  HWY_INLINE void flush() {
    rows_ = 0;
    for (int k = 0; k < channels; ++k) {
      HWY_ALIGN float a[lanes], b[lanes];
      hn::Store(sum_[k], d, a), hn::Store(magnitude_[k], d, b);
      for (int l = 0; l < lanes; ++l) {
        sum_lanes_[k * lanes + l] += static_cast<double>(a[l]);
        magnitude_lanes_[k * lanes + l] += static_cast<double>(b[l]);
      }
      sum_[k] = magnitude_[k] = hn::Zero(d);
    }
  }
  V sum_[channels], magnitude_[channels];
  double sum_lanes_[channels * lanes] = {}, magnitude_lanes_[channels * lanes] = {};
  int rows_ = 0;
};

template <int channels>
void add_weighted_of(int width, int height, const float* HWY_RESTRICT values, std::ptrdiff_t pitch,
                     const double* HWY_RESTRICT weights, double* sums) {
#if HWY_TARGET == HWY_SCALAR
  constexpr int whole = 0;
#else
  using Adder = ChannelSums<channels>;
  constexpr auto d = Adder::d;
  constexpr int lanes = Adder::lanes;
  using V = typename Adder::V;
  static constexpr LaneTexels<channels, lanes> texels;
  const int whole = width / lanes * lanes;
  Adder adder;
  double total = 0;
  for (int y = 0; y < height && whole > 0; ++y) {
    V row_total = hn::Zero(d);
    const float* HWY_RESTRICT v = values + y * pitch;
    const double* HWY_RESTRICT w = weights + static_cast<std::ptrdiff_t>(y) * width;
    const std::ptrdiff_t after = row_after(y, width * channels, height, pitch);
    for (int x = 0; x < whole; x += lanes, v += lanes * channels) {
      HWY_ALIGN float narrow[lanes];
      for (int l = 0; l < lanes; ++l) narrow[l] = static_cast<float>(w[x + l]);
      const V weight = hn::Load(d, narrow);
      row_total = hn::Add(row_total, weight);
      const bool all = hn::AllFalse(d, hn::Eq(weight, hn::Zero(d)));
      for (int k = 0; k < channels; ++k) {
        prefetch(v + k * lanes, after);
        const V spread = hn::TableLookupLanes(weight, hn::SetTableIndices(d, texels.index[k]));
        V value = hn::LoadU(d, v + k * lanes);
        if (!all) value = hn::IfThenZeroElse(hn::Eq(spread, hn::Zero(d)), value);
        adder.add(k, spread, value);
      }
    }
    adder.end_row();
    total += static_cast<double>(hn::GetLane(hn::SumOfLanes(d, row_total)));
  }
  adder.add_to(sums);
  sums[2 * channels] += total;
#endif
  for (int y = 0; y < height; ++y)
    for (int x = whole; x < width; ++x) {
      const double w = weights[static_cast<std::ptrdiff_t>(y) * width + x];
      if (w == 0) continue;
      for (int c = 0; c < channels; ++c) {
        const double v = static_cast<double>(values[y * pitch + x * channels + c]);
        sums[c] += w * v;
        sums[channels + c] += w * std::abs(v);
      }
      sums[2 * channels] += w;
    }
}

void add_weighted(int channels, int width, int height, const float* values, std::ptrdiff_t pitch, const double* weights,
                  double* sums) {
  switch (channels) {
    case 1: return add_weighted_of<1>(width, height, values, pitch, weights, sums);
    case 2: return add_weighted_of<2>(width, height, values, pitch, weights, sums);
    case 3: return add_weighted_of<3>(width, height, values, pitch, weights, sums);
    case 4: return add_weighted_of<4>(width, height, values, pitch, weights, sums);
    default: ENVCONV_ASSERT(false);
  }
}

template <int channels>
void add_rows_of(int width, int height, const float* HWY_RESTRICT values, std::ptrdiff_t pitch,
                 const double* HWY_RESTRICT weights, double* sums) {
  using Adder = ChannelSums<channels>;
  constexpr int lanes = Adder::lanes;
  const int whole = width / lanes * lanes;
  Adder adder;
  for (int y = 0; y < height; ++y) {
    const auto weight = hn::Set(Adder::d, static_cast<float>(weights[y]));
    const float* HWY_RESTRICT v = values + y * pitch;
    const std::ptrdiff_t after = row_after(y, width * channels, height, pitch);
    for (int x = 0; x < whole; x += lanes, v += lanes * channels)
      for (int k = 0; k < channels; ++k) {
        prefetch(v + k * lanes, after);
        adder.add(k, weight, hn::LoadU(Adder::d, v + k * lanes));
      }
    adder.end_row();
    for (int i = 0; i < (width - whole) * channels; ++i) {
      const double value = weights[y] * static_cast<double>(v[i]);
      sums[i % channels] += value, sums[channels + i % channels] += std::abs(value);
    }
    sums[2 * channels] += weights[y] * width;
  }
  adder.add_to(sums);
}

void add_rows(int channels, int width, int height, const float* values, std::ptrdiff_t pitch, const double* weights,
              double* sums) {
  switch (channels) {
    case 1: return add_rows_of<1>(width, height, values, pitch, weights, sums);
    case 2: return add_rows_of<2>(width, height, values, pitch, weights, sums);
    case 3: return add_rows_of<3>(width, height, values, pitch, weights, sums);
    case 4: return add_rows_of<4>(width, height, values, pitch, weights, sums);
    default: ENVCONV_ASSERT(false);
  }
}

template <int channels>
void range_of(int width, int height, const float* HWY_RESTRICT values, std::ptrdiff_t pitch, float low[4],
              float high[4]) {
  const hn::CappedTag<float, 16> d;
  constexpr int lanes = static_cast<int>(hn::MaxLanes(decltype(d)()));
  hn::Vec<decltype(d)> least[channels], most[channels];
  constexpr float largest = std::numeric_limits<float>::max();
  std::fill_n(low, channels, largest), std::fill_n(high, channels, -largest);
  for (int k = 0; k < channels; ++k) least[k] = hn::Set(d, largest), most[k] = hn::Set(d, -largest);
  const int whole = width / lanes * lanes;
  for (int y = 0; y < height; ++y) {
    const float* HWY_RESTRICT row = values + y * pitch;
    // Of as many texels as lanes, whose values' channels follow each other lane by lane.
    for (int x = 0; x < whole; x += lanes)
      for (int k = 0; k < channels; ++k) {
        const auto v = hn::LoadU(d, row + static_cast<std::ptrdiff_t>(x) * channels + k * lanes);
        least[k] = hn::Min(v, least[k]), most[k] = hn::Max(v, most[k]);
      }
    for (int x = whole; x < width; ++x)
      for (int c = 0; c < channels; ++c) {
        const float v = row[static_cast<std::ptrdiff_t>(x) * channels + c];
        low[c] = std::min(low[c], v), high[c] = std::max(high[c], v);
      }
  }
  HWY_ALIGN float a[lanes], b[lanes];
  for (int k = 0; k < channels; ++k) {
    hn::Store(least[k], d, a), hn::Store(most[k], d, b);
    for (int l = 0; l < lanes; ++l) {
      const int c = (k * lanes + l) % channels;
      low[c] = std::min(low[c], a[l]), high[c] = std::max(high[c], b[l]);
    }
  }
}

void value_range(int channels, int width, int height, const float* values, std::ptrdiff_t pitch, float low[4],
                 float high[4]) {
  channels == 3 ? range_of<3>(width, height, values, pitch, low, high)
                : range_of<4>(width, height, values, pitch, low, high);
}

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace envconv {

HWY_EXPORT(prefilter_rows);
HWY_EXPORT(prefilter_columns);
HWY_EXPORT(add_weighted);
HWY_EXPORT(add_rows);
HWY_EXPORT(value_range);

void prefilter_rows(const Prefilter& filter, int channels, int width, const float* const in[8], float* const out[8],
                    float* work) {
  HWY_DYNAMIC_DISPATCH(prefilter_rows)(filter, channels, width, in, out, work);
}

void prefilter_columns(const Prefilter& filter, int n, int rows, std::ptrdiff_t pitch, float* texels) {
  HWY_DYNAMIC_DISPATCH(prefilter_columns)(filter, n, rows, pitch, texels);
}

void add_weighted(int channels, int width, int height, const float* values, std::ptrdiff_t pitch, const double* weights,
                  double* sums) {
  HWY_DYNAMIC_DISPATCH(add_weighted)(channels, width, height, values, pitch, weights, sums);
}

void add_rows(int channels, int width, int height, const float* values, std::ptrdiff_t pitch, const double* weights,
              double* sums) {
  HWY_DYNAMIC_DISPATCH(add_rows)(channels, width, height, values, pitch, weights, sums);
}

void value_range(int channels, int width, int height, const float* values, std::ptrdiff_t pitch, float low[4],
                 float high[4]) {
  HWY_DYNAMIC_DISPATCH(value_range)(channels, width, height, values, pitch, low, high);
}

}  // namespace envconv
#endif
