// SPDX-License-Identifier: Apache-2.0
// Coordinate systems.  Each is named once here; every name in the tree means one of these.
//
//   d = (x, y, z)   direction, unit length unless said otherwise.  The world frame is left-handed:
//                   +X right, +Y up, +Z forward (the frame of the cube-map tables of OpenGL, Direct3D
//                   and Vulkan).
//   (f, u, v)       face point: face f, u left to right and v top to bottom, both in [0,1] on the face.
//                   A layout's formula goes on smoothly beyond [0,1]: see Layout::direction.
//   (a, b)          centred face point: a = 2u-1 to the right, b = 1-2v upwards.
//   (f, i, j)       texel: column i, row j, counted from the top left corner of face f.
//   (X, Y)          pixel of an image into which faces are packed.
//   turns           angles inside formulas, 1 turn = 2 pi radians; degrees appear on the command line only.
//
//                 +Y up
//                  |   +Z forward          Seen from the centre, right is right on every face of every
//                  |  /                    layout: det(dd/du, dd/dv, d) < 0 everywhere.
//                  | /
//                  o------ +X right
#pragma once

#include <array>
#include <cmath>
#include <span>
#include <string_view>

namespace envconv {

/// Three components; F is double in the interface, SIMD lanes or dual numbers inside kernels.
template <class F>
struct Vec {
  F x, y, z;
};
using Vec3 = Vec<double>;

inline Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator*(double s, Vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3 cross(Vec3 a, Vec3 b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
inline double length(Vec3 a) { return std::sqrt(dot(a, a)); }
/// Unit vector along a; a must not be zero.
inline Vec3 normalize(Vec3 a) { return (1.0 / length(a)) * a; }
/// Angle between two directions of any length, in radians, accurate for small angles too.
inline double angle_between(Vec3 a, Vec3 b) { return std::atan2(length(cross(a, b)), dot(a, b)); }

/// Row-major 3x3 matrix acting on column vectors.
struct Mat3 {
  std::array<double, 9> m{1, 0, 0, 0, 1, 0, 0, 0, 1};
  friend bool operator==(const Mat3&, const Mat3&) = default;
};
inline Vec3 operator*(const Mat3& a, Vec3 d) {
  return {a.m[0] * d.x + a.m[1] * d.y + a.m[2] * d.z, a.m[3] * d.x + a.m[4] * d.y + a.m[5] * d.z,
          a.m[6] * d.x + a.m[7] * d.y + a.m[8] * d.z};
}
Mat3 operator*(const Mat3& a, const Mat3& b);
Mat3 transpose(const Mat3& a);

/// The axes of a consumer: d_consumer = consumer_from_world * d_world, a signed permutation.
/// A lookup with a layout's own formula on a direction in the consumer's axes finds the radiance from that direction.
struct Frame {
  std::string_view name;     ///< as on the command line: "world", "opengl" ...
  Mat3 consumer_from_world;  ///< rows: the consumer's x, y, z in terms of right, up, forward
  std::string_view note;     ///< one line: handedness, and whose convention it is
};

/// All presets, "world" first.
std::span<const Frame> all_frames();
/// The preset of that name, or nullptr.
const Frame* find_frame(std::string_view name);

/// A turn of the environment, in degrees, by the axes' own (left-handed) sense: a positive yaw takes what is forward to
/// the right, a positive pitch takes what is up to the front, a positive roll takes what is right to the top.
/// Roll is applied first, yaw last.
struct Rotation {
  double yaw = 0, pitch = 0, roll = 0;
  friend bool operator==(const Rotation&, const Rotation&) = default;
};
/// d_turned = matrix * d.  Multiples of 90 degrees give exact entries.
Mat3 rotation_matrix(const Rotation& r);

/// Where texel centres lie along one axis of n texels.
enum class Placement {
  centre,     ///< u = (i + 1/2) / n: inside the face
  inclusive,  ///< u = i / (n - 1): the first and last on the face's edges (OpenEXR's environment maps)
};
/// u of texel coordinate i (texel centres at integers) of n.  With one texel, inclusive placement puts it in the
/// middle.
inline double u_from_texel(double i, int n, Placement p) {
  if (p == Placement::centre) return (i + 0.5) / n;
  return n > 1 ? i / (n - 1) : 0.5 + i;
}
/// Inverse of u_from_texel.
inline double texel_from_u(double u, int n, Placement p) {
  if (p == Placement::centre) return u * n - 0.5;
  return n > 1 ? u * (n - 1) : u - 0.5;
}
/// Extent of one texel in u.
inline double texel_extent(int n, Placement p) {
  return p == Placement::centre ? 1.0 / n : n > 1 ? 1.0 / (n - 1) : 1.0;
}

}  // namespace envconv
