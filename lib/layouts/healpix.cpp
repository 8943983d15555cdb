// SPDX-License-Identifier: Apache-2.0
// HEALPix: twelve squares of equal area, texels of equal area, in the paper's nested order of base pixels.
//
//         /\    /\    /\    /\     X: azimuth in eighths of a turn from +Z towards +X;
//        /  \  /  \  /  \  /  \       it is 0 on the middle line of p4, 1 on those of p0 and p8
//       /    \/    \/    \/    \   jr: height, 0 at +Y, 2 on the equator, 4 at -Y
//      /\  0 /\  1 /\  2 /\  3 /
//     /  \  /  \  /  \  /  \  /    On every face u grows to the lower right and v to the lower
//    /    \/    \/    \/    \/     left: X = (its middle line) + u - v, jr = row + u + v, with
//    \  4 /\  5 /\  6 /\  7 /\     row 0 for p0 to p3, 1 for p4 to p7, 2 for p8 to p11.
//     \  /  \  /  \  /  \  /  \    The map between these squares and the sphere (below) keeps
//      \/    \/    \/    \/    \   areas, so every texel spans the same solid angle.
//       \  8 /\  9 /\ 10 /\ 11 /
//        \  /  \  /  \  /  \  /
//         \/    \/    \/    \/
//
// Source: Gorski et al., HEALPix, ApJ 622 (2005), pixel positions and pixel boundaries (z = 1 - i^2/3N^2 in a cap,
// z = 4/3 - 2i/3N in the belt, for ring i of N), with y here for the paper's z, phi = 0 at +Z growing towards +X, and a
// base pixel's nested coordinates x = 1 - v, y = 1 - u.  So with jr = i/N: in the belt 1 <= jr <= 3 height is
// (2/3)(2 - jr) and azimuth X; in a cap, with n = jr or 4 - jr, height is +-(1 - n^2/3), and azimuth is stretched by
// 1/n about the middle of the face.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "layouts/healpix.cpp"
#include "layout_kernel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {

struct healpix {
  static LayoutInfo info() {
    static constexpr Face faces[] = {{"p0"}, {"p1"}, {"p2"}, {"p3"}, {"p4"},  {"p5"},
                                     {"p6"}, {"p7"}, {"p8"}, {"p9"}, {"p10"}, {"p11"}};
    static constexpr int rows[] = {4, 4, 4};
    return {
        .title = "HEALPix",
        .source = "Gorski et al., HEALPix, ApJ 622, 2005",
        .notes =
            "Hierarchical equal area and iso-latitude pixelisation: the twelve base pixels in nested order as square "
            "faces; all texels span the same solid angle. The left upper corner of faces p0 to p3 is +Y, p4's centre "
            "is +Z.",
        .faces = faces,
        .equal_area = true,
        .congruent = true,
        .rows = rows,
        .max_error = 0.0045};
  }

  // In corners where three faces meet the quadrant beyond the corner has no place on the sphere.  p and q are the
  // distances beyond the two edges; where both are positive the smaller one is taken off both, which keeps the
  // picture continuous.
  template <class F>
  static F beyond_both(F p, F q) {
    return max(min(p, q), 0.0);
  }

  template <class F>
  static void direction(int face, F u, F v, Vec<F>& d) {
    const int row = face / 4, quadrant = face % 4;
    u = min(max(u, -1.0), 2.0);
    v = min(max(v, -1.0), 2.0);
    if (row == 2) {  // the southern faces are the northern ones mirrored in the equator
      const F t = u;
      u = 1.0 - v;
      v = 1.0 - t;
    }
    // jr, and X counted from the quadrant's first meridian.
    F jr, X;
    if (row == 1) {
      const F top = beyond_both(-u, -v);
      const F bottom = beyond_both(u - 1.0, v - 1.0);
      const F off = top - bottom;
      u = u + off;
      v = v + off;
      jr = 1.0 + (u + v);
      X = u - v;
    } else {
      const F off = beyond_both(-u, v - 1.0) - beyond_both(u - 1.0, -v);
      u = u + off;
      v = v - off;
      // The four faces of a pole meet in u = v = 0: the quadrants of the plane are the faces, each turned by a quarter.
      // (The formula itself does not go on there: X winds up as u + v goes to 0.)
      const auto u_beyond = u < 0.0, v_beyond = v < 0.0;
      jr = abs(u) + abs(v);
      X = select(u_beyond, select(v_beyond, 5.0 + (v - u), -1.0 + (u + v)),
                 select(v_beyond, 3.0 - (u + v), 1.0 + (u - v)));
    }
    const F n = named(min(min(F(1.0), jr), 4.0 - jr), "n");
    const auto in_cap = n < 1.0;
    // Azimuth in a cap: about the middle of the quadrant, an odd X.  Beyond the face's sides it stays on their
    // meridian.
    const F middle = 2.0 * floor(X * 0.5) + 1.0;
    const F stretched = middle + max(F(-1.0), min(F(1.0), (X - middle) / max(n, 1e-12)));
    F sin_phi, cos_phi;
    sincos_turns(0.125 * select(in_cap, stretched, X), sin_phi, cos_phi);
    const F belt = (2.0 / 3.0) * (2.0 - jr);
    const F drop = n * n * (1.0 / 3.0);  // 1 - |z| in a cap
    const F height = select(in_cap, copysign(1.0 - drop, belt), belt);
    // 1 - z^2, without cancellation near the pole: (1 - |z|)(1 + |z|).
    const F sine = select(in_cap, n * sqrt((2.0 - drop) * (1.0 / 3.0)), sqrt(max(1.0 - belt * belt, 0.0)));
    const F x = sine * sin_phi, z = sine * cos_phi, y = row == 2 ? -height : height;
    switch (quadrant) {  // quarter turns are exact
      case 0: d = {x, y, z}; break;
      case 1: d = {z, y, -x}; break;
      case 2: d = {-x, y, -z}; break;
      default: d = {-z, y, x}; break;
    }
  }

  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    const F ax = abs(d.x), ay = abs(d.y), az = abs(d.z);
    const F h2 = d.x * d.x + d.z * d.z;
    const F l = sqrt(h2 + d.y * d.y);
    // Quadrant k from the signs, and the azimuth from its first meridian in [0, 2] eighths of a turn.
    const auto behind = d.z < 0.0, left = d.x < 0.0;
    const F k = select(left, select(behind, F(2.0), F(3.0)), select(behind, F(1.0), F(0.0)));
    const F from_z = select(left, select(behind, F(1.0), F(0.0)), select(behind, F(0.0), F(1.0)));
    const auto turned = from_z <= 0.0;  // in quadrants 1 and 3 azimuth counts from the x axis
    const F azimuth = 8.0 * atan2_turns(select(turned, az, ax), select(turned, ax, az));

    // a = (jr + w)/2 and b = (jr - w)/2 with w = X - middle of the quadrant: the belt's and the northern faces' (u, v)
    // but for whole numbers.
    const F jr = 2.0 - 1.5 * (d.y / l);
    const F w = azimuth - 1.0;
    const F n = sqrt(3.0 * (h2 / (l * (l + ay))));  // sqrt(3 (1 - |z|))
    const F a_cap = 0.5 * n * azimuth, b_cap = 0.5 * n * (2.0 - azimuth);
    const auto cap = n < 1.0, southern = d.y < 0.0;
    const F a = select(cap, select(southern, 2.0 - b_cap, a_cap), 0.5 * (jr + w));
    const F b = select(cap, select(southern, 2.0 - a_cap, b_cap), 0.5 * (jr - w));
    // Over the line a = 1 lies the next face to the lower right, over b = 1 the next to the lower left.
    const F over_a = select(a >= 1.0, F(1.0), F(0.0)), over_b = select(b >= 1.0, F(1.0), F(0.0));
    u = a - over_a;
    v = b - over_b;
    const F east = select(over_a > over_b, F(1.0), F(0.0));
    const F column = select(k + east >= 4.0, F(0.0), k + east);
    face = 4.0 * (over_a + over_b) + column;
  }
};

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
ENVCONV_EXPORT_LAYOUT(healpix)
