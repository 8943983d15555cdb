// SPDX-License-Identifier: Apache-2.0
#include "read_kernels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

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

}  // namespace envconv
#endif

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// c[0] + c[1] x + c[2] x^2 ..., over every `step`-th coefficient.
template <int count, int step, class V>
HWY_INLINE V polynomial(V x, const float* c) {
  const hn::DFromV<V> d;
  V sum = hn::Set(d, c[(count - 1) * step]);
  for (int i = count - 2; i >= 0; --i) sum = hn::MulAdd(sum, x, hn::Set(d, c[i * step]));
  return sum;
}

// Weights of a kernel's taps at fraction f; absent ones are 0.
template <Kernel kernel, class V>
HWY_INLINE void tap_weights(V f, V (&w)[8]) {
  const hn::DFromV<V> d;
  const V one = hn::Set(d, 1.0f), zero = hn::Zero(d);
  for (V& weight : w) weight = zero;
  if constexpr (kernel == Kernel::nearest) {
    w[0] = one;
  } else if constexpr (kernel == Kernel::bilinear) {
    w[0] = hn::Sub(one, f), w[1] = f;
  } else if constexpr (kernel == Kernel::catmull_rom) {
    const V g = hn::Sub(one, f);
    // Catmull-Rom: |t| < 1: 3/2 t^3 - 5/2 t^2 + 1;  1 < |t| < 2, s = 2 - |t|: s^2 (s - 1) / 2.
    const auto inner = [&](V t) HWY_ATTR {
      return hn::MulAdd(hn::Mul(hn::MulSub(t, hn::Set(d, 1.5f), hn::Set(d, 2.5f)), t), t, one);
    };
    const auto outer = [&](V s) HWY_ATTR { return hn::Mul(hn::Mul(hn::Mul(s, s), hn::Sub(s, one)), hn::Set(d, 0.5f)); };
    w[0] = outer(g), w[1] = inner(f), w[2] = inner(g), w[3] = outer(f);
  } else if constexpr (kernel == Kernel::band_limited) {
    const V ff = hn::Mul(f, f);
    const V even1 = polynomial<4, 2>(ff, band_limited::c1),
            odd1 = hn::Mul(f, polynomial<3, 2>(ff, band_limited::c1 + 1));
    const V even2 = polynomial<4, 2>(ff, band_limited::c2),
            odd2 = hn::Mul(f, polynomial<3, 2>(ff, band_limited::c2 + 1));
    w[0] = hn::Sub(even2, odd2), w[1] = hn::Sub(even1, odd1);
    w[2] = polynomial<4, 1>(ff, band_limited::c0);
    w[3] = hn::Add(even1, odd1), w[4] = hn::Add(even2, odd2);
  }
}

template <Kernel kernel>
void windows_of(const FaceMaps& maps, int n, const float* HWY_RESTRICT face, const float* HWY_RESTRICT u,
                const float* HWY_RESTRICT v, const float* HWY_RESTRICT weight, Windows& s) {
  constexpr bool to_nearest = taps(kernel) % 2 == 1;
  const hn::ScalableTag<float> d;
  const hn::RebindToSigned<decltype(d)> di;
  using V = hn::Vec<decltype(d)>;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int i = 0; i < n; i += lanes) {
    // Neighbours mostly share a face, and gathers are slow.
    const V faces = hn::LoadU(d, face + i);
    V scale_u, bias_u, scale_v, bias_v;
    if (hn::AllTrue(d, hn::Eq(faces, hn::Set(d, face[i])))) {
      const auto f = static_cast<std::size_t>(face[i]);
      scale_u = hn::Set(d, maps.scale_u[f]), bias_u = hn::Set(d, maps.bias_u[f]);
      scale_v = hn::Set(d, maps.scale_v[f]), bias_v = hn::Set(d, maps.bias_v[f]);
    } else {
      const auto f = hn::ConvertTo(di, faces);
      scale_u = hn::GatherIndex(d, maps.scale_u, f), bias_u = hn::GatherIndex(d, maps.bias_u, f);
      scale_v = hn::GatherIndex(d, maps.scale_v, f), bias_v = hn::GatherIndex(d, maps.bias_v, f);
    }
    const V x = hn::MulAdd(hn::LoadU(d, u + i), scale_u, bias_u);
    const V y = hn::MulAdd(hn::LoadU(d, v + i), scale_v, bias_v);
    const V half = hn::Set(d, 0.5f);
    const V x0 = hn::Floor(to_nearest ? hn::Add(x, half) : x), y0 = hn::Floor(to_nearest ? hn::Add(y, half) : y);
    const V fx = hn::Sub(x, x0), fy = hn::Sub(y, y0);
    hn::Store(hn::ConvertTo(di, x0), di, s.x + i);
    hn::Store(hn::ConvertTo(di, y0), di, s.y + i);
    hn::Store(fx, d, s.fx + i);
    hn::Store(fy, d, s.fy + i);
    if constexpr (kernel != Kernel::lanczos3) {
      const V w = hn::LoadU(d, weight + i);
      V a[8];
      tap_weights<kernel>(fx, a);
      hn::StoreInterleaved4(a[0], a[1], a[2], a[3], d, s.wx[0] + 4 * i);
      if constexpr (taps(kernel) > 4) hn::StoreInterleaved4(a[4], a[5], a[6], a[7], d, s.wx[1] + 4 * i);
      tap_weights<kernel>(fy, a);
      for (V& weight_y : a) weight_y = hn::Mul(w, weight_y);
      hn::StoreInterleaved4(a[0], a[1], a[2], a[3], d, s.wy[0] + 4 * i);
      if constexpr (taps(kernel) > 4) hn::StoreInterleaved4(a[4], a[5], a[6], a[7], d, s.wy[1] + 4 * i);
    }
  }
  if constexpr (kernel == Kernel::lanczos3) {
    const LanczosTable& table = lanczos_table();
    for (int i = 0; i < n; ++i) {
      const auto fill = [&](float f, float scale, float(*to)[batch_room * 4]) {
        const float t = f * 1024.0f;
        const int k = std::min(static_cast<int>(t), 1023);
        const float r = t - static_cast<float>(k);
        const auto& a = table.rows[static_cast<std::size_t>(k)];
        const auto& b = table.rows[static_cast<std::size_t>(k) + 1];
        for (std::size_t j = 0; j < 6; ++j)
          to[j / 4][4 * static_cast<std::size_t>(i) + j % 4] = scale * (a[j] + r * (b[j] - a[j]));
        to[1][4 * i + 2] = to[1][4 * i + 3] = 0;
      };
      fill(s.fx[i], 1.0f, s.wx);
      fill(s.fy[i], weight[i], s.wy);
    }
  }
}

void make_windows(const FaceMaps& maps, Kernel kernel, int n, const float* face, const float* u, const float* v,
                  const float* weight, Windows& windows) {
  switch (kernel) {
    case Kernel::nearest: return windows_of<Kernel::nearest>(maps, n, face, u, v, weight, windows);
    case Kernel::bilinear: return windows_of<Kernel::bilinear>(maps, n, face, u, v, weight, windows);
    case Kernel::catmull_rom: return windows_of<Kernel::catmull_rom>(maps, n, face, u, v, weight, windows);
    case Kernel::band_limited: return windows_of<Kernel::band_limited>(maps, n, face, u, v, weight, windows);
    case Kernel::lanczos3: return windows_of<Kernel::lanczos3>(maps, n, face, u, v, weight, windows);
  }
}

// Taps of a row are contiguous texels.  A chunk is as many whole texels as a vector holds; lanes beyond them take part
// and are never looked at.  Rows are summed under the vertical weights first; the horizontal weights, each spread over
// its texel's lanes, come last.
using Sums = hn::CappedTag<float, 16>;
constexpr int sum_lanes = static_cast<int>(hn::MaxLanes(Sums()));

// Where a lane's weight is among four, in a chunk that starts at tap `first`.
template <int channels>
struct LaneTaps {
  alignas(64) std::int32_t index[16];
  constexpr explicit LaneTaps(int first) : index() {
    for (int l = 0; l < 16; ++l) index[l] = (first + l / channels) % 4;
  }
};

#if HWY_TARGET == HWY_SCALAR
constexpr int texel_lanes(int channels) { return channels; }  // one texel's

template <Kernel kernel, int channels, bool add>
void sum_of(int n, const Windows& s, int targets, float* HWY_RESTRICT sums) {
  for (int i = 0, t = 0; i < n; ++i, t = t + 1 == targets ? 0 : t + 1)
    for (int k = 0; k < taps(kernel); ++k) {
      const float across = s.wx[k / 4][4 * i + k % 4];
      const float* from = s.first[i] + k * channels;
      for (int c = 0; c < channels; ++c) {
        float sum = 0;
        for (int j = 0; j < taps(kernel); ++j) sum += s.wy[j / 4][4 * i + j % 4] * from[j * s.pitch[i] + c];
        float& to = sums[16 * t + c];
        to = (add || k > 0 ? to : 0.0f) + across * sum;
      }
    }
}
#else
constexpr int texel_lanes(int channels) { return sum_lanes / channels * channels; }  // whole texels'

template <Kernel kernel, int channels, bool add>
void sum_of(int n, const Windows& s, int targets, float* HWY_RESTRICT sums) {
  constexpr int count = taps(kernel), per_chunk = sum_lanes / channels, chunks = (count + per_chunk - 1) / per_chunk;
  const Sums d;
  using V = hn::Vec<Sums>;
  for (int i = 0, t = 0; i < n; ++i, t = t + 1 == targets ? 0 : t + 1) {
    const std::ptrdiff_t pitch = s.pitch[i];
    float* to = sums + 16 * t;
    V total = add ? hn::LoadU(d, to) : hn::Zero(d);
    for (int c = 0; c < chunks; ++c) {
      const float* HWY_RESTRICT from = s.first[i] + c * per_chunk * channels;
      V sum = hn::Mul(hn::Set(d, s.wy[0][4 * i]), hn::LoadU(d, from));
      for (int j = 1; j < count; ++j)
        sum = hn::MulAdd(hn::Set(d, s.wy[j / 4][4 * i + j % 4]), hn::LoadU(d, from + j * pitch), sum);
      const int first = c * per_chunk, last = std::min(count, first + per_chunk) - 1;
      // What lies past the window may be no number, and no weight makes up for that.
      if (last + 1 < first + per_chunk)
        sum = hn::IfThenElseZero(hn::FirstN(d, static_cast<std::size_t>((last + 1 - first) * channels)), sum);
      V across;
      if constexpr (sum_lanes <= 4) {
        across = hn::Set(d, s.wx[first / 4][4 * i + first % 4]);
      } else {
        // Four weights repeat along the vector, so that an index below 4 finds them from any lane.
        static constexpr LaneTaps<channels> tables[3] = {LaneTaps<channels>(0), LaneTaps<channels>(per_chunk),
                                                         LaneTaps<channels>(2 * per_chunk)};
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
      total = hn::MulAdd(sum, across, total);
    }
    hn::StoreU(total, d, to);
  }
}
#endif

template <int channels, bool add>
void sum_of(Kernel kernel, int n, const Windows& windows, int targets, float* sums) {
  switch (kernel) {
    case Kernel::nearest: return sum_of<Kernel::nearest, channels, add>(n, windows, targets, sums);
    case Kernel::bilinear: return sum_of<Kernel::bilinear, channels, add>(n, windows, targets, sums);
    case Kernel::catmull_rom: return sum_of<Kernel::catmull_rom, channels, add>(n, windows, targets, sums);
    case Kernel::band_limited: return sum_of<Kernel::band_limited, channels, add>(n, windows, targets, sums);
    case Kernel::lanczos3: return sum_of<Kernel::lanczos3, channels, add>(n, windows, targets, sums);
  }
}

void sum_windows(Kernel kernel, int channels, int n, const Windows& windows, int targets, float* sums) {
  const bool add = targets < n;  // else every sample has its own sum
  if (channels == 3)
    return add ? sum_of<3, true>(kernel, n, windows, targets, sums)
               : sum_of<3, false>(kernel, n, windows, targets, sums);
  add ? sum_of<4, true>(kernel, n, windows, targets, sums) : sum_of<4, false>(kernel, n, windows, targets, sums);
}

constexpr int filled_lanes = sum_lanes < 4 ? 4 : sum_lanes;  // by sum_windows()

void combine_samples(int n, int step, int count, const float* HWY_RESTRICT weight, const float* HWY_RESTRICT in,
                     float* HWY_RESTRICT out) {
  const Sums d;
  for (int i = 0; i < n; ++i)
    for (int l = 0; l < filled_lanes; l += sum_lanes) {
      const float* HWY_RESTRICT from = in + 16 * i * step + l;
      auto sum = hn::Mul(hn::Set(d, weight[0]), hn::LoadU(d, from));
      for (int k = 1; k < count; ++k) sum = hn::MulAdd(hn::Set(d, weight[k]), hn::LoadU(d, from + 16 * k), sum);
      hn::StoreU(sum, d, out + 16 * i + l);
    }
}

void combine_rows(int n, int count, const float* HWY_RESTRICT weight, const float* const* rows,
                  float* HWY_RESTRICT out) {
  const Sums d;
  for (int i = 0; i < n; ++i)
    for (int l = 0; l < filled_lanes; l += sum_lanes) {
      const int at = 16 * i + l;
      auto sum = hn::Mul(hn::Set(d, weight[0]), hn::LoadU(d, rows[0] + at));
      for (int k = 1; k < count; ++k) sum = hn::MulAdd(hn::Set(d, weight[k]), hn::LoadU(d, rows[k] + at), sum);
      hn::StoreU(sum, d, out + at);
    }
}

void reduce_sums(int channels, int n, const float* HWY_RESTRICT sums, float* HWY_RESTRICT out) {
  const int used = texel_lanes(channels);
  for (int i = 0; i < n; ++i, sums += 16, out += 4) {
    // Four lanes from each texel on; with three channels the fourth is the next texel's first.
    float total[4];
    std::memcpy(total, sums, sizeof total);
    for (int l = channels; l < used; l += channels)
      for (int c = 0; c < 4; ++c) total[c] += sums[l + c];
    if (channels == 3) total[3] = 0;
    std::memcpy(out, total, sizeof total);
  }
}

// Both poles' recursions in one sweep, each y[n] = (1-p) x[n] + p y[n-1]: unit gain at zero frequency.
struct Poles {
  float p1 = static_cast<float>(band_limited::poles[0]), g1 = 1.0f - p1;
  float p2 = static_cast<float>(band_limited::poles[1]), g2 = 1.0f - p2;
};

void prefilter_rows(int channels, int width, int skip, const float* const in[8], float* const out[8],
                    float* HWY_RESTRICT work) {
  // Eight texels of a column lie side by side in `work`: recursions run abreast.
  for (int x = 0; x < width; ++x)
    for (int k = 0; k < 8; ++k) std::memcpy(work + 32 * x + 4 * k, in[k] + x * channels, 4 * sizeof(float));
  const Sums d;
  const Poles poles;
  const auto p1 = hn::Set(d, poles.p1), g1 = hn::Set(d, poles.g1), p2 = hn::Set(d, poles.p2), g2 = hn::Set(d, poles.g2);
  for (int l = 0; l < 32; l += 2 * sum_lanes) {
    const auto sweep = [&](int begin, int end, int step) HWY_ATTR {
      float* t = work + 32 * begin + l;
      auto a1 = hn::LoadU(d, t), b1 = hn::LoadU(d, t + sum_lanes), a2 = a1, b2 = b1;
      for (int x = begin; x != end; x += step) {
        t = work + 32 * x + l;
        a1 = hn::MulAdd(p1, a1, hn::Mul(g1, hn::LoadU(d, t)));
        b1 = hn::MulAdd(p1, b1, hn::Mul(g1, hn::LoadU(d, t + sum_lanes)));
        a2 = hn::MulAdd(p2, a2, hn::Mul(g2, a1));
        b2 = hn::MulAdd(p2, b2, hn::Mul(g2, b1));
        hn::StoreU(a2, d, t);
        hn::StoreU(b2, d, t + sum_lanes);
      }
    };
    sweep(0, width, 1);
    sweep(width - 1, -1, -1);
  }
  // In rising order: a texel of three channels overwrites the fourth float of the one before.
  for (int x = skip; x < width - skip; ++x)
    for (int k = 0; k < 8; ++k) std::memcpy(out[k] + (x - skip) * channels, work + 32 * x + 4 * k, 4 * sizeof(float));
}

void prefilter_columns(int n, int rows, std::ptrdiff_t pitch, float* texels) {
  const Sums d;
  const Poles poles;
  const auto p1 = hn::Set(d, poles.p1), g1 = hn::Set(d, poles.g1), p2 = hn::Set(d, poles.p2), g2 = hn::Set(d, poles.g2);
  using V = hn::Vec<Sums>;
  constexpr int abreast = 4;  // vectors
  for (int x = 0; x < n; x += abreast * sum_lanes) {
    const int vectors = std::min(abreast, (n - x + sum_lanes - 1) / sum_lanes);
    const auto sweep = [&](int begin, int end, int step) HWY_ATTR {
      V y1[abreast], y2[abreast];
      for (int k = 0; k < abreast; ++k)
        y1[k] = y2[k] = hn::LoadU(d, texels + begin * pitch + x + std::min(k, vectors - 1) * sum_lanes);
      for (int y = begin; y != end; y += step) {
        float* t = texels + y * pitch + x;
        if (vectors == abreast) {
          for (int k = 0; k < abreast; ++k) {
            y1[k] = hn::MulAdd(p1, y1[k], hn::Mul(g1, hn::LoadU(d, t + k * sum_lanes)));
            y2[k] = hn::MulAdd(p2, y2[k], hn::Mul(g2, y1[k]));
            hn::StoreU(y2[k], d, t + k * sum_lanes);
          }
        } else {
          for (int k = 0; k < vectors; ++k) {
            y1[k] = hn::MulAdd(p1, y1[k], hn::Mul(g1, hn::LoadU(d, t + k * sum_lanes)));
            y2[k] = hn::MulAdd(p2, y2[k], hn::Mul(g2, y1[k]));
            hn::StoreU(y2[k], d, t + k * sum_lanes);
          }
        }
      }
    };
    sweep(0, rows, 1);
    sweep(rows - 1, -1, -1);
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

HWY_EXPORT(make_windows);
HWY_EXPORT(sum_windows);
HWY_EXPORT(combine_samples);
HWY_EXPORT(combine_rows);
HWY_EXPORT(reduce_sums);
HWY_EXPORT(prefilter_rows);
HWY_EXPORT(prefilter_columns);
HWY_EXPORT(rotate_directions);

void make_windows(const FaceMaps& maps, Kernel kernel, int n, const float* face, const float* u, const float* v,
                  const float* weight, Windows& windows) {
  HWY_DYNAMIC_DISPATCH(make_windows)(maps, kernel, n, face, u, v, weight, windows);
}

void sum_windows(Kernel kernel, int channels, int n, const Windows& windows, int targets, float* sums) {
  HWY_DYNAMIC_DISPATCH(sum_windows)(kernel, channels, n, windows, targets, sums);
}

void combine_samples(int n, int step, int count, const float* weight, const float* in, float* out) {
  HWY_DYNAMIC_DISPATCH(combine_samples)(n, step, count, weight, in, out);
}

void combine_rows(int n, int count, const float* weight, const float* const* rows, float* out) {
  HWY_DYNAMIC_DISPATCH(combine_rows)(n, count, weight, rows, out);
}

void reduce_sums(int channels, int n, const float* sums, float* out) {
  HWY_DYNAMIC_DISPATCH(reduce_sums)(channels, n, sums, out);
}

void prefilter_rows(int channels, int width, int skip, const float* const in[8], float* const out[8], float* work) {
  HWY_DYNAMIC_DISPATCH(prefilter_rows)(channels, width, skip, in, out, work);
}

void prefilter_columns(int n, int rows, std::ptrdiff_t pitch, float* texels) {
  HWY_DYNAMIC_DISPATCH(prefilter_columns)(n, rows, pitch, texels);
}

void rotate_directions(const float matrix[9], std::size_t n, float* x, float* y, float* z) {
  HWY_DYNAMIC_DISPATCH(rotate_directions)(matrix, n, x, y, z);
}

const char* simd_target() {
  // Better targets have lower bits.
  const auto targets = hwy::SupportedTargets() & HWY_TARGETS;
  return hwy::TargetName(targets & (~targets + 1));
}

}  // namespace envconv
#endif
