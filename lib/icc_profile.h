// SPDX-License-Identifier: Apache-2.0
// ICC profiles that are three primaries and a curve (ICC.1:2022).  Internal: not installed.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "color_encoding.h"

namespace envconv {

/// What a profile says of RGB values.
struct IccColor {
  Transfer transfer = Transfer::unknown;  ///< linear, srgb or gamma
  double gamma = 1;                       ///< of Transfer::gamma
  Chromaticities primaries;
};

/// The profile's colours, or nothing where it is not a three-component matrix profile (section 8.3.3) whose one curve
/// is linear, sRGB's or a power, to 1/500 of the range: such as have tables (A2B0), other curves for each channel, or
/// are damaged.  Colorants are relative to D50 (section 6.3.1), and so are the primaries, unless they have a name.
std::optional<IccColor> read_icc_profile(std::span<const std::uint8_t> profile);

}  // namespace envconv
