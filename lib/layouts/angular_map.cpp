// SPDX-License-Identifier: Apache-2.0
// Angular map (light probe): azimuthal equidistant projection of the whole sphere.  Centre +Z; the whole rim is -Z.
//
//        . -Z- .         The distance from the centre is the angle from +Z, half a turn at the rim (r = 1):
//      /   +Y    \       the half radius is the circle of 90 degrees.  In corners, r > 1, the angle simply
//    -Z -X +Z +X  -Z     grows past half a turn: back from -Z on the other side.
//      \   -Y    /
//        ` -Z- `
//
// Source: Debevec, Light Probe Image Gallery: r = (1/pi) acos(Dz) / sqrt(Dx^2 + Dy^2), (u, v) = (Dx r, Dy r).
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "layouts/angular_map.cpp"
#include "layout_kernel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {

struct angular_map {
  static LayoutInfo info() {
    static constexpr Face faces[] = {{"angular"}};
    static constexpr int rows[] = {1};
    return {
        .title = "Angular map (light probe)",
        .source = "Debevec, Light Probe Image Gallery, 1999; azimuthal equidistant projection",
        .notes =
            "The distance from the centre is the angle from it, half a turn at the rim. Centre +Z, the whole rim -Z. "
            "Debevec's probes are this picture: straight ahead, which his axes call -Z, is the centre. His page's "
            "formula, acos(Dz), read in the same axes is a mirrored picture: the frame opengl. Texels beyond the "
            "rim hold the nearest rim's radiance.",
        .faces = faces,
        .domain = Domain::disc,
        .rows = rows,
        .max_error = 0.0025};
  }
  template <class F>
  static void direction(int /*face*/, F u, F v, Vec<F>& d) {
    azimuthal_equidistant(0.5, 2.0 * u - 1.0, 1.0 - 2.0 * v, d);
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    // acos(z) would lose half the digits at both poles; atan2 of both legs loses none.
    F right, up;
    const F h = polar(d.x, d.y, right, up);
    const F half_r = atan2_turns(h, d.z);
    face = 0.0;
    u = 0.5 + half_r * right;
    v = 0.5 - half_r * up;
  }
};

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
ENVCONV_EXPORT_LAYOUT(angular_map)
