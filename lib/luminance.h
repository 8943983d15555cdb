// SPDX-License-Identifier: Apache-2.0
// How bright an environment is, and where.
#pragma once

#include <array>

#include "color_encoding.h"
#include "image.h"
#include "result.h"

namespace envconv {

/// Shares of the sphere, in percent, whose luminances are told.
inline constexpr std::array<double, 8> luminance_shares{1, 5, 25, 50, 75, 95, 99, 99.9};

/// The texel of the largest luminance.
struct Brightest {
  Vec3 direction{};            ///< of the texel's centre, a unit vector in the world frame
  int face = 0, x = 0, y = 0;  ///< where it is: a face of the layout, and a column and a row of it
};

/// Luminances of the texels that the layout owns; those of NaN or infinity are left out.  In the pixels' unit.
struct LuminanceStatistics {
  bool any = false;  ///< false: no texel was finite, and nothing below means anything
  double min = 0, max = 0;
  double smallest_positive = 0;  ///< 0 when none is
  double mean = 0;               ///< weighted by solid angle
  /// For each of luminance_shares: the luminance that so much of the sphere, by solid angle, does not exceed.  Of a
  /// texel that is there, or less than 0.05 % above it.
  std::array<double, luminance_shares.size()> percentiles{};
  Brightest brightest;

  /// Powers of two between the largest and the smallest positive luminance; 0 when no two are positive.
  double stops() const;
  /// The same between the brightest and the darkest of the middle 98 % of the sphere; 0 where that reaches black.
  double usual_stops() const;
};

/// Luminance is Y of RGB with these primaries, or the channel Y itself.  The same from any number of threads.  Error:
/// unsupported, where there is no colour.
Result<LuminanceStatistics> luminance_statistics(const EnvImage& image, const Chromaticities& primaries);

}  // namespace envconv
