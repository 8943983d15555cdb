// SPDX-License-Identifier: Apache-2.0
#include "window_kernels.h"

#include <algorithm>
#include <array>
#include <cmath>

#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV | HWY_SSSE3 | HWY_AVX3_DL)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "window_kernels.cpp"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

#ifndef ENVCONV_WINDOW_KERNELS_ONCE
#define ENVCONV_WINDOW_KERNELS_ONCE
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

// Weights of a tap after the middle one, a polynomial in f, and of the one as far before it, the same in -f.
template <class V>
HWY_INLINE void tap_pair(V f, V ff, const float* c, V& before, V& after) {
  const V even = polynomial<4, 2>(ff, c), odd = hn::Mul(f, polynomial<3, 2>(ff, c + 1));
  before = hn::Sub(even, odd), after = hn::Add(even, odd);
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
  } else if constexpr (kernel == Kernel::band_limited || kernel == Kernel::drooping) {
    constexpr const float* c0 = kernel == Kernel::drooping ? drooping::c0 : band_limited::c0;
    constexpr const float* c1 = kernel == Kernel::drooping ? drooping::c1 : band_limited::c1;
    constexpr const float* c2 = kernel == Kernel::drooping ? drooping::c2 : band_limited::c2;
    const V ff = hn::Mul(f, f);
    w[2] = polynomial<4, 1>(ff, c0);
    tap_pair(f, ff, c1, w[1], w[3]), tap_pair(f, ff, c2, w[0], w[4]);
  } else if constexpr (kernel == Kernel::band_limited_wide) {
    const V ff = hn::Mul(f, f);
    w[3] = polynomial<4, 1>(ff, band_limited_wide::c0);
    tap_pair(f, ff, band_limited_wide::c1, w[2], w[4]);
    tap_pair(f, ff, band_limited_wide::c2, w[1], w[5]);
    tap_pair(f, ff, band_limited_wide::c3, w[0], w[6]);
  }
}

// Places of samples in their faces' texels, in whole texels from (x, y) on.
struct ByFace {
  const FaceMaps& maps;
  const float *HWY_RESTRICT face, *HWY_RESTRICT u, *HWY_RESTRICT v;
  static constexpr std::int32_t x = 0, y = 0;

  template <class D, class V = hn::Vec<D>>
  HWY_INLINE void at(D d, int i, V& px, V& py) const {
    const hn::RebindToSigned<D> di;
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
    px = hn::MulAdd(hn::LoadU(d, u + i), scale_u, bias_u);
    py = hn::MulAdd(hn::LoadU(d, v + i), scale_v, bias_v);
  }
};

template <class V>
HWY_INLINE V steps_along(float first, float step, int i) {
  const hn::DFromV<V> d;
  return hn::MulAdd(hn::Iota(d, static_cast<float>(i)), hn::Set(d, step), hn::Set(d, first));
}

struct ByRow {
  const RowMap& row;
  float first, step;
  int begin;
  std::int32_t x, y;

  template <class D, class V = hn::Vec<D>>
  HWY_INLINE void at(D d, int i, V& px, V& py) const {
    const V s = steps_along<V>(first, step, i - begin);
    px = hn::Min(hn::Max(polynomial<5, 1>(s, row.to_x), hn::Set(d, row.left)), hn::Set(d, row.right));
    py = hn::Min(hn::Max(polynomial<5, 1>(s, row.to_y), hn::Set(d, row.top)), hn::Set(d, row.bottom));
  }
};

// Samples [begin, end).
template <Kernel kernel, class Places>
void windows_of(const Places& places, int begin, int end, const float* HWY_RESTRICT weight, Windows& s) {
  constexpr bool to_nearest = taps(kernel) % 2 == 1;
  const hn::ScalableTag<float> d;
  const hn::RebindToSigned<decltype(d)> di;
  using V = hn::Vec<decltype(d)>;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int i = begin; i < end; i += lanes) {
    V x, y;
    places.at(d, i, x, y);
    const V half = hn::Set(d, 0.5f);
    const V x0 = hn::Floor(to_nearest ? hn::Add(x, half) : x), y0 = hn::Floor(to_nearest ? hn::Add(y, half) : y);
    const V fx = hn::Sub(x, x0), fy = hn::Sub(y, y0);
    hn::StoreU(hn::Add(hn::ConvertTo(di, x0), hn::Set(di, places.x)), di, s.x + i);
    hn::StoreU(hn::Add(hn::ConvertTo(di, y0), hn::Set(di, places.y)), di, s.y + i);
    hn::StoreU(fx, d, s.fx + i);
    hn::StoreU(fy, d, s.fy + i);
    if constexpr (kernel != Kernel::lanczos3) {
      const V w = hn::LoadU(d, weight + i);
      V a[8];
      tap_weights<kernel>(fx, a);
      hn::StoreInterleaved4(a[0], a[1], a[2], a[3], d, s.wx[0] + 4 * i);
      if constexpr (taps(kernel) > 4) hn::StoreInterleaved4(a[4], a[5], a[6], a[7], d, s.wx[1] + 4 * i);
      tap_weights<kernel>(fy, a);
      for (int k = 0; k < taps(kernel); ++k) hn::StoreU(hn::Mul(w, a[k]), d, s.wy[k] + i);
    }
  }
  if constexpr (kernel == Kernel::lanczos3) {
    const LanczosTable& table = lanczos_table();
    for (int i = begin; i < end; ++i) {
      const auto fill = [&](float f, const auto& put) {
        const float t = f * 1024.0f;
        const int k = std::min(static_cast<int>(t), 1023);
        const float r = t - static_cast<float>(k);
        const auto& a = table.rows[static_cast<std::size_t>(k)];
        const auto& b = table.rows[static_cast<std::size_t>(k) + 1];
        for (std::size_t j = 0; j < 6; ++j) put(static_cast<int>(j), a[j] + r * (b[j] - a[j]));
      };
      fill(s.fx[i], [&](int k, float w) { s.wx[k / 4][4 * i + k % 4] = w; });
      s.wx[1][4 * i + 2] = s.wx[1][4 * i + 3] = 0;
      fill(s.fy[i], [&](int k, float w) { s.wy[k][i] = weight[i] * w; });
    }
  }
}

template <class Places>
void windows_of(Kernel kernel, const Places& places, int begin, int end, const float* weight, Windows& windows) {
  switch (kernel) {
    case Kernel::nearest: return windows_of<Kernel::nearest>(places, begin, end, weight, windows);
    case Kernel::bilinear: return windows_of<Kernel::bilinear>(places, begin, end, weight, windows);
    case Kernel::catmull_rom: return windows_of<Kernel::catmull_rom>(places, begin, end, weight, windows);
    case Kernel::band_limited: return windows_of<Kernel::band_limited>(places, begin, end, weight, windows);
    case Kernel::band_limited_wide: return windows_of<Kernel::band_limited_wide>(places, begin, end, weight, windows);
    case Kernel::drooping: return windows_of<Kernel::drooping>(places, begin, end, weight, windows);
    case Kernel::lanczos3: return windows_of<Kernel::lanczos3>(places, begin, end, weight, windows);
  }
}

void make_windows(const FaceMaps& maps, Kernel kernel, int n, const float* face, const float* u, const float* v,
                  const float* weight, Windows& windows) {
  windows_of(kernel, ByFace{maps, face, u, v}, 0, n, weight, windows);
}

void make_windows_along(const RowMap& row, Kernel kernel, float first, float step, int begin, int n,
                        const float* weight, Windows& windows) {
  windows_of(kernel, ByRow{row, first, step, begin, row.x, row.y}, begin, begin + n, weight, windows);
}

void evaluate_quartic(const float c[5], float first, float step, int n, float* HWY_RESTRICT out) {
  const hn::ScalableTag<float> d;
  using V = hn::Vec<decltype(d)>;
  for (int i = 0; i < n; i += static_cast<int>(hn::Lanes(d)))
    hn::StoreU(polynomial<5, 1>(steps_along<V>(first, step, i), c), d, out + i);
}

int point_windows(const WindowField& field, int channels, const float* HWY_RESTRICT face, int begin, int n,
                  Windows& windows) {
  const hn::ScalableTag<float> d;
  const hn::RebindToSigned<decltype(d)> di;
  const int lanes = static_cast<int>(hn::Lanes(d));
  int end = begin + 1;
  for (; end + lanes <= n; end += lanes) {
    const auto x = hn::LoadU(di, windows.x + end), y = hn::LoadU(di, windows.y + end);
    const auto across = hn::And(hn::Gt(x, hn::Set(di, field.left - 1)), hn::Lt(x, hn::Set(di, field.right)));
    const auto down = hn::And(hn::Gt(y, hn::Set(di, field.top - 1)), hn::Lt(y, hn::Set(di, field.bottom)));
    const auto same = hn::RebindMask(di, hn::Eq(hn::LoadU(d, face + end), hn::Set(d, face[begin])));
    if (!hn::AllTrue(di, hn::And(hn::And(across, down), same))) break;
  }
  const auto holds = [&](int i) {
    return windows.x[i] >= field.left && windows.x[i] < field.right && windows.y[i] >= field.top &&
           windows.y[i] < field.bottom && face[i] == face[begin];
  };
  while (end < n && holds(end)) ++end;
  for (int i = begin; i < end; ++i) {
    windows.first[i] = field.origin + windows.y[i] * field.pitch + windows.x[i] * channels;
    windows.pitch[i] = field.pitch;
  }
  return end;
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
HWY_EXPORT(make_windows_along);
HWY_EXPORT(evaluate_quartic);
HWY_EXPORT(point_windows);
HWY_EXPORT(rotate_directions);

void make_windows(const FaceMaps& maps, Kernel kernel, int n, const float* face, const float* u, const float* v,
                  const float* weight, Windows& windows) {
  HWY_DYNAMIC_DISPATCH(make_windows)(maps, kernel, n, face, u, v, weight, windows);
}

void make_windows_along(const RowMap& row, Kernel kernel, float first, float step, int begin, int n,
                        const float* weight, Windows& windows) {
  HWY_DYNAMIC_DISPATCH(make_windows_along)(row, kernel, first, step, begin, n, weight, windows);
}

void evaluate_quartic(const float c[5], float first, float step, int n, float* out) {
  HWY_DYNAMIC_DISPATCH(evaluate_quartic)(c, first, step, n, out);
}

int point_windows(const WindowField& field, int channels, const float* face, int begin, int n, Windows& windows) {
  return HWY_DYNAMIC_DISPATCH(point_windows)(field, channels, face, begin, n, windows);
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
