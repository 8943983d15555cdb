// SPDX-License-Identifier: Apache-2.0
// What stored values mean: primaries, a curve, and the words and codes that file formats have for them.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "geometry.h"

namespace envconv {

/// CIE 1931 chromaticities (x, y) of primaries and of the white point.
struct Chromaticities {
  double red_x = 0, red_y = 0, green_x = 0, green_y = 0, blue_x = 0, blue_y = 0, white_x = 0, white_y = 0;
  friend bool operator==(const Chromaticities&, const Chromaticities&) = default;
};

/// In the order of the fields.
std::array<double, 8> chromaticity_values(const Chromaticities& xy);
/// The same back; nothing when they span no colours, as in files that hold zeros.  Named primaries are given as they
/// are defined, not as a file rounds them or has them adapted to another white (ICC's D50, in what Photoshop writes).
std::optional<Chromaticities> usable_primaries(const std::array<double, 8>& values);

/// Primaries that have a name.
struct Primaries {
  std::string_view name;   ///< "rec709", "rec2020", "p3-d65", "aces-ap0", "aces-ap1"
  std::string_view space;  ///< the linear colour space of the embedded configuration: "ACEScg"
  Chromaticities xy;
  int cicp;     ///< ITU-T H.273, ColourPrimaries (PNG's cICP); 0 when it has no code
  int khronos;  ///< Khronos Data Format Specification, KHR_DF_PRIMARIES_* (KTX2); 0 when it has no code
};
/// Rec.709 first: what is assumed when nothing is said.
std::span<const Primaries> all_primaries();
/// The named ones nearest to `xy`, when no coordinate differs by more than `tolerance`; or nullptr.
const Primaries* find_primaries(const Chromaticities& xy, double tolerance = 5e-4);
/// The ones of that name, which must be one of all_primaries()'s.
const Primaries& find_named_primaries(std::string_view name);
/// Rec. ITU-R BT.709-6, which sRGB shares.
const Chromaticities& rec709();

/// Linear RGB to CIE XYZ, white at Y = 1 (SMPTE RP 177-1993).  Nothing where the chromaticities span no colours: three
/// on a line, a white without luminance, coordinates that are not finite.
std::optional<Mat3> xyz_from_rgb(const Chromaticities& xy);
/// Linear RGB to linear RGB of other primaries.  Whites go to white: they are adapted with Bradford's cone responses
/// (Lindbloom; ICC.1:2022, annex E).  Nothing where one of the two has no matrix.
std::optional<Mat3> rgb_from_rgb(const Chromaticities& to, const Chromaticities& from);
/// Weights of red, green and blue in luminance: the middle row of xyz_from_rgb(), or Rec. 709's where there is none.
Vec3 luminance_weights(const Chromaticities& xy);

/// The curve between stored values and light.
enum class Transfer {
  linear,
  srgb,    ///< IEC 61966-2-1
  gamma,   ///< light = value ^ gamma
  unknown  ///< another, or none that is known
};

/// What the values of a file mean.
struct ColorEncoding {
  std::string space;  ///< the colour space's name in the configuration that was in use, or ""
  Transfer transfer = Transfer::unknown;
  double gamma = 1;  ///< of Transfer::gamma
  std::optional<Chromaticities> primaries;
};
/// "linear", "sRGB", "gamma 2.2", "unknown curve".
std::string transfer_text(Transfer transfer, double gamma);
/// The name of the embedded configuration's space with this curve and these primaries, or "": "sRGB - Texture".
std::string_view space_of(const ColorEncoding& encoding);

/// Spaces of the embedded configuration that file rules name.
inline constexpr std::string_view kSrgbSpace = "sRGB - Texture", kLinearSpace = "Linear Rec.709 (sRGB)";

}  // namespace envconv
