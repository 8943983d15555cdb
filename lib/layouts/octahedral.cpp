// SPDX-License-Identifier: Apache-2.0
// Octahedral maps.  Centre +Z, the four corners are -Z; the back folds outwards over the diagonals.
//
//      -Z---+Y---(-Z)     a = 2u-1 right, b = 1-2v up.
//      |  /    \  |       Front: |a|+|b| <= 1.
//     -X   +Z   +X        Beyond an edge the map goes on at the point reflected in the edge's middle.
//      |  \    /  |
//      -Z---(-Y)--(-Z)
//
// Source: Praun & Hoppe 2003; Engelhardt & Dachsbacher, Octahedron Environment Maps, VMV 2008, section 3.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "layouts/octahedral.cpp"
#include "layout_kernel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {

inline constexpr Face octahedral_faces[] = {{"octahedral"}};
inline constexpr int octahedral_rows[] = {1};

// Centred point of (u, v); beyond the left and right edges the square is stored upside down, beyond top and bottom
// mirrored: half a turn about the edge's middle.
template <class F>
void octahedral_point(F u, F v, F& a, F& b) {
  a = named(2.0 * u - 1.0, "a");
  b = named(1.0 - 2.0 * v, "b");
  const auto beyond_a = abs(a) > 1.0;
  b = select(beyond_a, -b, b);
  a = select(beyond_a, copysign(F(2.0), a) - a, a);
  const auto beyond_b = abs(b) > 1.0;
  a = select(beyond_b, -a, a);
  b = select(beyond_b, copysign(F(2.0), b) - b, b);
}

struct octahedral {
  static LayoutInfo info() {
    return {.title = "Octahedral map",
            .source = "Praun & Hoppe 2003; Engelhardt & Dachsbacher, VMV 2008, sec. 3",
            .notes =
                "One square: the front half is the inscribed diamond, centre +Z; the back folds over the diagonals "
                "into the corners, all four of which are -Z.",
            .faces = octahedral_faces,
            .rows = octahedral_rows};
  }
  // On the octahedron |x| + |y| + |z| = 1.
  template <class F>
  static Vec<F> point(F u, F v) {
    F a, b;
    octahedral_point(u, v, a, b);
    const F z = named(1.0 - abs(a) - abs(b), "z");
    const F fold = named(max(-z, 0.0), "fold");  // how far behind the equator
    return {a - copysign(fold, a), b - copysign(fold, b), z};
  }
  template <class F>
  static void direction(int /*face*/, F u, F v, Vec<F>& d) {
    d = normalized(point(u, v));
  }
  // A plane's: its distance times its area over that seen along the axis is 1, whatever the octant, and da db is
  // 4 du dv.
  static double density(int /*face*/, double u, double v) {
    const Vec3 d = point(u, v);
    const double squared = d.x * d.x + d.y * d.y + d.z * d.z;
    return 4 / (squared * sqrt(squared));
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    const F l = abs(d.x) + abs(d.y) + abs(d.z);
    const F p = d.x / l, q = d.y / l;
    const auto back = d.z < 0.0;
    const F a = select(back, copysign(1.0 - abs(q), p), p);
    const F b = select(back, copysign(1.0 - abs(p), q), q);
    face = 0.0;
    u = 0.5 + 0.5 * a;
    v = 0.5 - 0.5 * b;
  }
};

// Equal area: Clarberg's concentric mapping under the same folding.  Each of the eight triangles holds one octant; a
// ring |a|+|b| = r about the centre is the circle z = 1 - r^2, so that areas agree (2 pi r^2 on the sphere, 2 r^2 in
// the square), and steps along it are equal angles.  Behind, r counts from the corners. Source: Clarberg, Fast
// Equal-Area Mapping of the (Hemi)Sphere using SIMD, Journal of Graphics Tools 13(3), 2008; Pharr, Jakob & Humphreys,
// PBRT 4th edition, section 3.8.3 (EqualAreaSquareToSphere).
struct octahedral_equal_area {
  static LayoutInfo info() {
    return {.title = "Equal-area octahedral map",
            .source = "Clarberg 2008; PBRT 4th edition, sec. 3.8.3",
            .notes =
                "The octahedral map's folding (centre +Z, all four corners -Z) with texels of equal solid angle: the "
                "square of pbrt-v4's image lights. pbrt's axes are those of the caller, its v grows upwards.",
            .faces = octahedral_faces,
            .equal_area = true,
            .rows = octahedral_rows,
            .max_error = 0.0025};
  }
  template <class F>
  static void direction(int /*face*/, F u, F v, Vec<F>& d) {
    F a, b;
    octahedral_point(u, v, a, b);
    // Ring r about the centre, or behind about the corners; phi from 0 (a axis) to a quarter turn (b axis).
    const F sum = named(abs(a) + abs(b), "sum");
    const F r = named(max(0.0, min(sum, 2.0 - sum)), "r");
    const F along = min(max((abs(b) - abs(a)) / max(r, 1e-30), -1.0), 1.0);
    F sin_phi, cos_phi;
    sincos_turns(0.125 + 0.125 * along, sin_phi, cos_phi);
    const F r2 = r * r;
    const F h = r * sqrt(2.0 - r2);  // sqrt(1 - z^2), without the cancellation at the poles
    d = {h * copysign(cos_phi, a), h * copysign(sin_phi, b), copysign(1.0 - r2, 1.0 - sum)};
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    const F h2 = d.x * d.x + d.y * d.y;
    const F l = sqrt(h2 + d.z * d.z);
    // r^2 = 1 - |z|/l = h^2 / (l (l + |z|)): no cancellation at the poles.
    const F r = sqrt(h2 / (l * (l + abs(d.z))));
    const F q = r * (4.0 * atan2_turns(abs(d.y), abs(d.x)));  // phi as a fraction of a quarter turn
    const F p = r - q;
    const auto back = d.z < 0.0;
    const F a = copysign(select(back, 1.0 - q, p), d.x);
    const F b = copysign(select(back, 1.0 - p, q), d.y);
    face = 0.0;
    u = 0.5 + 0.5 * a;
    v = 0.5 - 0.5 * b;
  }
};

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
ENVCONV_EXPORT_LAYOUT(octahedral)
ENVCONV_EXPORT_LAYOUT(octahedral_equal_area)
