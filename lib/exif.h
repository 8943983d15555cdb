// SPDX-License-Identifier: Apache-2.0
// What Exif metadata (CIPA DC-008, Exif 2.32) say of the pixels beside them.  Internal: not installed.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace envconv {

/// The fields that matter here.
struct ExifFields {
  std::optional<int> orientation;    ///< as stored: 1 upright ... 8, if it is right
  bool color_space = false;          ///< whether ColorSpace is there, which says sRGB or nothing
  std::optional<std::string> title;  ///< ImageDescription
};

/// Reads a TIFF file of the kind that an APP1 marker holds, behind "Exif\0\0".  Nothing where one of these fields, or
/// the way to it, is not as the standard has it, or where it says more than is understood here: believes no count and
/// no offset.
std::optional<ExifFields> read_exif(std::span<const std::uint8_t> bytes);

}  // namespace envconv
