// SPDX-License-Identifier: Apache-2.0
#include "geometry.h"

#include <numbers>

namespace envconv {

Mat3 operator*(const Mat3& a, const Mat3& b) {
  Mat3 c;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      c.m[3 * i + j] = a.m[3 * i] * b.m[j] + a.m[3 * i + 1] * b.m[3 + j] + a.m[3 * i + 2] * b.m[6 + j];
  return c;
}

Mat3 transpose(const Mat3& a) { return {{a.m[0], a.m[3], a.m[6], a.m[1], a.m[4], a.m[7], a.m[2], a.m[5], a.m[8]}}; }

namespace {
// Rows: the consumer's x, y, z in terms of the panorama's right, up, forward.
constexpr Frame frames[] = {
    {"world", {{1, 0, 0, 0, 1, 0, 0, 0, 1}}, "left-handed, y up, centre +Z: cube-map tables, KTX2, ffmpeg v360"},
    {"opengl", {{1, 0, 0, 0, 1, 0, 0, 0, -1}}, "right-handed, y up, centre -Z: OpenGL eye space, Debevec, HDRShop"},
    {"openexr", {{-1, 0, 0, 0, 1, 0, 0, 0, 1}}, "right-handed, y up, centre +Z: ImfEnvmap.h, USD dome light, Godot"},
    {"three", {{0, 0, 1, 0, 1, 0, 1, 0, 0}}, "right-handed, y up, centre +X: three.js, glTF viewers"},
    {"blender", {{0, 0, 1, -1, 0, 0, 0, 1, 0}}, "right-handed, z up, centre +X: Cycles, EEVEE"},
    {"unity", {{0, 0, 1, 0, 1, 0, -1, 0, 0}}, "left-handed, y up, centre +X: Skybox/Panoramic"},
    {"unreal", {{1, 0, 0, 0, 0, -1, 0, 1, 0}}, "left-handed, z up, centre -Y: LongLat to TextureCube"},
    {"renderman", {{0, 0, 1, 1, 0, 0, 0, 1, 0}}, "left-handed, z up, centre +X: RenderMan, OpenImageIO's default"},
};

// Cosine and sine of an angle in degrees, exact at multiples of 90.
void cos_sin_degrees(double degrees, double& c, double& s) {
  const double quarter = std::round(degrees / 90.0);
  const double rest = (degrees - 90.0 * quarter) * std::numbers::pi / 180.0;
  const double c0 = std::cos(rest), s0 = std::sin(rest);
  switch (static_cast<int>(std::fmod(std::fmod(quarter, 4.0) + 4.0, 4.0))) {
    case 0: c = c0, s = s0; break;
    case 1: c = -s0, s = c0; break;
    case 2: c = -c0, s = -s0; break;
    default: c = s0, s = -c0; break;
  }
}
}  // namespace

std::span<const Frame> all_frames() { return frames; }

const Frame* find_frame(std::string_view name) {
  for (const Frame& f : frames)
    if (f.name == name) return &f;
  return nullptr;
}

Mat3 rotation_matrix(const Rotation& r) {
  double c, s;
  cos_sin_degrees(r.yaw, c, s);
  const Mat3 yaw{{c, 0, s, 0, 1, 0, -s, 0, c}};  // about up: forward goes to the right
  cos_sin_degrees(r.pitch, c, s);
  const Mat3 pitch{{1, 0, 0, 0, c, -s, 0, s, c}};  // about right: up goes forward
  cos_sin_degrees(r.roll, c, s);
  const Mat3 roll{{c, -s, 0, s, c, 0, 0, 0, 1}};  // about forward: right goes up
  return yaw * (pitch * roll);
}

}  // namespace envconv
