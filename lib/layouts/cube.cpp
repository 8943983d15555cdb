// SPDX-License-Identifier: Apache-2.0
// The cube map, the equi-angular cube, and OpenEXR's own cube.
//
//            +----+                Each face as seen from the centre; s to the right, t downwards,
//            | +Y |                both in [-1, 1].
//       +----+----+----+----+
//       | -X | +Z | +X | -Z |
//       +----+----+----+----+
//            | -Y |
//            +----+
//
// Source: OpenGL 4.6 core specification, table 8.19; Vulkan 1.3, "Cube Map Face Selection".
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "layouts/cube.cpp"
#include "layout_kernel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace envconv::HWY_NAMESPACE {

// (Not unit) direction of (s, t) on a face.
template <class F>
void cube_direction(int face, F s, F t, Vec<F>& d) {
  const F one = 1.0;
  switch (face) {
    case 0: d = {one, -t, -s}; break;
    case 1: d = {-one, -t, s}; break;
    case 2: d = {s, one, t}; break;
    case 3: d = {s, -one, -t}; break;
    case 4: d = {s, -t, one}; break;
    default: d = {-s, -t, -one}; break;
  }
}

// Face of d and its (s, t).  On ties z wins over y, and y over x, as Vulkan recommends.
template <class F>
void cube_locate(const Vec<F>& d, F& face, F& s, F& t) {
  const F ax = abs(d.x), ay = abs(d.y), az = abs(d.z);
  const auto z_major = az >= max(ax, ay);
  const auto y_major = ay >= ax;
  const F major = max(max(ax, ay), az);
  const F x_face = select(d.x < 0.0, F(1.0), F(0.0));
  const F y_face = select(d.y < 0.0, F(3.0), F(2.0));
  const F z_face = select(d.z < 0.0, F(5.0), F(4.0));
  face = select(z_major, z_face, select(y_major, y_face, x_face));
  const F sc = select(z_major, select(d.z < 0.0, -d.x, d.x), select(y_major, d.x, select(d.x < 0.0, d.z, -d.z)));
  const F tc = select(z_major, -d.y, select(y_major, select(d.y < 0.0, -d.z, d.z), -d.y));
  s = sc / major;
  t = tc / major;
}

inline constexpr Face cube_faces[] = {{"px"}, {"nx"}, {"py"}, {"ny"}, {"pz"}, {"nz"}};
inline constexpr int cube_rows[] = {6};

struct cube {
  static LayoutInfo info() {
    return {.title = "Cube map",
            .source = "OpenGL 4.6 core, table 8.19; Greene 1986",
            .notes =
                "Six perspective views of 90 degrees, in the order and orientation of OpenGL, Vulkan, Direct3D and "
                "WebGPU. Texels at the corners span a fifth of the solid angle of those at the centres.",
            .faces = cube_faces,
            .congruent = true,
            .rows = cube_rows};
  }
  template <class F>
  static void direction(int face, F u, F v, Vec<F>& d) {
    cube_direction(face, 2.0 * u - 1.0, 2.0 * v - 1.0, d);
    d = normalized(d);
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    F s, t;
    cube_locate(d, face, s, t);
    u = 0.5 + 0.5 * s;
    v = 0.5 + 0.5 * t;
  }
};

// q = (4/pi) atan p on each axis: equal steps of q are equal angles.
struct equi_angular_cube {
  static LayoutInfo info() {
    return {
        .title = "Equi-angular cube",
        .source = "Brown, Bringing pixels front and center in VR video, Google 2017",
        .notes = "The cube's faces with texels spaced by equal angles. Texels' solid angles differ by 1.41 at most.",
        .faces = cube_faces,
        .congruent = true,
        .rows = cube_rows};
  }
  template <class F>
  static F tan_axis(F q) {
    // tan(q pi/4); an apron stops short of the pole at q = 2.
    const F turns = min(max(q * 0.125, -0.24), 0.24);
    F s, c;
    sincos_turns(turns, s, c);
    return s / c;
  }
  template <class F>
  static void direction(int face, F u, F v, Vec<F>& d) {
    cube_direction(face, tan_axis(2.0 * u - 1.0), tan_axis(2.0 * v - 1.0), d);
    d = normalized(d);
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    F s, t;
    cube_locate(d, face, s, t);
    u = 0.5 + 4.0 * atan2_turns(s, F(1.0));
    v = 0.5 + 4.0 * atan2_turns(t, F(1.0));
  }
};

// ImfEnvmap.h: the axes are (-right, up, -forward) of ours, with the slots of +Z and -Z exchanged, and texel centres
// lie on the edges.
struct openexr_cube {
  static LayoutInfo info() {
    static constexpr int column[] = {1, 1, 1, 1, 1, 1};
    return {.title = "OpenEXR's cube (envmap attribute)",
            .source = "OpenEXR, ImfEnvmap.h",
            .notes =
                "A column of six faces named by the axes of OpenEXR, +X left, +Y up, +Z forward, each "
                "un-mirrored from inside, with texel centres on the faces' edges. Written to an EXR file it "
                "carries OpenEXR's envmap attribute.",
            .faces = cube_faces,
            .congruent = true,
            .placement = Placement::inclusive,
            .rows = column};
  }
  template <class F>
  static void direction(int face, F u, F v, Vec<F>& d) {
    Vec<F> e;
    cube::direction(face < 4 ? face : 9 - face, u, v, e);
    d = {-e.x, e.y, -e.z};
  }
  template <class F>
  static void locate(const Vec<F>& d, F& face, F& u, F& v) {
    cube::locate({-d.x, d.y, -d.z}, face, u, v);
    face = select(face >= 4.0, 9.0 - face, face);
  }
};

}  // namespace envconv::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
ENVCONV_EXPORT_LAYOUT(cube)
ENVCONV_EXPORT_LAYOUT(equi_angular_cube)
ENVCONV_EXPORT_LAYOUT(openexr_cube)
