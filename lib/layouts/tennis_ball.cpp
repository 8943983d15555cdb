// SPDX-License-Identifier: Apache-2.0
// Tennis-ball map: two congruent strips, each the middle half of a lat-long map, three quarters of a turn long.
//
//      .------------------------------.       A strip's equator runs along it:
//     ( -Z/-X   -X     +Z     +X  +X/-Z)  C1   C1 about +Y, through -X, +Z and +X
//      `------------------------------'
//      .------------------------------.        C2 about +X, through -Y, -Z and +Y
//     ( -Y/+Z   -Y     -Z     +Y  +Y/+Z)  C2
//      `------------------------------'       The seam cuts the corners off; texels beyond it are true views still.
//
// Source: Herron, The Tennis-ball Map, equations 1 to 3, the seam of section 2.1.  Erratum: equation 4 has atan2(a, -c)
// for C1; equation 3 is right.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "layouts/tennis_ball.cpp"
#include "layout_kernel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {

struct tennis_ball {
  static LayoutInfo info() {
    static constexpr Face faces[] = {{"c1", 3.0}, {"c2", 3.0}};
    static constexpr int rows[] = {1, 1};
    return {.title = "Tennis-ball map",
            .source = "Herron, The Tennis-ball Map, eqs. 1-3, sec. 2.1",
            .notes =
                "Two 3:1 strips: c1 is centred on +Z with +Y up and wraps around to +X and -X; c2 is centred on -Z "
                "with +X up and wraps around to +Y and -Y. For a given detail no map of so few faces needs fewer "
                "texels. Those in the corners beyond the seam hold their true radiance, which makes the whole "
                "rectangles the Yin-Yang grid. Erratum: the paper's equation 4 has a wrong sign in c1's atan2.",
            .faces = faces,
            .domain = Domain::overlap,
            .zonal = true,
            .congruent = true,
            .rows = rows,
            .max_error = 0.002};
  }
  template <class F>
  static void direction(int face, F u, F v, Vec<F>& d) {
    F sin_phi, cos_phi, sin_theta, cos_theta;
    sincos_turns(0.75 * (u - 0.5), sin_phi, cos_phi);
    sincos_turns(0.25 * (0.5 - v), sin_theta, cos_theta);
    const F along = sin_phi * cos_theta, centre = cos_phi * cos_theta;
    if (face == 0)
      d = {along, sin_theta, centre};
    else
      d = {sin_theta, along, -centre};
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    const F x2 = d.x * d.x, y2 = d.y * d.y, z2 = d.z * d.z;
    // Section 2.1's half planes: |y| <= sqrt(1/2) for a unit vector is y^2 <= x^2 + z^2.  Both conditions agree on z =
    // 0.
    const auto c1 = ((d.z >= 0.0) & (y2 <= x2 + z2)) | ((d.z <= 0.0) & (x2 >= y2 + z2));
    const F along = select(c1, d.x, d.y), across = select(c1, d.y, d.x), centre = select(c1, d.z, -d.z);
    face = select(c1, F(0.0), F(1.0));
    u = 0.5 + atan2_turns(along, centre) * (4.0 / 3.0);
    v = 0.5 - 4.0 * atan2_turns(across, sqrt(along * along + centre * centre));
  }
};

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
ENVCONV_EXPORT_LAYOUT(tennis_ball)
