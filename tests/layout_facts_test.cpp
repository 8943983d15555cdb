// SPDX-License-Identifier: Apache-2.0
// Published facts about layouts.  Every expected value comes from a source outside this program, named beside it: a
// specification's table, a paper's equation, or another program's formula, written down anew here.  (The laws that all
// layouts obey are in layout_laws_test.cpp.)
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "geometry.h"
#include "layout.h"

namespace envconv {
namespace {

constexpr double pi = std::numbers::pi;
constexpr double half_root = std::numbers::sqrt2 / 2;  // sqrt(1/2)
constexpr double tight = 1e-12;

const Layout& layout(std::string_view name) {
  const Layout* found = find_layout(name);
  if (found == nullptr) throw std::runtime_error("no layout " + std::string(name));
  return *found;
}

/// Directions spread over the sphere, the same in every run.
std::vector<Vec3> random_directions(int n) {
  std::mt19937_64 random(20240607);
  std::normal_distribution<double> normal;
  std::vector<Vec3> all;
  for (int i = 0; i < n; ++i) {
    const double x = normal(random), y = normal(random), z = normal(random);
    all.push_back(normalize({x, y, z}));
  }
  return all;
}

/// Points of the unit square.
std::vector<std::pair<double, double>> random_points(int n) {
  std::mt19937_64 random(20240608);
  std::uniform_real_distribution<double> uniform;
  std::vector<std::pair<double, double>> all;
  for (int i = 0; i < n; ++i) {
    const double u = uniform(random), v = uniform(random);
    all.emplace_back(u, v);
  }
  return all;
}

std::string text(Vec3 d) {
  std::ostringstream out;
  out << "(" << d.x << ", " << d.y << ", " << d.z << ")";
  return out.str();
}

void expect_direction(const Layout& map, int face, double u, double v, Vec3 expected, double tolerance = tight) {
  const Vec3 d = map.direction(face, u, v);
  EXPECT_NEAR(angle_between(d, expected), 0, tolerance)
      << map.name() << " face " << face << " at " << u << ", " << v << ": " << text(d) << ", not " << text(expected);
}

/// The direction is found at the face point, and the face point looks along the direction.
void expect_at(const Layout& map, Vec3 d, int face, double u, double v, double tolerance = tight) {
  const Location at = map.locate(d);
  EXPECT_EQ(at.face, face) << map.name() << " " << text(d);
  EXPECT_NEAR(at.u, u, tolerance) << map.name() << " " << text(d);
  EXPECT_NEAR(at.v, v, tolerance) << map.name() << " " << text(d);
  expect_direction(map, face, u, v, normalize(d), tolerance * 8);
}

/// Solid angle of a face point: steradians per unit of u and v.
double solid_angle(const Layout& map, int face, double u, double v) {
  const DirectionJet jet = map.direction_jet(face, u, v);
  return length(cross(jet.du, jet.dv));
}

// --- the cube family ------------------------------------------------------------------------------------------------

// OpenGL 4.6 core profile, table 8.19: sc, tc and ma of each face as (axis, sign); s = (sc/|ma| + 1)/2, t = (tc/|ma| +
// 1)/2.
struct Axis {
  double Vec3::*component;
  double sign;
  double of(Vec3 d) const { return sign * d.*component; }
};
struct CubeFace {
  Axis sc, tc, ma;
};
const CubeFace gl_table[] = {
    {{&Vec3::z, -1}, {&Vec3::y, -1}, {&Vec3::x, +1}}, {{&Vec3::z, +1}, {&Vec3::y, -1}, {&Vec3::x, -1}},
    {{&Vec3::x, +1}, {&Vec3::z, +1}, {&Vec3::y, +1}}, {{&Vec3::x, +1}, {&Vec3::z, -1}, {&Vec3::y, -1}},
    {{&Vec3::x, +1}, {&Vec3::y, -1}, {&Vec3::z, +1}}, {{&Vec3::x, -1}, {&Vec3::y, -1}, {&Vec3::z, -1}},
};
// What texCUBE does with a vector: the face whose major axis is the largest.
Location gl_cube_lookup(Vec3 q) {
  int face = 0;
  for (int f = 1; f < 6; ++f)
    if (gl_table[f].ma.of(q) > gl_table[face].ma.of(q)) face = f;
  const double ma = gl_table[face].ma.of(q);
  return {face, (gl_table[face].sc.of(q) / ma + 1) / 2, (gl_table[face].tc.of(q) / ma + 1) / 2};
}

TEST(Cube, IsTheTableOfOpenGL) {
  for (const Vec3 d : random_directions(5000)) {
    const Location gl = gl_cube_lookup(d);
    expect_at(layout("cube"), d, gl.face, gl.u, gl.v);
  }
}

// Brown, "Bringing pixels front and center in VR video" (Google, 2017): q = (4/pi) atan p, both in [-1, 1].
TEST(EquiAngularCube, StepsAreEqualAngles) {
  const Layout& map = layout("equi-angular-cube");
  for (int i = 0; i <= 8; ++i) {
    const double angle = (i - 4) * pi / 16;  // -45 degrees to 45 in steps of 11.25
    expect_direction(map, 4, i / 8.0, 0.5, {std::sin(angle), 0, std::cos(angle)});
    expect_direction(map, 0, 0.5, i / 8.0, {std::cos(angle), -std::sin(angle), 0});
  }
  for (const Vec3 d : random_directions(2000)) {
    const Location gl = gl_cube_lookup(d);
    expect_at(map, d, gl.face, 0.5 + 2 / pi * std::atan(2 * gl.u - 1), 0.5 + 2 / pi * std::atan(2 * gl.v - 1));
  }
}

// ImfEnvmap.cpp and the output of exrenvmap 3.1.5: for each face what a column's step and a row's step add, and the
// top left corner, in OpenEXR's axes (right-handed; x is our -x).  Texel centres lie on the edges.
TEST(OpenExrCube, CornersAreThoseOfExrenvmap) {
  const struct {
    Vec3 column, row, corner;
  } faces[] = {{{0, 0, 1}, {0, -1, 0}, {1, 1, -1}}, {{0, 0, -1}, {0, -1, 0}, {-1, 1, 1}},
               {{1, 0, 0}, {0, 0, -1}, {-1, 1, 1}}, {{1, 0, 0}, {0, 0, 1}, {-1, -1, -1}},
               {{-1, 0, 0}, {0, -1, 0}, {1, 1, 1}}, {{1, 0, 0}, {0, -1, 0}, {-1, 1, -1}}};
  const Layout& map = layout("openexr-cube");
  EXPECT_EQ(map.info().placement, Placement::inclusive);
  constexpr int n = 5;
  for (int f = 0; f < 6; ++f)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        const Vec3 exr = faces[f].corner + (2.0 * i / (n - 1)) * faces[f].column + (2.0 * j / (n - 1)) * faces[f].row;
        expect_direction(map, f, u_from_texel(i, n, map.info().placement), u_from_texel(j, n, map.info().placement),
                         {-exr.x, exr.y, exr.z});
      }
}

// --- isocube --------------------------------------------------------------------------------------------------------

// Wan, Wong & Leung, appendix C, line by line, with the upper four columns of table I as signTBL.  step(a, x) of Cg is
// x >= a.  The table's quadrants are the shader's: quar = 0 is [-pi/4, pi/4) (erratum).
Vec3 isocube_shader(Vec3 r) {
  constexpr double sign_table[4][4] = {{1, 0, 0, 2}, {2, -2, 1, 0}, {-1, 0, 4, -2}, {-6, 2, -1, 0}};  // a11 a12 a31 a32
  const auto step = [](double a, double x) { return x >= a ? 1.0 : 0.0; };
  const auto lerp = [](double a, double b, double t) { return t > 0 ? b : a; };  // t is 0 or 1: no 0 times infinity
  double phi = 2 * std::atan2(r.z, r.x) / pi;
  phi += step(phi, -0.5) * 4;
  const double y = r.y * 1.5;
  const double ya = std::abs(y);
  const double bequ = step(ya, 1.0);
  const double ix = lerp(std::sqrt(std::max(3 - 2 * ya, 0.0)), 1, bequ);
  const double iy = phi * ix;
  const double* coef = sign_table[static_cast<int>(std::floor(phi + 0.5))];
  return {coef[0] * ix + coef[1] * iy, lerp(y < 0 ? -1 : 1, y, bequ), coef[2] * ix + coef[3] * iy};
}

TEST(Isocube, IsTheShaderOfAppendixC) {
  for (const Vec3 d : random_directions(20000)) {
    const Location at = gl_cube_lookup(isocube_shader(d));
    // The shader's own 1 - |y| cancels near the poles.
    expect_at(layout("isocube"), d, at.face, at.u, at.v, 1e-10);
  }
}

// Equations 1 and 2 (equatorial zone) and 3 and 4 (polar zones, N even), with the paper's z = our y and its azimuth
// from +X towards +Z.
TEST(Isocube, CurvesOfThePaper) {
  const Layout& map = layout("isocube");
  constexpr int n = 8;
  for (int k = 0; k <= n; ++k)
    for (int l = 0; l <= n; ++l) {
      const double phi = pi / 2 * (double(k) / n - 0.5), z = 2.0 / 3 * (2.0 * l / n - 1), h = std::sqrt(1 - z * z);
      // Seen from inside, azimuth grows from right to left.
      expect_direction(map, 0, 1 - double(k) / n, 1 - double(l) / n, {h * std::cos(phi), z, h * std::sin(phi)});
    }
  for (int l = 1; l <= n / 2; ++l)
    for (int k = 0; k <= l; ++k) {
      const double z = 1 - (2.0 * l / n) * (2.0 * l / n) / 3, h = std::sqrt(1 - z * z);
      const double phi = pi / 2 * (2.0 * k / (2.0 * n)) / std::sqrt(3 * (1 - z));
      expect_direction(map, 2, 0.5 + double(l) / n, 0.5 + double(k) / n, {h * std::cos(phi), z, h * std::sin(phi)});
    }
}

// Appendix A: all texels of an N x N face span 4 pi / 6 N^2.
TEST(Isocube, TexelsSpanEqualSolidAngles) {
  for (int face = 0; face < 6; ++face)
    for (const auto& [u, v] : random_points(2000))
      EXPECT_NEAR(solid_angle(layout("isocube"), face, u, v), 4 * pi / 6, tight) << face << " " << u << " " << v;
}

// Section III.A: the zones meet at |z| = 2/3.
TEST(Isocube, ZonesMeetAtTwoThirds) {
  const Layout& map = layout("isocube");
  const double h = std::sqrt(5.0) / 3;  // sqrt(1 - 4/9)
  expect_direction(map, 4, 0.5, 0, {0, 2.0 / 3, h});
  expect_direction(map, 2, 0.5, 1, {0, 2.0 / 3, h});
  expect_direction(map, 3, 0.5, 0, {0, -2.0 / 3, h});
  expect_direction(map, 2, 1, 1, {h * half_root, 2.0 / 3, h * half_root});
  EXPECT_EQ(map.locate({0, 0.66, std::sqrt(1 - 0.66 * 0.66)}).face, 4);
  EXPECT_EQ(map.locate({0, 0.67, std::sqrt(1 - 0.67 * 0.67)}).face, 2);
  // Erratum: at this azimuth, -pi/4 exactly, the shader's quadrant is 4, beyond its table.
  EXPECT_EQ(std::floor(2 * std::atan2(-1.0, 1.0) / pi + 4 + 0.5), 4);
  expect_direction(map, map.locate({1, 0, -1}).face, map.locate({1, 0, -1}).u, 0.5, {1, 0, -1});
}

// --- lat-long -------------------------------------------------------------------------------------------------------

// Blinn & Newell 1976; the orientation is that of ffmpeg's v360 (equirectangular).
TEST(LatLong, KnownPoints) {
  const Layout& map = layout("latlong");
  expect_at(map, {0, 0, 1}, 0, 0.5, 0.5);
  expect_at(map, {1, 0, 0}, 0, 0.75, 0.5);
  expect_at(map, {-1, 0, 0}, 0, 0.25, 0.5);
  expect_at(map, {1, 0, 1}, 0, 0.625, 0.5);
  expect_at(map, {0, 1, 1}, 0, 0.5, 0.25);
  expect_at(map, {0, -1, 1}, 0, 0.5, 0.75);
  EXPECT_EQ(map.locate({0, 1, 0}).v, 0);
  EXPECT_EQ(map.locate({0, -1, 0}).v, 1);
  for (const double u : {0.0, 0.3, 0.9}) {
    expect_direction(map, 0, u, 0, {0, 1, 0});
    expect_direction(map, 0, u, 1, {0, -1, 0});
  }
  expect_direction(map, 0, 0, 0.5, {0, 0, -1});
  expect_direction(map, 0, 1, 0.5, {0, 0, -1});
}

// ImfEnvmap.cpp, LatLongMap::latLong and direction, for a data window of w x h pixels that begins at (0, 0).
TEST(LatLongInclusive, IsImfEnvmap) {
  const Layout& map = layout("latlong-inclusive");
  EXPECT_EQ(map.info().placement, Placement::inclusive);
  constexpr int w = 9, h = 5;
  for (int j = 0; j < h; ++j)
    for (int i = 0; i < w; ++i) {
      const double latitude = -pi * (double(j) / (h - 1) - 0.5);
      const double longitude = -2 * pi * (double(i) / (w - 1) - 0.5);
      const Vec3 exr{std::sin(longitude) * std::cos(latitude), std::sin(latitude),
                     std::cos(longitude) * std::cos(latitude)};
      expect_direction(map, 0, u_from_texel(i, w, map.info().placement), u_from_texel(j, h, map.info().placement),
                       {-exr.x, exr.y, exr.z});
    }
}

// --- frames: nine programs' own readings of one panorama
// --------------------------------------------------------------

// Each reads the picture at its own (u, v); v from the top.  A frame is right when the program finds world direction d,
// written in its own axes, where our lat-long map has it.
TEST(Frames, EachProgramReadsTheSamePanorama) {
  const auto fraction = [](double x) { return x - std::floor(x); };
  const struct {
    const char *frame, *source;
    std::function<double(Vec3)> u, v;
  } readings[] = {
      {"world", "ffmpeg v360, cmft: 1/2 + atan2(x, z)/2pi",  //
       [](Vec3 d) { return 0.5 + std::atan2(d.x, d.z) / (2 * pi); }, [](Vec3 d) { return std::acos(d.y) / pi; }},
      {"opengl", "Debevec, HighResProbes: u = (1 + atan2(Dx, -Dz)/pi)/2, v = acos(Dy)/pi",
       [](Vec3 d) { return (1 + std::atan2(d.x, -d.z) / pi) / 2; }, [](Vec3 d) { return std::acos(d.y) / pi; }},
      {"openexr", "ImfEnvmap.cpp: longitude/-2pi + 1/2, latitude/-pi + 1/2",
       [](Vec3 d) { return std::atan2(d.x, d.z) / (-2 * pi) + 0.5; },
       [](Vec3 d) { return std::atan2(d.y, std::hypot(d.x, d.z)) / -pi + 0.5; }},
      {"openexr", "Godot 4, sky.glsl: fract(atan(x, -z)/2pi)",
       [=](Vec3 d) { return fraction(std::atan2(d.x, -d.z) / (2 * pi)); }, [](Vec3 d) { return std::acos(d.y) / pi; }},
      {"three", "three.js, equirectUv in common.glsl; its v is upwards",
       [](Vec3 d) { return std::atan2(d.z, d.x) / (2 * pi) + 0.5; },
       [](Vec3 d) { return 1 - (std::asin(d.y) / pi + 0.5); }},
      {"blender", "Cycles, direction_to_equirectangular in projection.h; its v is upwards",
       [](Vec3 d) { return (std::atan2(d.y, d.x) - pi) / (-2 * pi); },
       [](Vec3 d) { return 1 - (std::acos(d.z) - pi) / -pi; }},
      {"unity", "Skybox/Panoramic, ToRadialCoords; its v is upwards",
       [](Vec3 d) { return 0.5 - std::atan2(d.z, d.x) * 0.5 / pi; },
       [](Vec3 d) { return 1 - (1 - std::acos(d.y) / pi); }},
      {"unreal", "TextureCompressorModule.cpp, LookupLongLat after its swap of y and z",
       [](Vec3 d) { return (1 + std::atan2(d.x, -d.y) / pi) / 2; }, [](Vec3 d) { return std::acos(d.z) / pi; }},
      {"renderman", "OpenImageIO, vector_to_latlong with updir z",
       [](Vec3 d) { return std::atan2(d.y, d.x) / (2 * pi) + 0.5; },
       [](Vec3 d) { return 0.5 - std::atan2(d.z, std::hypot(d.x, d.y)) / pi; }},
  };
  for (const auto& reading : readings) {
    const Frame* frame = find_frame(reading.frame);
    ASSERT_NE(frame, nullptr) << reading.frame;
    for (const Vec3 world : random_directions(500)) {
      const Vec3 d = frame->consumer_from_world * world;
      const Location at = layout("latlong").locate(world);
      EXPECT_NEAR(reading.u(d), at.u, 1e-9) << reading.source;
      EXPECT_NEAR(reading.v(d), at.v, 1e-9) << reading.source;
    }
  }
}

// Handedness and up axis of each program, from its own manual.
TEST(Frames, HandAndUp) {
  const struct {
    const char* frame;
    bool right_handed;
    Vec3 up, centre;
  } facts[] = {{"world", false, {0, 1, 0}, {0, 0, 1}},   {"opengl", true, {0, 1, 0}, {0, 0, -1}},
               {"openexr", true, {0, 1, 0}, {0, 0, 1}},  {"three", true, {0, 1, 0}, {1, 0, 0}},
               {"blender", true, {0, 0, 1}, {1, 0, 0}},  {"unity", false, {0, 1, 0}, {1, 0, 0}},
               {"unreal", false, {0, 0, 1}, {0, -1, 0}}, {"renderman", false, {0, 0, 1}, {1, 0, 0}}};
  EXPECT_EQ(all_frames().size(), std::size(facts));
  EXPECT_EQ(all_frames().front().name, "world");
  for (const auto& fact : facts) {
    const Frame* frame = find_frame(fact.frame);
    ASSERT_NE(frame, nullptr) << fact.frame;
    const Mat3& m = frame->consumer_from_world;
    const Vec3 right = m * Vec3{1, 0, 0}, up = m * Vec3{0, 1, 0}, forward = m * Vec3{0, 0, 1};
    // Right, up, forward is a left-handed triple: its determinant is -1 in right-handed axes.
    EXPECT_EQ(dot(cross(right, up), forward), fact.right_handed ? -1 : 1) << fact.frame;
    EXPECT_EQ(length(up - fact.up), 0) << fact.frame;
    EXPECT_EQ(length(forward - fact.centre), 0) << fact.frame;
  }
}

// --- discs of the whole sphere --------------------------------------------------------------------------------------

// OpenGL 2.1, section 2.11.4; SIGGRAPH 2001 notes, equations 8 and 9: s = Rx/2p + 1/2, t = Ry/2p + 1/2, t upwards.
TEST(SphereMap, ForwardEquationsOfOpenGL) {
  for (const Vec3 r : random_directions(5000)) {
    const double p = std::sqrt(r.x * r.x + r.y * r.y + (r.z + 1) * (r.z + 1));
    const double tolerance = 1e-14 / p;  // the rim is one direction: p is 0 there
    expect_at(layout("sphere-map"), r, 0, r.x / (2 * p) + 0.5, 1 - (r.y / (2 * p) + 0.5), std::max(tight, tolerance));
  }
}

TEST(SphereMap, CentreRimAndErratum) {
  const Layout& map = layout("sphere-map");
  expect_at(map, {0, 0, 1}, 0, 0.5, 0.5);
  // "For any point on the circle edge, the result is always (0, 0, -1)."  Cosines of rounded angles are off the rim by
  // 1e-16, which its infinite stretch makes 1e-8.
  for (int i = 0; i < 16; ++i) {
    const double angle = 2 * pi * i / 16;
    expect_direction(map, 0, 0.5 + 0.5 * std::cos(angle), 0.5 + 0.5 * std::sin(angle), {0, 0, -1}, 1e-7);
  }
  // The circle of 90 degrees has radius sqrt(1/2): p = sqrt(2) for Rz = 0.
  expect_at(map, {1, 0, 0}, 0, 0.5 + half_root / 2, 0.5);
  expect_at(map, {-1, 0, 0}, 0, 0.5 - half_root / 2, 0.5);
  expect_at(map, {0, 1, 0}, 0, 0.5, 0.5 - half_root / 2);
  expect_at(map, {0, -1, 0}, 0, 0.5, 0.5 + half_root / 2);

  // Erratum: the reverse mapping as the notes print it sends (3/4, 1/2), right of the centre, up instead of right.
  const double s = 0.75, t = 0.5, root = 2 * std::sqrt(-4 * s * s + 4 * s - 1 - 4 * t * t + 4 * t);
  const Vec3 printed{root * (2 * t - 1), root * (2 * s - 1), -8 * s * s + 8 * s - 8 * t * t + 8 * t - 3};
  const Vec3 exchanged{printed.y, printed.x, printed.z};
  expect_direction(map, 0, s, 1 - t, exchanged);
  EXPECT_EQ(printed.x, 0);
  EXPECT_GT(map.direction(0, s, 1 - t).x, 0.8);
}

// Lambert's azimuthal equal-area projection (1772): the disc's area pi/4 is the sphere's 4 pi everywhere.
TEST(SphereMap, EqualArea) {
  const Layout& map = layout("sphere-map");
  for (const auto& [u, v] : random_points(2000)) {
    if (std::hypot(u - 0.5, v - 0.5) > 0.499) continue;  // beyond the disc, or where its stretch grows without bound
    EXPECT_NEAR(solid_angle(map, 0, u, v), 16, 1e-9);
  }
}

// Blinn & Newell 1976; HDRShop's "mirrored sphere" (skylibs): k = sin(acos(-z)/2)/(2 sqrt(x^2 + y^2)) about the line of
// sight -Z in right-handed axes; the ball's centre shows the camera, +Z.
TEST(MirrorBall, CentreShowsTheCamera) {
  const Layout& map = layout("mirror-ball");
  const Frame* frame = find_frame(map.info().frame);
  ASSERT_NE(frame, nullptr);
  const auto seen_at = [&](Vec3 world) { return map.locate(frame->consumer_from_world * world); };
  const Location behind = seen_at({0, 0, -1});  // world: forward is +Z, the camera looks along it
  EXPECT_NEAR(behind.u, 0.5, tight);
  EXPECT_NEAR(behind.v, 0.5, tight);
  const Location ahead = seen_at({0, 0, 1});
  EXPECT_NEAR(std::hypot(ahead.u - 0.5, ahead.v - 0.5), 0.5, tight);
  // A ball mirrors what lies to the right of it on its right.
  EXPECT_NEAR(seen_at({1, 0, 0}).u, 0.5 + half_root / 2, tight);
  EXPECT_NEAR(seen_at({0, 1, 0}).v, 0.5 - half_root / 2, tight);
}

// Debevec, Light Probe Image Gallery: (u, v) = (Dx r, Dy r) in [-1, 1], r = (1/pi) acos(Dz) / sqrt(Dx^2 + Dy^2).
TEST(AngularMap, IsDebevecsFormula) {
  const Layout& map = layout("angular-map");
  for (const Vec3 d : random_directions(5000)) {
    const double r = std::acos(d.z) / pi / std::sqrt(d.x * d.x + d.y * d.y);
    expect_at(map, d, 0, 0.5 + d.x * r / 2, 0.5 - d.y * r / 2, 1e-10);
  }
  expect_at(map, {0, 0, 1}, 0, 0.5, 0.5);
  // 90 degrees from the centre is half the radius.
  expect_at(map, {1, 0, 0}, 0, 0.75, 0.5);
  expect_at(map, {-1, 0, 0}, 0, 0.25, 0.5);
  expect_at(map, {0, 1, 0}, 0, 0.5, 0.25);
  expect_at(map, {0, -1, 0}, 0, 0.5, 0.75);
  for (int i = 0; i < 16; ++i)
    expect_direction(map, 0, 0.5 + 0.5 * std::cos(pi * i / 8), 0.5 + 0.5 * std::sin(pi * i / 8), {0, 0, -1});
  const Location back = map.locate({0, 0, -1});
  EXPECT_NEAR(std::hypot(back.u - 0.5, back.v - 0.5), 0.5, tight);
}

// --- octahedral maps ------------------------------------------------------------------------------------------------

// Praun & Hoppe 2003: a square's centre, edges' middles and corners are the octahedron's vertices.
void expect_octahedron_vertices(const Layout& map) {
  expect_at(map, {0, 0, 1}, 0, 0.5, 0.5);
  expect_at(map, {1, 0, 0}, 0, 1, 0.5);
  expect_at(map, {-1, 0, 0}, 0, 0, 0.5);
  expect_at(map, {0, 1, 0}, 0, 0.5, 0);
  expect_at(map, {0, -1, 0}, 0, 0.5, 1);
  for (const double u : {0.0, 1.0})
    for (const double v : {0.0, 1.0}) expect_direction(map, 0, u, v, {0, 0, -1});
  // Edges' middles of the diamond are 45 degrees between vertices.
  expect_at(map, {1, 1, 0}, 0, 0.75, 0.25);
  expect_at(map, {-1, -1, 0}, 0, 0.25, 0.75);
}

// Cigolle et al., JCGT 3(2), 2014, listing 2 (float32x3_to_oct): p = v.xy/(|x|+|y|+|z|), folded for z <= 0.
TEST(Octahedral, IsFloat32x3ToOct) {
  const Layout& map = layout("octahedral");
  expect_octahedron_vertices(map);
  for (const Vec3 d : random_directions(5000)) {
    const double l = std::abs(d.x) + std::abs(d.y) + std::abs(d.z);
    const double p = d.x / l, q = d.y / l;
    const auto sign = [](double x) { return x >= 0 ? 1.0 : -1.0; };
    const double a = d.z <= 0 ? (1 - std::abs(q)) * sign(p) : p, b = d.z <= 0 ? (1 - std::abs(p)) * sign(q) : q;
    expect_at(map, d, 0, (a + 1) / 2, 1 - (b + 1) / 2);
  }
}

// pbrt-v4, util/math.cpp, EqualAreaSquareToSphere (Clarberg 2008), whose second coordinate is upwards.
Vec3 pbrt_square_to_sphere(double px, double py) {
  const double u = 2 * px - 1, v = 2 * py - 1, up = std::abs(u), vp = std::abs(v);
  const double signed_distance = 1 - (up + vp), distance = std::abs(signed_distance), r = 1 - distance;
  const double phi = (r == 0 ? 1 : (vp - up) / r + 1) * pi / 4;
  const double z = std::copysign(1 - r * r, signed_distance);
  const double cos_phi = std::copysign(std::cos(phi), u), sin_phi = std::copysign(std::sin(phi), v);
  return {cos_phi * r * std::sqrt(2 - r * r), sin_phi * r * std::sqrt(2 - r * r), z};
}

TEST(OctahedralEqualArea, IsPbrtsSquare) {
  const Layout& map = layout("octahedral-equal-area");
  expect_octahedron_vertices(map);
  for (const auto& [u, v] : random_points(5000)) expect_direction(map, 0, u, v, pbrt_square_to_sphere(u, 1 - v));
  for (const Vec3 d : random_directions(5000)) {
    const Location at = map.locate(d);
    EXPECT_NEAR(angle_between(pbrt_square_to_sphere(at.u, 1 - at.v), d), 0, 1e-12);
  }
  // Clarberg's claim: the square's area 1 is the sphere's 4 pi everywhere.
  for (const auto& [u, v] : random_points(5000)) EXPECT_NEAR(solid_angle(map, 0, u, v), 4 * pi, 1e-9);
}

// --- two and three faces --------------------------------------------------------------------------------------------

// Heidrich & Seidel 1998: a paraboloid's normal for reflected ray (x, y, z) is (x, y, z+1)/(z+1).
TEST(Paraboloid, KnownPointsAndConformal) {
  const Layout& map = layout("paraboloid");
  expect_at(map, {0, 0, 1}, 0, 0.5, 0.5);
  expect_at(map, {0, 0, -1}, 1, 0.5, 0.5);
  expect_direction(map, 0, 1, 0.5, {1, 0, 0});
  expect_direction(map, 0, 0.5, 0, {0, 1, 0});
  expect_direction(map, 1, 0, 0.5, {1, 0, 0});  // seen from inside, looking back, +X is on the left
  expect_direction(map, 1, 0.5, 0, {0, 1, 0});
  // Stereographic: the distance from the centre is the tangent of half the angle; tan 22.5 degrees = sqrt 2 - 1.
  expect_at(map, {1, 0, 1}, 0, 0.5 + (std::sqrt(2) - 1) / 2, 0.5);
  expect_at(map, {1, 0, -1}, 1, 0.5 - (std::sqrt(2) - 1) / 2, 0.5);
  // 3-4-5: (4/5, 0, 3/5) has x/(1+z) = 1/2.
  expect_at(map, {4, 0, 3}, 0, 0.75, 0.5);
  expect_at(map, {0, 4, -3}, 1, 0.5, 0.25);
  for (const Vec3 d : random_directions(2000)) {
    if (d.z >= 0)
      expect_at(map, d, 0, 0.5 + d.x / (1 + d.z) / 2, 0.5 - d.y / (1 + d.z) / 2);
    else
      expect_at(map, d, 1, 0.5 - d.x / (1 - d.z) / 2, 0.5 - d.y / (1 - d.z) / 2);
  }
  for (const auto& [u, v] : random_points(500)) {
    const DirectionJet jet = map.direction_jet(0, u, v);
    EXPECT_NEAR(length(jet.du), length(jet.dv), tight);
    EXPECT_NEAR(dot(jet.du, jet.dv), 0, tight);
  }
}

// Snyder & Mitchell 2001: azimuthal equidistant hemispheres.
TEST(DualEquidistant, DistanceIsAngle) {
  const Layout& map = layout("dual-equidistant");
  expect_at(map, {0, 0, 1}, 0, 0.5, 0.5);
  expect_at(map, {0, 0, -1}, 1, 0.5, 0.5);
  expect_at(map, {1, 0, 1}, 0, 0.75, 0.5);  // 45 degrees: half the radius
  expect_at(map, {0, 1, 1}, 0, 0.5, 0.25);
  expect_at(map, {1, 0, -1}, 1, 0.25, 0.5);
  expect_at(map, {0, 1, -1}, 1, 0.5, 0.25);
  expect_direction(map, 0, 1, 0.5, {1, 0, 0});
  expect_direction(map, 1, 1, 0.5, {-1, 0, 0});
  for (const Vec3 d : random_directions(2000)) {
    const Location at = map.locate(d);
    EXPECT_NEAR(std::hypot(2 * at.u - 1, 2 * at.v - 1), std::acos(std::abs(d.z)) / (pi / 2), 1e-9);
  }
}

// Herron, table 2 and section 2.1.
TEST(TennisBall, SeamOfSection2_1) {
  const Layout& map = layout("tennis-ball");
  const double e = 1e-9;
  const auto expect_seam = [&](Vec3 point, Vec3 into_c1, const char* what) {
    EXPECT_EQ(map.locate(point + e * into_c1).face, 0) << what << " " << text(point);
    EXPECT_EQ(map.locate(point - e * into_c1).face, 1) << what << " " << text(point);
  };
  for (const double p : {-1.0, 1.0}) {
    // Table 2.  C1 is centred on +Z, so y grows smaller into it; C2 is centred on -Z.
    expect_seam({0, p * half_root, half_root}, {0, -p, 0}, "table 2, +Z hemisphere");
    expect_seam({p * half_root, 0, -half_root}, {p, 0, 0}, "table 2, -Z hemisphere");
    for (const double q : {-1.0, 1.0}) {
      expect_seam({p * half_root, q * half_root, 0}, {p, -q, 0}, "table 2, XY equator");
      // The eight segments s(t) = (t, sqrt(1/2), sqrt(1/2 - t^2)), reflected, and turned by 90 degrees for -Z.
      for (int i = 1; i < 20; ++i) {
        const double t = half_root * i / 20, z = std::sqrt(0.5 - t * t);
        expect_seam({p * t, q * half_root, z}, {0, -q, 0}, "half plane y");
        expect_seam({q * half_root, p * t, -z}, {q, 0, 0}, "half plane x");
      }
    }
  }
}

TEST(TennisBall, EquationsOneAndThree) {
  const Layout& map = layout("tennis-ball");
  expect_at(map, {0, 0, 1}, 0, 0.5, 0.5);
  expect_at(map, {0, 0, -1}, 1, 0.5, 0.5);
  // C1 wraps around to +-X at phi = +-90 degrees of the +-135 that equation 2 allows; C2 to +-Y.
  expect_at(map, {1, 0, 0}, 0, 0.5 + 90.0 / 270, 0.5);
  expect_at(map, {-1, 0, 0}, 0, 0.5 - 90.0 / 270, 0.5);
  expect_at(map, {0, 1, 0}, 1, 0.5 + 90.0 / 270, 0.5);
  expect_at(map, {0, -1, 0}, 1, 0.5 - 90.0 / 270, 0.5);
  // The strips' ends and sides (figure 2): phi = 135 degrees, theta = 45 degrees.
  expect_direction(map, 0, 1, 0.5, {1, 0, -1});
  expect_direction(map, 0, 0.5, 0, {0, 1, 1});
  expect_direction(map, 1, 1, 0.5, {0, 1, 1});
  expect_direction(map, 1, 0.5, 0, {1, 0, -1});
  for (const Vec3 d : random_directions(5000)) {
    const Location at = map.locate(d);
    // Equation 1 from the (theta, phi) that the rectangle of equation 2 gives.
    const double phi = (at.u - 0.5) * 3 * pi / 2, theta = (0.5 - at.v) * pi / 2;
    const Vec3 c1{std::sin(phi) * std::cos(theta), std::sin(theta), std::cos(phi) * std::cos(theta)};
    const Vec3 c2{std::sin(theta), std::sin(phi) * std::cos(theta), -std::cos(phi) * std::cos(theta)};
    EXPECT_NEAR(angle_between(at.face == 0 ? c1 : c2, d), 0, tight);
    // The components are congruent: the map takes (x, y, -z) with x and y exchanged to the same place of the other.
    const Location other = map.locate({d.y, d.x, -d.z});
    EXPECT_EQ(other.face, 1 - at.face);
    EXPECT_NEAR(other.u, at.u, tight);
    EXPECT_NEAR(other.v, at.v, tight);
  }
  // Erratum: with equation 4, atan2(a, -c), the middle of C1 would lie at phi = pi, outside equation 2's rectangle.
  EXPECT_GT(std::atan2(0.0, -1.0), 3 * pi / 4);
}

// Snyder & Mitchell 2001: the lat-long band to 45 degrees and two equidistant discs.
TEST(PolarCapped, BandAndCaps) {
  const Layout& map = layout("polar-capped");
  expect_at(map, {0, 0, 1}, 0, 0.5, 0.5);
  expect_at(map, {1, 0, 0}, 0, 0.75, 0.5);
  const double half_angle = std::tan(pi / 8);
  expect_at(map, {0, half_angle, 1}, 0, 0.5, 0.25);  // latitude 22.5 degrees
  expect_direction(map, 0, 0.5, 0, {0, 1, 1});
  expect_direction(map, 0, 0.5, 1, {0, -1, 1});
  expect_at(map, {0, 1, 0}, 1, 0.5, 0.5);
  expect_at(map, {0, -1, 0}, 2, 0.5, 0.5);
  expect_at(map, {half_angle, 1, 0}, 1, 0.75, 0.5);  // 22.5 degrees from the pole: half the radius
  expect_at(map, {0, -1, half_angle}, 2, 0.5, 0.25);
  EXPECT_EQ(map.locate({0, 0.999, 1}).face, 0);
  EXPECT_EQ(map.locate({0, 1.001, 1}).face, 1);
  EXPECT_EQ(map.locate({0, -0.999, 1}).face, 0);
  EXPECT_EQ(map.locate({0, -1.001, 1}).face, 2);
}

// Caps lie as the cube's faces +Y and -Y do (OpenGL's table): top of the north one -Z, of the south one +Z.
void expect_caps_lie_as_cube_faces(const Layout& map) {
  const CubeFace& north = gl_table[2];
  const CubeFace& south = gl_table[3];
  for (int cap = 1; cap <= 2; ++cap) {
    const CubeFace& face = cap == 1 ? north : south;
    for (int i = 0; i < 16; ++i) {
      const double angle = 2 * pi * i / 16, u = 0.5 + 0.5 * std::cos(angle), v = 0.5 + 0.5 * std::sin(angle);
      const Vec3 d = map.direction(cap, u, v);  // on the rim: 45 degrees from the pole
      EXPECT_NEAR(face.ma.of(d), half_root, tight) << map.name();
      EXPECT_NEAR(face.sc.of(d), half_root * std::cos(angle), tight) << map.name();
      EXPECT_NEAR(face.tc.of(d), half_root * std::sin(angle), tight) << map.name();
    }
  }
  expect_direction(map, 1, 0.5, 0, {0, 1, -1});
  expect_direction(map, 2, 0.5, 0, {0, -1, 1});
}
TEST(PolarCapped, CapsLieAsCubeFaces) {
  expect_caps_lie_as_cube_faces(layout("polar-capped"));
  expect_caps_lie_as_cube_faces(layout("polar-capped-conformal"));
}

// Mercator 1569: height ln tan(45 degrees + latitude/2); stereographic: radius tan(half the angle).
TEST(PolarCappedConformal, MercatorAndStereographic) {
  const Layout& map = layout("polar-capped-conformal");
  const double whole = std::log(std::tan(3 * pi / 8));  // at 45 degrees
  EXPECT_NEAR(map.info().faces[0].aspect, pi / whole, tight);
  for (int degrees = -44; degrees <= 44; degrees += 4) {
    const double latitude = degrees * pi / 180;
    const double height = std::log(std::tan(pi / 4 + latitude / 2));
    expect_at(map, {std::cos(latitude), std::sin(latitude), 0}, 0, 0.75, 0.5 - height / whole / 2);
  }
  for (int degrees = 1; degrees < 45; degrees += 4) {
    const double angle = degrees * pi / 180, r = std::tan(angle / 2) / std::tan(pi / 8);
    expect_at(map, {std::sin(angle), std::cos(angle), 0}, 1, 0.5 + r / 2, 0.5);
    expect_at(map, {0, -std::cos(angle), std::sin(angle)}, 2, 0.5, 0.5 - r / 2);
  }
  // Free of anisotropy in the metric of each face.
  for (int face = 0; face < 3; ++face)
    for (const auto& [u, v] : random_points(300)) {
      const DirectionJet jet = map.direction_jet(face, u, v);
      EXPECT_NEAR(length(jet.du), map.info().faces[face].aspect * length(jet.dv), tight);
      EXPECT_NEAR(dot(jet.du, jet.dv), 0, tight);
    }
  // Texels agree at the centres when a cap's height is this part of the band's.
  const double cap = 4 * std::tan(pi / 8), band = 2 * whole;  // |dd/dv| of either projection at its centre
  EXPECT_NEAR(map.info().faces[1].scale, cap / band, tight);
  EXPECT_NEAR(map.info().faces[2].scale, cap / band, tight);
}

}  // namespace
}  // namespace envconv
