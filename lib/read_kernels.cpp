// SPDX-License-Identifier: Apache-2.0
#include "read_kernels.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "assertion.h"

#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV | HWY_SSSE3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "read_kernels.cpp"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

#ifndef ENVCONV_READ_KERNELS_ONCE
#define ENVCONV_READ_KERNELS_ONCE
namespace envconv {
// Lanczos weights for 1024 fractions, normalised; linear between them (error 1e-6).
struct LanczosTable {
  std::array<std::array<float, 6>, 1025> rows;
  LanczosTable() {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const double f = static_cast<double>(i) / 1024;
      std::array<double, 6> w;
      double sum = 0;
      for (int k = 0; k < 6; ++k) {
        const double t = M_PI * (k - 2 - f);
        w[static_cast<std::size_t>(k)] = t == 0 ? 1 : 3 * std::sin(t) * std::sin(t / 3) / (t * t);
        sum += w[static_cast<std::size_t>(k)];
      }
      for (std::size_t k = 0; k < 6; ++k) rows[i][k] = static_cast<float>(w[k] / sum);
    }
  }
};
inline const LanczosTable& lanczos_table() {
  static const LanczosTable table;
  return table;
}

// For assertions: the taps of a sample at padded column x lie in one face's rows, and in the texels.
inline bool taps_are_texels(const SourceView& source, int face, int x, std::int64_t first, int taps) {
  const int left = x - std::max(0, taps / 2 - 1);
  const std::int64_t pitch = source.pitch[face], last = first + (taps - 1) * (pitch + 1);
  return left >= 0 && left + taps <= pitch && first >= source.first[face] && last < source.texel_count;
}
inline bool are_finite(const float* values, int n) {
  return std::all_of(values, values + n, [](float value) { return std::isfinite(value); });
}
}  // namespace envconv
#endif

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Weights are stored per sample in strides of `stride` floats.
constexpr int weight_stride(int taps) { return taps <= 4 ? 4 : 8; }

// Kernel weights at fraction f of the taps around it, for vectors of samples.
template <Kernel kernel, class V>
HWY_INLINE void cubic_weights(V f, V& w0, V& w1, V& w2, V& w3) {
  const hn::DFromV<V> d;
  const V one = hn::Set(d, 1.0f);
  const V g = hn::Sub(one, f);
  if constexpr (kernel == Kernel::omoms) {
    // |t| < 1: t^3/2 - t^2 + t/14 + 13/21;  1 < |t| < 2, with s = 2 - |t|: s^3/6 + s/42 (the same cubic, expanded at
    // 2).
    const auto inner = [&](V t) HWY_ATTR {
      return hn::MulAdd(hn::MulAdd(hn::MulSub(t, hn::Set(d, 0.5f), one), t, hn::Set(d, 1.0f / 14)), t,
                        hn::Set(d, 13.0f / 21));
    };
    const auto outer = [&](V s) HWY_ATTR {
      return hn::Mul(s, hn::MulAdd(hn::Mul(s, s), hn::Set(d, 1.0f / 6), hn::Set(d, 1.0f / 42)));
    };
    w0 = outer(g), w1 = inner(f), w2 = inner(g), w3 = outer(f);
  } else {
    // Catmull-Rom: |t| < 1: 3/2 t^3 - 5/2 t^2 + 1;  1 < |t| < 2, s = 2 - |t|: s^2 (s - 1) / 2.
    const auto inner = [&](V t) HWY_ATTR {
      return hn::MulAdd(hn::Mul(hn::MulSub(t, hn::Set(d, 1.5f), hn::Set(d, 2.5f)), t), t, one);
    };
    const auto outer = [&](V s) HWY_ATTR { return hn::Mul(hn::Mul(hn::Mul(s, s), hn::Sub(s, one)), hn::Set(d, 0.5f)); };
    w0 = outer(g), w1 = inner(f), w2 = inner(g), w3 = outer(f);
  }
}

template <Kernel kernel>
HWY_INLINE void prepare(const SourceView& source, int n, const float* HWY_RESTRICT face, const float* HWY_RESTRICT u,
                        const float* HWY_RESTRICT v, const float* HWY_RESTRICT weight, ReadScratch& s) {
  constexpr int count = taps(kernel);
  constexpr int back = kernel == Kernel::nearest ? 0 : count / 2 - 1;  // taps to the left of the sample's texel
  const hn::ScalableTag<float> d;
  const hn::RebindToSigned<decltype(d)> di;
  using V = hn::Vec<decltype(d)>;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int i = 0; i < n; i += lanes) {
    const auto f = hn::ConvertTo(di, hn::LoadU(d, face + i));
    V x = hn::MulAdd(hn::LoadU(d, u + i), hn::GatherIndex(d, source.scale_u, f), hn::GatherIndex(d, source.bias_u, f));
    V y = hn::MulAdd(hn::LoadU(d, v + i), hn::GatherIndex(d, source.scale_v, f), hn::GatherIndex(d, source.bias_v, f));
    if constexpr (kernel == Kernel::nearest) {
      x = hn::Add(x, hn::Set(d, 0.5f));
      y = hn::Add(y, hn::Set(d, 0.5f));
    }
    const V x0 = hn::Floor(x), y0 = hn::Floor(y);
    const V fx = hn::Sub(x, x0), fy = hn::Sub(y, y0);
    const auto xi = hn::ConvertTo(di, x0), yi = hn::ConvertTo(di, y0);
    hn::Store(xi, di, s.x + i);
    hn::Store(yi, di, s.y + i);
    hn::Store(fx, d, s.fx + i);
    hn::Store(fy, d, s.fy + i);
    const auto pitch = hn::GatherIndex(di, source.pitch, f);
    const auto row = hn::Sub(yi, hn::Set(di, back));
    const auto column = hn::Sub(xi, hn::Set(di, back));
    hn::Store(hn::Add(hn::GatherIndex(di, source.first, f), hn::Add(hn::Mul(row, pitch), column)), di, s.offset + i);
    const V w = hn::LoadU(d, weight + i);
    if constexpr (count == 4) {
      V a0, a1, a2, a3;
      cubic_weights<kernel>(fx, a0, a1, a2, a3);
      hn::StoreInterleaved4(a0, a1, a2, a3, d, s.wx + 4 * i);
      cubic_weights<kernel>(fy, a0, a1, a2, a3);
      hn::StoreInterleaved4(hn::Mul(w, a0), hn::Mul(w, a1), hn::Mul(w, a2), hn::Mul(w, a3), d, s.wy + 4 * i);
    } else if constexpr (count == 2) {
      const V one = hn::Set(d, 1.0f), zero = hn::Zero(d);
      hn::StoreInterleaved4(hn::Sub(one, fx), fx, zero, zero, d, s.wx + 4 * i);
      hn::StoreInterleaved4(hn::Mul(w, hn::Sub(one, fy)), hn::Mul(w, fy), zero, zero, d, s.wy + 4 * i);
    } else if constexpr (count == 1) {
      const V one = hn::Set(d, 1.0f), zero = hn::Zero(d);
      hn::StoreInterleaved4(one, zero, zero, zero, d, s.wx + 4 * i);
      hn::StoreInterleaved4(w, zero, zero, zero, d, s.wy + 4 * i);
    }
  }
  if constexpr (count == 6) {
    const LanczosTable& table = lanczos_table();
    for (int i = 0; i < n; ++i) {
      const auto fill = [&](float f, float scale, float* to) {
        const float t = f * 1024.0f;
        const int k = std::min(static_cast<int>(t), 1023);
        const float r = t - static_cast<float>(k);
        const auto& a = table.rows[static_cast<std::size_t>(k)];
        const auto& b = table.rows[static_cast<std::size_t>(k) + 1];
        for (std::size_t j = 0; j < 6; ++j) to[j] = scale * (a[j] + r * (b[j] - a[j]));
        to[6] = to[7] = 0;
      };
      fill(s.fx[i], 1.0f, s.wx + 8 * i);
      fill(s.fy[i], weight[i], s.wy + 8 * i);
    }
  }
}

// Taps of a row are contiguous RGBA texels, so a vector of L floats holds L/4 of them: rows are summed under the
// vertical weights first, and the horizontal weights, each spread over four lanes, come last.
template <Kernel kernel>
void read(const SourceView& source, int n, int texels, const float* HWY_RESTRICT face, const float* HWY_RESTRICT u,
          const float* HWY_RESTRICT v, const float* HWY_RESTRICT weight, ReadScratch& s,
          float* HWY_RESTRICT accumulator) {
  prepare<kernel>(source, n, face, u, v, weight, s);
  constexpr int count = taps(kernel), stride = weight_stride(count);
  constexpr int widest = count == 4 ? 16 : count == 1 ? 4 : 8;
  const hn::CappedTag<float, widest> d;
  using V = hn::Vec<decltype(d)>;
  constexpr int lanes = static_cast<int>(hn::MaxLanes(hn::CappedTag<float, widest>()));
  constexpr int chunks = 4 * count / lanes;
  for (int i = 0, t = 0; i < n; ++i, t = t + 1 == texels ? 0 : t + 1) {
    const std::size_t pitch = static_cast<std::size_t>(source.pitch[static_cast<int>(face[i])]) * 4;
    ENVCONV_ASSERT(taps_are_texels(source, static_cast<int>(face[i]), s.x[i], s.offset[i], count));
    ENVCONV_ASSERT(are_finite(s.wx + stride * i, count) && are_finite(s.wy + stride * i, count));
    const float* HWY_RESTRICT from = source.texels + static_cast<std::size_t>(s.offset[i]) * 4;
    const float* HWY_RESTRICT wx = s.wx + stride * i;
    const float* HWY_RESTRICT wy = s.wy + stride * i;
    float* to = accumulator + 16 * t;
    for (int c = 0; c < chunks; ++c) {
      V sum = hn::Mul(hn::Set(d, wy[0]), hn::LoadU(d, from + c * lanes));
      for (int j = 1; j < count; ++j)
        sum = hn::MulAdd(hn::Set(d, wy[j]), hn::LoadU(d, from + static_cast<std::size_t>(j) * pitch + c * lanes), sum);
      V across;
      const int first = c * lanes / 4;  // texel of the chunk's first lane
      if constexpr (lanes <= 4) {
        across = hn::Set(d, wx[first]);
      } else {
        alignas(64) static constexpr std::int32_t spread[2][16] = {{0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3},
                                                                   {2, 2, 2, 2, 3, 3, 3, 3, 2, 2, 2, 2, 3, 3, 3, 3}};
        across =
            hn::TableLookupLanes(hn::LoadDup128(d, wx + (first & ~3)), hn::SetTableIndices(d, spread[first % 4 == 2]));
      }
      // Chunks of fewer lanes than 16 fold onto each other: lanes of one channel stay together.
      float* lane = to + (lanes < 4 ? c * lanes % 4 : 0);
      hn::StoreU(hn::MulAdd(sum, across, hn::LoadU(d, lane)), d, lane);
    }
  }
}

void read_samples(const SourceView& source, Kernel kernel, int n, int texels, const float* face, const float* u,
                  const float* v, const float* weight, ReadScratch& scratch, float* accumulator) {
  switch (kernel) {
    case Kernel::nearest: return read<Kernel::nearest>(source, n, texels, face, u, v, weight, scratch, accumulator);
    case Kernel::bilinear: return read<Kernel::bilinear>(source, n, texels, face, u, v, weight, scratch, accumulator);
    case Kernel::catmull_rom:
      return read<Kernel::catmull_rom>(source, n, texels, face, u, v, weight, scratch, accumulator);
    case Kernel::omoms: return read<Kernel::omoms>(source, n, texels, face, u, v, weight, scratch, accumulator);
    case Kernel::lanczos3: return read<Kernel::lanczos3>(source, n, texels, face, u, v, weight, scratch, accumulator);
  }
}

void rotate_directions(const float m[9], std::size_t n, float* HWY_RESTRICT x, float* HWY_RESTRICT y,
                       float* HWY_RESTRICT z) {
  const hn::ScalableTag<float> d;
  for (std::size_t i = 0; i < n; i += hn::Lanes(d)) {
    const auto a = hn::LoadU(d, x + i), b = hn::LoadU(d, y + i), c = hn::LoadU(d, z + i);
    const auto row = [&](int k) HWY_ATTR {
      return hn::Add(hn::Add(hn::Mul(hn::Set(d, m[k]), a), hn::Mul(hn::Set(d, m[k + 1]), b)),
                     hn::Mul(hn::Set(d, m[k + 2]), c));
    };
    const auto rx = row(0), ry = row(3), rz = row(6);
    hn::StoreU(rx, d, x + i);
    hn::StoreU(ry, d, y + i);
    hn::StoreU(rz, d, z + i);
  }
}

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace envconv {

HWY_EXPORT(read_samples);
HWY_EXPORT(rotate_directions);

void read_samples(const SourceView& source, Kernel kernel, int n, int texels, const float* face, const float* u,
                  const float* v, const float* weight, ReadScratch& scratch, float* accumulator) {
  HWY_DYNAMIC_DISPATCH(read_samples)(source, kernel, n, texels, face, u, v, weight, scratch, accumulator);
}

void rotate_directions(const float matrix[9], std::size_t n, float* x, float* y, float* z) {
  HWY_DYNAMIC_DISPATCH(rotate_directions)(matrix, n, x, y, z);
}

void reduce_accumulators(int texels, const float* accumulator, float* out) {
  for (int t = 0; t < texels; ++t, accumulator += 16, out += 4)
    for (int c = 0; c < 4; ++c)
      out[c] = (accumulator[c] + accumulator[4 + c]) + (accumulator[8 + c] + accumulator[12 + c]);
}

const char* simd_target() {
  // Better targets have lower bits.
  const auto targets = hwy::SupportedTargets() & HWY_TARGETS;
  return hwy::TargetName(targets & (~targets + 1));
}

}  // namespace envconv
#endif
