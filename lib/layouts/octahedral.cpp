// SPDX-License-Identifier: Apache-2.0
// Octahedral map.  Centre +Z, the four corners are -Z; the back folds outwards over the diagonals.
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

struct octahedral {
  static LayoutInfo info() {
    static constexpr Face faces[] = {{"octahedral"}};
    static constexpr int rows[] = {1};
    return {.title = "Octahedral map",
            .source = "Praun & Hoppe 2003; Engelhardt & Dachsbacher, VMV 2008, sec. 3",
            .notes =
                "One square: the front half is the inscribed diamond, centre +Z; the back folds over the diagonals "
                "into the corners, all four of which are -Z.",
            .faces = faces,
            .rows = rows};
  }
  template <class F>
  static void direction(int /*face*/, F u, F v, Vec<F>& d) {
    F a = named(2.0 * u - 1.0, "a"), b = named(1.0 - 2.0 * v, "b");
    // Beyond the left and right edges the square is stored upside down, beyond top and bottom mirrored.
    const auto beyond_a = abs(a) > 1.0;
    b = select(beyond_a, -b, b);
    a = select(beyond_a, copysign(F(2.0), a) - a, a);
    const auto beyond_b = abs(b) > 1.0;
    a = select(beyond_b, -a, a);
    b = select(beyond_b, copysign(F(2.0), b) - b, b);
    const F z = named(1.0 - abs(a) - abs(b), "z");
    const F fold = named(max(-z, 0.0), "fold");  // how far behind the equator
    d = normalized(Vec<F>{a - copysign(fold, a), b - copysign(fold, b), z});
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

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
ENVCONV_EXPORT_LAYOUT(octahedral)
