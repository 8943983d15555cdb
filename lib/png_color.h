// SPDX-License-Identifier: Apache-2.0
// The chunks of PNG that tell what its values mean: cICP, sRGB, gAMA and cHRM (PNG, third edition, section 11.3.2),
// which the image library reads in part.  Internal: not installed.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "color_encoding.h"

namespace envconv {

/// What an open PNG file says, by the strongest of its chunks.
struct PngColor {
  Transfer transfer = Transfer::unknown;  ///< unknown: along a curve that `note` names
  double gamma = 1;
  std::optional<Chromaticities> primaries;
  std::string how;   ///< "cICP", "sRGB", "gAMA"
  std::string note;  ///< what was found and is not supported: "the PQ curve"; or ""
};
/// Nothing where no chunk tells.  Reads at most the chunks before the pixels, and believes none of their lengths.
std::optional<PngColor> read_png_color(int fd);

/// The chunks for an encoding, to stand right after IHDR; "" when there are none for it.
std::string png_color_chunks(const ColorEncoding& encoding);

/// A chunk with its length and checksum; the type has four letters.
std::string png_chunk(std::string_view type, std::string_view data);
/// Four bytes.
std::string big_endian(std::uint32_t value);

}  // namespace envconv
