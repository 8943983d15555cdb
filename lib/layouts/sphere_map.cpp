// SPDX-License-Identifier: Apache-2.0
// OpenGL's sphere map: Lambert's azimuthal equal-area projection.  Centre +Z; the whole rim of the disc is -Z.
//
// With a = 2u-1, b = 1-2v, r^2 = a^2 + b^2:  d = (2a sqrt(1-r^2), 2b sqrt(1-r^2), 1-2r^2).
// Source: Zimmons & Bastos, equation 2; SIGGRAPH 2001 notes, "The Mathematics of Sphere Mapping", whose reverse mapping
// exchanges the factors of R_x and R_y (erratum).
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "layouts/sphere_map.cpp"
#include "layout_kernel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {

// A point beyond the rim (r > 1) comes back on the other side, at 2 - r: the rim is one point of the sphere.
template <class F>
void come_back_beyond_rim(F& a, F& b) {
  const F r = sqrt(a * a + b * b);
  const F scale = select(r > 1.0, 1.0 - 2.0 / max(r, 1.0), F(1.0));  // (2 - r)/r, turned by half a turn
  a = a * scale;
  b = b * scale;
}

struct sphere_map {
  static LayoutInfo info() {
    static constexpr Face faces[] = {{"sphere"}};
    static constexpr int rows[] = {1};
    return {.title = "Sphere map (OpenGL)",
            .source = "OpenGL 2.1, section 2.11.4; Zimmons & Bastos, eq. 2; Lambert 1772",
            .notes =
                "Lambert's azimuthal equal-area projection: centre +Z, the whole rim -Z, where texels are infinitely "
                "stretched. Texels beyond the rim hold the nearest rim's radiance.",
            .faces = faces,
            .domain = Domain::disc,
            .equal_area = true,
            .rows = rows};
  }
  template <class F>
  static void direction(int /*face*/, F u, F v, Vec<F>& d) {
    F a = 2.0 * u - 1.0, b = 1.0 - 2.0 * v;
    come_back_beyond_rim(a, b);
    const F r2 = min(a * a + b * b, 1.0);
    const F k = 2.0 * sqrt(max(1.0 - r2, 0.0));
    d = {k * a, k * b, 1.0 - 2.0 * r2};
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    face = 0.0;
    F right, up;
    const F h = polar(d.x, d.y, right, up);
    const F l = sqrt(h * h + d.z * d.z);
    // 2 sin^2(theta/2) = (l - z) / l, with l - z = h^2 / (l + z) in front, where the difference would cancel.
    const F versine = select(d.z > 0.0, h * h / (l + max(d.z, 0.0)), l - d.z) / l;
    const F half_r = 0.5 * sqrt(0.5 * versine);
    u = 0.5 + half_r * right;
    v = 0.5 - half_r * up;
  }
};

struct mirror_ball : sphere_map {
  static LayoutInfo info() {
    static constexpr Face faces[] = {{"ball"}};
    LayoutInfo info = sphere_map::info();
    info.title = "Mirror ball (photograph of a chrome sphere)";
    info.source = "Blinn & Newell 1976; Debevec 1998";
    info.notes =
        "The sphere map under the frame opengl: the centre shows what is behind the camera, the rim what is in "
        "front of it. As every photograph of a mirror, it is a mirrored picture.";
    info.faces = faces;
    info.frame = "opengl";
    return info;
  }
};

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
ENVCONV_EXPORT_LAYOUT(sphere_map)
ENVCONV_EXPORT_LAYOUT(mirror_ball)
