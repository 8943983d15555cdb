// SPDX-License-Identifier: Apache-2.0
// Isocube: a cube map whose texels all span the same solid angle.
//
//            +----+                The cube's six faces.  The four side faces are the zone |y| <= 2/3, with equal steps
//            | +Y |                of azimuth and of height.  A polar face holds rings max(|s|, |t|) = c, each the
//       +----+----+----+----+      circle |y| = 1 - c^2/3, with equal steps of azimuth along each of the ring's
//       | -X | +Z | +X | -Z |      four sides.
//       +----+----+----+----+
//            | -Y |                s right, t down, both in [-1, 1].
//            +----+
//
// Source: Wan, Wong & Leung, Isocube: Exploiting the Cubemap Hardware, IEEE TVCG 13(4), 2007, equations 1 to 4 and the
// shader of appendix C.  Errata: table I's first row of a_21 is the range (2/3, 1]; table I's quadrants are those of
// the shader, turned by pi/4; the discriminant in appendix A is EG - F^2; the shader leaves its table at azimuth -pi/4
// exactly.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "layouts/isocube.cpp"
#include "layout_kernel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {

struct isocube {
  static LayoutInfo info() {
    static constexpr Face faces[] = {{"px"}, {"nx"}, {"py"}, {"ny"}, {"pz"}, {"nz"}};
    static constexpr int rows[] = {6};
    return {.title = "Isocube (equal-area cube map)",
            .source = "Wan, Wong & Leung, IEEE TVCG 13(4), 2007, eqs. 1-4, app. C",
            .notes =
                "The cube's faces, order and orientation, with texels of exactly equal solid angle: side faces hold "
                "the heights |y| <= 2/3. Looked up as a cube map with the vector that the shader of the paper's "
                "appendix C computes. Errata of the paper: table I's first range of a_21 is (2/3, 1]; its quadrants "
                "are those of the shader, turned by pi/4; the discriminant in appendix A is EG - F^2; the shader's "
                "table lacks an entry for azimuth -pi/4 exactly.",
            .faces = faces,
            .equal_area = true,
            .congruent = true,
            .rows = rows,
            .max_error = 0.003};
  }
  // Height and distance from the axis on the meridian at t, counted upwards (1 at the upper edge of a side face), or at
  // c = 2 - t, counted from the pole (1 at the edge of the polar face).  The two formulas meet at the edge with equal
  // slopes, so that aprons go on smoothly over it, and over the pole too (c < 0).  For -1 <= t.
  template <class F>
  static void meridian(F t, F c, F& height, F& h) {
    const auto polar_zone = c < 1.0;
    const F drop = c * c * (1.0 / 3.0);
    const F y = (2.0 / 3.0) * t;
    height = select(polar_zone, 1.0 - drop, y);
    // sqrt(1 - height^2), in the polar zone without cancellation.
    const F root = sqrt(select(polar_zone, (2.0 - drop) * (1.0 / 3.0), 1.0 - y * y));
    h = select(polar_zone, c * root, root);
  }
  template <class F>
  static void direction(int face, F u, F v, Vec<F>& d) {
    const F s = 2.0 * u - 1.0, t = 2.0 * v - 1.0;
    F height, h, sine, cosine;
    if (face == 2 || face == 3) {
      const F as = abs(s), at = abs(t);
      const F c = min(max(as, at), 3.0);  // at 3 the other pole's zone would begin
      meridian(2.0 - c, c, height, h);
      const auto t_major = at >= as;
      const F along = select(t_major, s, t) / max(max(as, at), 1e-30);  // [-1, 1]: 45 degrees either way
      sincos_turns(0.125 * along, sine, cosine);
      const F major = h * cosine, minor = h * sine;
      const F x = select(t_major, minor, copysign(major, s));
      const F down = select(t_major, copysign(major, t), minor);
      d = {x, face == 2 ? height : -height, face == 2 ? down : -down};
    } else {
      const F at = min(abs(t), 4.0);  // over the pole and on; at 2 + sqrt 6 the other pole would be passed
      meridian(at, 2.0 - at, height, h);
      const F y = copysign(height, -t);
      sincos_turns(0.125 * s, sine, cosine);
      const F right = h * sine, centre = h * cosine;
      switch (face) {
        case 0: d = {centre, y, -right}; break;
        case 1: d = {-centre, y, right}; break;
        case 4: d = {right, y, centre}; break;
        default: d = {-right, y, -centre}; break;
      }
    }
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    const F ax = abs(d.x), ay = abs(d.y), az = abs(d.z);
    const F h2 = d.x * d.x + d.z * d.z;
    const F l = sqrt(h2 + d.y * d.y);
    // Appendix C's quadrants are the four sides on which |x| or |z| is the larger; on each, 2 phi less its middle's is
    // `along`, in [-1, 1].
    const auto z_major = az >= ax;
    const F along = 8.0 * atan2_turns(select(z_major, d.x, d.z), max(ax, az));
    const auto side = ay <= (2.0 / 3.0) * l;
    // c = sqrt(3 (1 - |y|/l)), without the cancellation at the poles.
    const F c = select(side, F(1.0), sqrt(3.0 * h2 / (l * (l + ay))));
    const F minor = c * along;
    const F qx = select(z_major, minor, copysign(c, d.x));
    const F qz = select(z_major, copysign(c, d.z), minor);
    const auto negative_x = d.x < 0.0, negative_y = d.y < 0.0, negative_z = d.z < 0.0;
    // The cube's table on Q.
    const F x_face = select(negative_x, F(1.0), F(0.0));
    const F y_face = select(negative_y, F(3.0), F(2.0));
    const F z_face = select(negative_z, F(5.0), F(4.0));
    face = select(side, select(z_major, z_face, x_face), y_face);
    const F side_s = select(z_major, select(negative_z, -along, along), select(negative_x, along, -along));
    u = 0.5 + 0.5 * select(side, side_s, qx);
    v = 0.5 + 0.5 * select(side, -1.5 * d.y / l, select(negative_y, -qz, qz));
  }
};

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
ENVCONV_EXPORT_LAYOUT(isocube)
