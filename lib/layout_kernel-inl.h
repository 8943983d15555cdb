// SPDX-License-Identifier: Apache-2.0
// All the SIMD ceremony of a layout's file: compiles that file once per target, gives its formulas the type Lane, and
// exports the batch loops with run-time dispatch.  A layout's file reads
//
//     #undef HWY_TARGET_INCLUDE
//     #define HWY_TARGET_INCLUDE "layouts/NAME.cpp"
//     #include "layout_kernel-inl.h"
//
//     HWY_BEFORE_NAMESPACE();
//     namespace envconv::HWY_NAMESPACE {
//     struct NAME {
//       static LayoutInfo info();
//       // Unit direction of face point (u, v); goes on smoothly beyond the edges.
//       template <class F> static void direction(int face, F u, F v, Vec<F>& d);
//       // Owner of direction d of any length; face is a whole number.
//       template <class F> static void locate(const Vec<F>& d, F& face, F& u, F& v);
//     };
//     }
//     HWY_AFTER_NAMESPACE();
//     ENVCONV_EXPORT_LAYOUT(NAME)
//
// Each formula is written once over a type F: Lane (lane-inl.h), double or Jet (kernel_math.h).  Formulas are
// branch-free, as lanes demand, and use the words listed in kernel_math.h only.  No multiply-add is used, and these
// files are compiled with contraction off, so that algebraic layouts give the same bits on every processor.

// Once per file, whatever the number of targets.
#ifndef ENVCONV_LAYOUT_KERNEL_ONCE
#define ENVCONV_LAYOUT_KERNEL_ONCE
#include "geometry.h"
#include "layout.h"
#endif

#include "lane-inl.h"

// Once per target.
#if defined(ENVCONV_LAYOUT_KERNEL_TARGET) == defined(HWY_TARGET_TOGGLE)
#ifdef HWY_TARGET_TOGGLE
#undef ENVCONV_LAYOUT_KERNEL_TARGET
#else
#define ENVCONV_LAYOUT_KERNEL_TARGET
#endif

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Unit vector along d.
template <class F>
HWY_INLINE Vec<F> normalized(const Vec<F>& d) {
  const F r = 1.0 / sqrt(d.x * d.x + d.y * d.y + d.z * d.z);
  return {d.x * r, d.y * r, d.z * r};
}

/// Length of (x, y) and the unit vector along it, exact to rounding however short it is (its square may underflow);
/// along x for (0, 0).
template <class F>
HWY_INLINE F polar(F x, F y, F& unit_x, F& unit_y) {
  const F big = max(abs(x), abs(y));
  const auto zero = big <= 0.0;
  const F p = select(zero, F(1.0), x / big), q = select(zero, F(0.0), y / big);
  const F length = sqrt(p * p + q * q);  // in [1, sqrt 2]
  unit_x = p / length;
  unit_y = q / length;
  return big * length;
}

/// Azimuthal equidistant projection about +Z: the direction at |(a, b)| times `turns` from the axis, a towards +X and
/// b towards +Y.  One formula for all a, b: past the antipode it comes back on the other side.
template <class F>
HWY_INLINE void azimuthal_equidistant(double turns, F a, F b, Vec<F>& d) {
  const F r = sqrt(a * a + b * b);
  F sine, cosine;
  sincos_turns(turns * r, sine, cosine);
  const F k = select(r > 0.0, sine / max(r, 1e-30), F(2.0 * pi * turns));
  d = {k * a, k * b, cosine};
}

template <class Kernel>
void directions_batch(int face, std::size_t n, const float* HWY_RESTRICT u, const float* HWY_RESTRICT v,
                      float* HWY_RESTRICT x, float* HWY_RESTRICT y, float* HWY_RESTRICT z) {
  const LaneTag tag;
  for (std::size_t i = 0; i < n; i += hn::Lanes(tag)) {
    Vec<Lane> d;
    Kernel::direction(face, Lane(hn::LoadU(tag, u + i)), Lane(hn::LoadU(tag, v + i)), d);
    hn::StoreU(d.x.v, tag, x + i);
    hn::StoreU(d.y.v, tag, y + i);
    hn::StoreU(d.z.v, tag, z + i);
  }
}

template <class Kernel>
void locations_batch(std::size_t n, const float* HWY_RESTRICT x, const float* HWY_RESTRICT y,
                     const float* HWY_RESTRICT z, float* HWY_RESTRICT face, float* HWY_RESTRICT u,
                     float* HWY_RESTRICT v) {
  const LaneTag tag;
  for (std::size_t i = 0; i < n; i += hn::Lanes(tag)) {
    const Vec<Lane> d{Lane(hn::LoadU(tag, x + i)), Lane(hn::LoadU(tag, y + i)), Lane(hn::LoadU(tag, z + i))};
    Lane f, s, t;
    Kernel::locate(d, f, s, t);
    hn::StoreU(f.v, tag, face + i);
    hn::StoreU(min(max(s, 0.0), 1.0).v, tag, u + i);
    hn::StoreU(min(max(t, 0.0), 1.0).v, tag, v + i);
  }
}

// The double versions, instantiated from the last target's copy of the formula only.
template <class Kernel>
Vec3 direction_double(int face, double u, double v) {
  Vec3 d;
  Kernel::direction(face, u, v, d);
  return normalized(d);
}
template <class Kernel>
DirectionJet direction_jet(int face, double u, double v) {
  Vec<Jet> d;
  Kernel::direction(face, Jet(u, 1, 0), Jet(v, 0, 1), d);
  d = normalized(d);
  return {{d.x.v, d.y.v, d.z.v}, {d.x.du, d.y.du, d.z.du}, {d.x.dv, d.y.dv, d.z.dv}};
}
// The layout's own formula, where it has one: a tenth of the time.
template <class Kernel>
double density_double(int face, double u, double v) {
  if constexpr (requires { Kernel::density(face, u, v); }) {
    return Kernel::density(face, u, v);
  } else {
    const DirectionJet jet = direction_jet<Kernel>(face, u, v);
    return length(cross(jet.du, jet.dv));
  }
}
template <class Kernel>
Location locate_double(Vec3 d) {
  double face, u, v;
  Kernel::locate(d, face, u, v);
  return {static_cast<int>(face), min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0)};
}
// Its coordinates there are not computed: -fno-math-errno lets the compiler leave their functions out.
template <class Kernel>
int owner_double(int face, double u, double v) {
  Vec3 d;
  Kernel::direction(face, u, v, d);
  double owner, ignored_u, ignored_v;
  Kernel::locate(d, owner, ignored_u, ignored_v);
  return static_cast<int>(owner);
}

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

/// Makes envconv::layout_kernels_SYMBOL() from the struct SYMBOL: per target two plain functions, dispatched at run
/// time; the double and Jet versions once.  Stands after the namespace, so each target's pass sees it.
#undef ENVCONV_EXPORT_LAYOUT
#if HWY_ONCE
#define ENVCONV_EXPORT_LAYOUT(symbol)                                                                            \
  ENVCONV_EXPORT_TARGET(symbol)                                                                                  \
  namespace envconv {                                                                                            \
  HWY_EXPORT(directions_##symbol);                                                                               \
  HWY_EXPORT(locations_##symbol);                                                                                \
  LayoutKernels layout_kernels_##symbol() {                                                                      \
    namespace target = HWY_NAMESPACE;                                                                            \
    return {target::symbol::info,                                                                                \
            target::direction_double<target::symbol>,                                                            \
            target::direction_jet<target::symbol>,                                                               \
            target::density_double<target::symbol>,                                                              \
            target::locate_double<target::symbol>,                                                               \
            target::owner_double<target::symbol>,                                                                \
            [](int face, std::size_t n, const float* u, const float* v, float* x, float* y, float* z) {          \
              HWY_DYNAMIC_DISPATCH(directions_##symbol)(face, n, u, v, x, y, z);                                 \
            },                                                                                                   \
            [](std::size_t n, const float* x, const float* y, const float* z, float* face, float* u, float* v) { \
              HWY_DYNAMIC_DISPATCH(locations_##symbol)(n, x, y, z, face, u, v);                                  \
            }};                                                                                                  \
  }                                                                                                              \
  }
#else
#define ENVCONV_EXPORT_LAYOUT(symbol) ENVCONV_EXPORT_TARGET(symbol)
#endif
#ifndef ENVCONV_EXPORT_TARGET
#define ENVCONV_EXPORT_TARGET(symbol)                                                                               \
  HWY_BEFORE_NAMESPACE();                                                                                           \
  namespace envconv::HWY_NAMESPACE {                                                                                \
  void directions_##symbol(int face, std::size_t n, const float* u, const float* v, float* x, float* y, float* z) { \
    directions_batch<symbol>(face, n, u, v, x, y, z);                                                               \
  }                                                                                                                 \
  void locations_##symbol(std::size_t n, const float* x, const float* y, const float* z, float* face, float* u,     \
                          float* v) {                                                                               \
    locations_batch<symbol>(n, x, y, z, face, u, v);                                                                \
  }                                                                                                                 \
  }                                                                                                                 \
  HWY_AFTER_NAMESPACE();
#endif

#endif  // once per target
