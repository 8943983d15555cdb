// SPDX-License-Identifier: Apache-2.0
// Dual paraboloid: a stereographic projection of each hemisphere.  Conformal.
//
//        .--+Y--.        .--+Y--.        a = 2u-1 right, b = 1-2v up.  A hemisphere is the inscribed disc
//      -X   +Z  +X     +X   -Z  -X       a^2 + b^2 <= 1; the corners, and an apron, go on over its rim
//        `--(-Y)'        `--(-Y)'        by the same formula.
//         front            back
//
// Source: Heidrich & Seidel, View-independent Environment Maps, Graphics Hardware 1998, section 3.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "layouts/paraboloid.cpp"
#include "layout_kernel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {

struct paraboloid {
  static LayoutInfo info() {
    static constexpr Face faces[] = {{"front"}, {"back"}};
    static constexpr int rows[] = {2};
    return {.title = "Dual paraboloid",
            .source = "Heidrich & Seidel 1998",
            .notes =
                "Two stereographic discs: front, centre +Z, and back, centre -Z, both seen from inside with +Y up. "
                "Conformal; texels at a disc's rim span a quarter of the solid angle of those at its centre. The "
                "corners beyond a disc hold the true radiance of the other hemisphere.",
            .faces = faces,
            .domain = Domain::overlap,
            .congruent = true,
            .conformal = true,
            .rows = rows,
            .max_error = 0.0025};
  }
  template <class F>
  static void direction(int face, F u, F v, Vec<F>& d) {
    const F a = 2.0 * u - 1.0, b = 1.0 - 2.0 * v;
    const F r2 = a * a + b * b;
    const F k = 2.0 / (1.0 + r2);
    const F x = k * a, z = (1.0 - r2) / (1.0 + r2);
    // The back is the front turned by half a turn about +Y.
    d = {face == 0 ? x : -x, k * b, face == 0 ? z : -z};
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    const auto back = d.z < 0.0;
    const F l = sqrt(d.x * d.x + d.y * d.y + d.z * d.z);
    const F k = 0.5 / (l + abs(d.z));
    face = select(back, F(1.0), F(0.0));
    u = 0.5 + k * select(back, -d.x, d.x);
    v = 0.5 - k * d.y;
  }
};

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
ENVCONV_EXPORT_LAYOUT(paraboloid)
