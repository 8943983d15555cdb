// SPDX-License-Identifier: Apache-2.0
// Latitude-longitude (equirectangular) map: the panorama.
//
//      +-----------------------------+ +Y     u = 1/2 + atan2(x, z) / 2 pi
//      |  -Z   -X    +Z    +X    -Z  |        v = acos(y) / pi
//      +-----------------------------+ -Y
//
// Source: Blinn & Newell 1976.  OpenEXR's (ImfEnvmap.h) is the same picture with texel centres on the poles and on both
// ends of the seam: latlong-inclusive.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "layouts/latlong.cpp"
#include "layout_kernel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {

inline constexpr Face latlong_faces[] = {{"latlong", 2.0}};
inline constexpr int latlong_rows[] = {1};

struct latlong {
  static LayoutInfo info() {
    return {.title = "Latitude-longitude (equirectangular) panorama",
            .source = "Blinn & Newell 1976",
            .notes =
                "Centre +Z, right of centre +X, top row +Y. Beyond a pole the formula goes on down the opposite "
                "meridian, so seam and poles need no special case.",
            .faces = latlong_faces,
            .zonal = true,
            .rows = latlong_rows};
  }
  template <class F>
  static void direction(int /*face*/, F u, F v, Vec<F>& d) {
    F sin_lon, cos_lon, sin_theta, cos_theta;
    sincos_turns(u - 0.5, sin_lon, cos_lon);
    sincos_turns(0.5 * v, sin_theta, cos_theta);  // theta: angle from +Y
    d = {sin_lon * sin_theta, cos_theta, cos_lon * sin_theta};
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    face = 0.0;
    u = 0.5 + atan2_turns(d.x, d.z);
    v = 2.0 * atan2_turns(sqrt(d.x * d.x + d.z * d.z), d.y);
  }
};

struct latlong_inclusive : latlong {
  static LayoutInfo info() {
    LayoutInfo info = latlong::info();
    info.title = "Latitude-longitude, texel centres on poles and seam (OpenEXR)";
    info.source = "OpenEXR, ImfEnvmap.h";
    info.notes =
        "The same picture as latlong with the first and last rows on the poles and the first and last columns on "
        "the same meridian. Written to an EXR file it carries OpenEXR's envmap attribute.";
    info.placement = Placement::inclusive;
    return info;
  }
};

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
ENVCONV_EXPORT_LAYOUT(latlong)
ENVCONV_EXPORT_LAYOUT(latlong_inclusive)
