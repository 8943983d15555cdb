// SPDX-License-Identifier: Apache-2.0
// Directions on which the layouts' laws are tried: random ones, and those where formulas break.
#pragma once

#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "layout.h"

namespace envconv::test {

/// gtest's names allow letters, digits and underscores only.
inline std::string test_name(const Layout& layout) {
  std::string name(layout.name());
  for (char& c : name)
    if (c == '-') c = '_';
  return name;
}

/// What a source is converted to in laws of all pairs: every layout.  With a sanitizer, which makes ten seconds of one
/// and looks for faults of layouts and kernels rather than of pairs, every fifth, such that each is as often a target.
inline std::vector<std::reference_wrapper<const Layout>> targets_of(const Layout& source) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  constexpr std::ptrdiff_t step = 5;
#else
  constexpr std::ptrdiff_t step = 1;
#endif
  const std::span<const Layout> all = all_layouts();
  std::vector<std::reference_wrapper<const Layout>> targets;
  for (const Layout& target : all)
    if (((&target - all.data()) + (&source - all.data())) % step == 0) targets.emplace_back(target);
  return targets;
}

/// Uniform on the sphere.  Seeds are fixed: a test that fails, fails again.
class RandomDirections {
 public:
  explicit RandomDirections(unsigned seed) : engine_(seed) {}
  Vec3 operator()() {
    const double y = 2 * uniform() - 1, longitude = 2 * pi * uniform(), r = std::sqrt(1 - y * y);
    return {r * std::sin(longitude), y, r * std::cos(longitude)};
  }
  /// In [0, 1).
  double uniform() { return std::generate_canonical<double, 53>(engine_); }

 private:
  static constexpr double pi = 3.14159265358979323846;
  std::mt19937_64 engine_;
};

/// Axes, edges and corners of cubes and octahedra, heights where polar caps begin, icosahedra, all with both signs of
/// zero, with their neighbours in the representation T, and in lengths from 1e-6 to 1e6.
template <class T>
std::vector<Vec3> adversarial_directions() {
  std::vector<Vec3> base;
  // Components that meet in ties and on thresholds: 1/2 and golden ratios (icosahedra), 2/3 (isocube, HEALPix: heights
  // with their exact complement sqrt(5)/3), 1/sqrt 3, 1/sqrt 5.
  const double golden = (1 + std::sqrt(5.0)) / 2;
  const double values[] = {0.0, -0.0, 1.0, -1.0, 0.5, -0.5, golden, -golden};
  for (const double x : values)
    for (const double y : values)
      for (const double z : values)
        if (x != 0 || y != 0 || z != 0) base.push_back({x, y, z});
  for (const double height : {2.0 / 3, 1 / std::sqrt(2.0), 1 / std::sqrt(3.0), 1 / std::sqrt(5.0), 0.9999999, 1e-9})
    for (int k = 0; k < 40; ++k)  // every 9 degrees: the vertices of all sets of diamonds, quadrants, octants
      for (const double sign : {1.0, -1.0}) {
        const double r = std::sqrt(1 - height * height), a = k * 9 * std::acos(-1.0) / 180;
        base.push_back({r * std::sin(a), sign * height, r * std::cos(a)});
        base.push_back({sign * height, r * std::sin(a), r * std::cos(a)});
        base.push_back({r * std::sin(a), r * std::cos(a), sign * height});
      }
  // Nearly on an axis: the smaller components vanish against the larger when squared.
  for (const double tiny : {1e-20, 1e-12, 1e-7, 1e-4})
    for (const double sign : {1.0, -1.0}) {
      base.push_back({tiny, sign, 0});
      base.push_back({-tiny, sign, tiny});
      base.push_back({sign, tiny, -tiny});
      base.push_back({tiny, -tiny, sign});
      base.push_back({-tiny, 0, sign});
    }
  std::vector<Vec3> all;
  const T far = std::numeric_limits<T>::max();
  for (const Vec3& d : base) {
    const T x = static_cast<T>(d.x), y = static_cast<T>(d.y), z = static_cast<T>(d.z);
    for (const double scale : {1.0, 1e-6, 1e6}) {
      const T s = static_cast<T>(scale);
      all.push_back({s * x, s * y, s * z});
    }
    all.push_back({std::nextafter(x, far), y, z});
    all.push_back({std::nextafter(x, -far), y, z});
    all.push_back({x, std::nextafter(y, far), z});
    all.push_back({x, std::nextafter(y, -far), z});
    all.push_back({x, y, std::nextafter(z, far)});
    all.push_back({x, y, std::nextafter(z, -far)});
  }
  return all;
}

/// Singular values of a map's derivative, larger first; du and dv are per unit of the same measure.
struct Stretch {
  double largest, smallest;
};
inline Stretch stretch(Vec3 du, Vec3 dv) {
  const double E = dot(du, du), F = dot(du, dv), G = dot(dv, dv);
  const double largest = std::sqrt(0.5 * (E + G) + std::sqrt(0.25 * (E - G) * (E - G) + F * F));
  // Product of both is the area; a difference would cancel.
  return {largest, largest > 0 ? length(cross(du, dv)) / largest : 0};
}

/// Side of a mean texel, in radians, when face 0 is `width` texels wide.
inline double mean_texel(const Layout& layout, double width) {
  double texels = 0;
  const double height = width / layout.info().faces[0].aspect;
  for (const Face& face : layout.info().faces) texels += face.aspect * face.scale * height * face.scale * height;
  return std::sqrt(4 * std::acos(-1.0) / texels);
}

}  // namespace envconv::test
