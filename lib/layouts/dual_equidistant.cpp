// SPDX-License-Identifier: Apache-2.0
// Dual equidistant: an azimuthal equidistant projection of each hemisphere.
//
//        .--+Y--.        .--+Y--.        The distance from a disc's centre is the angle from its axis, 90 degrees
//      -X   +Z  +X     +X   -Z  -X       at the rim; the corners, and an apron, go on over the rim by the same
//        `--(-Y)'        `--(-Y)'        formula.
//         front            back
//
// Source: Snyder & Mitchell, Sampling-Efficient Mapping of Spherical Images, Microsoft Research 2001.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "layouts/dual_equidistant.cpp"
#include "layout_kernel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {

struct dual_equidistant {
  static LayoutInfo info() {
    static constexpr Face faces[] = {{"front"}, {"back"}};
    static constexpr int rows[] = {2};
    return {.title = "Dual equidistant",
            .source = "Snyder & Mitchell 2001",
            .notes =
                "Two discs in which the distance from the centre is the angle from it, 90 degrees at the rim (a pair "
                "of ideal fisheye views): front, centre +Z, and back, centre -Z, both seen from inside with +Y up. "
                "The corners beyond a disc hold the true radiance of the other hemisphere.",
            .faces = faces,
            .domain = Domain::overlap,
            .congruent = true,
            .rows = rows,
            .max_error = 0.0025};
  }
  template <class F>
  static void direction(int face, F u, F v, Vec<F>& d) {
    azimuthal_equidistant(0.25, 2.0 * u - 1.0, 1.0 - 2.0 * v, d);
    if (face != 0) d = {-d.x, d.y, -d.z};  // the front turned by half a turn about +Y
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    const auto back = d.z < 0.0;
    F right, up;
    const F h = polar(select(back, -d.x, d.x), d.y, right, up);
    const F half_r = 2.0 * atan2_turns(h, abs(d.z));
    face = select(back, F(1.0), F(0.0));
    u = 0.5 + half_r * right;
    v = 0.5 - half_r * up;
  }
};

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
ENVCONV_EXPORT_LAYOUT(dual_equidistant)
