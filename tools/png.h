// SPDX-License-Identifier: Apache-2.0
// Pictures in memory, to be embedded in a page.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "image.h"

namespace envconv::tool {

/// A PNG file (8-bit RGB) of a picture of three channels in linear sRGB; values beyond [0,1] are clamped, NaN is black.
std::vector<std::uint8_t> png_of(const Image& image);

/// RFC 4648, with padding.
std::string base64(std::span<const std::uint8_t> bytes);

/// A file that takes its name when it is whole.  Errors: output.
Result<Ok> write_text_file(const std::string& path, std::string_view text);

}  // namespace envconv::tool
