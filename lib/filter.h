// SPDX-License-Identifier: Apache-2.0
// Reconstruction filters: the kernels' formulas, how many taps they read, and how an output texel is sampled with them.
#pragma once

#include <span>
#include <string_view>

namespace envconv {

/// The continuous function that is laid through the source's texels.
enum class Kernel {
  nearest,      ///< 1 tap
  bilinear,     ///< 2 taps
  catmull_rom,  ///< 4 taps, interpolating cubic (Catmull & Rom 1974)
  omoms,     ///< 4 taps on prefiltered texels: cubic of minimal support and maximal order (Blu, Thevenaz & Unser 2001)
  lanczos3,  ///< 6 taps, normalised
};

/// Texels read along one axis.
constexpr int taps(Kernel kernel) {
  switch (kernel) {
    case Kernel::nearest: return 1;
    case Kernel::bilinear: return 2;
    case Kernel::catmull_rom:
    case Kernel::omoms: return 4;
    case Kernel::lanczos3: return 6;
  }
  return 0;
}

/// The pole of the recursive prefilter that makes the OMOMS cubic interpolate: (sqrt(105) - 13) / 8.
inline constexpr double omoms_pole = -0.34413115425505114;

/// A registered filter.
struct Filter {
  std::string_view name;  ///< as on the command line
  std::string_view note;  ///< one line for listings
  Kernel kernel = Kernel::bilinear;
  double spacing = 1.3;   ///< largest distance between sub-samples, in source texels
  int least_samples = 1;  ///< sub-samples a side at least
  double window = 1.0;    ///< side of the window over the output, in its texels; 1: the texel's own footprint
  bool gaussian = false;  ///< the window is a Gaussian of sigma 1/2 texel instead of a box
  bool limited = false;   ///< highlights are reconstructed apart, without negative lobes, and conserve energy
};

/// "auto" first.
std::span<const Filter> all_filters();
/// The filter of that name, or nullptr.
const Filter* find_filter(std::string_view name);

}  // namespace envconv
