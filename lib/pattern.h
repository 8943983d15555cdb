// SPDX-License-Identifier: Apache-2.0
// Test cards: environments given by a formula, integrated over every texel.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

#include "geometry.h"
#include "image.h"
#include "layout.h"
#include "result.h"

namespace envconv {

enum class PatternKind { directions, labels, grid, zoneplate, noise, constant, sun };

/// A pattern's name and what it shows.
struct PatternInfo {
  std::string_view name;  ///< as on the command line
  PatternKind kind;
  std::string_view note;  ///< one line for listings
};
/// All patterns, in the order of PatternKind.
std::span<const PatternInfo> all_patterns();
const PatternInfo* find_pattern(std::string_view name);

/// What to draw, and onto what.
struct PatternOptions {
  PatternKind kind = PatternKind::labels;
  const Layout* layout = nullptr;
  int height = 0;  ///< of face 0, in texels, >= 1
  Placement placement = Placement::centre;
  /// The axes that `directions`, the names in `labels` and the direction of the sun are in.
  Mat3 consumer_from_world;
  Rotation rotation;                           ///< turns the whole pattern, as resample() turns an environment
  std::array<double, 3> value{0.5, 0.5, 0.5};  ///< of `constant`; the sun's radiance
  std::uint64_t seed = 1;                      ///< of `noise`
  int degree = 32;                             ///< of `noise`: the highest spherical harmonic in it, >= 1
  Vec3 direction{0, 1, 0};                     ///< of the sun's centre, any length > 0
  double diameter = 0.53;                      ///< of the sun, in degrees, in (0, 360]
};

/// The pattern as an environment of three channels.  Each texel holds the mean radiance over its footprint, weighted by
/// solid angle: smooth patterns (directions, zoneplate, noise) to 1e-5 of their range, and 1e-3 where a crease of the
/// layout crosses the texel; those with edges (labels, grid) to about 1/100 of an edge's contrast.  The sun's energy,
/// radiance times solid angle, is exact to 1e-6, at seams and poles and for suns smaller than a texel too: texels that
/// the layout owns in part hold the mean over that part.  Independent of the thread count.
/// Errors: usage (a value out of its range), limit (memory).
Result<EnvImage> make_pattern(const PatternOptions& options);

}  // namespace envconv
