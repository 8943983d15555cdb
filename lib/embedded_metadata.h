// SPDX-License-Identifier: Apache-2.0
// Metadata that several formats embed, as far as they say how pixels are to be taken.  Internal: not installed.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "decoder.h"

namespace envconv {

/// Gives a file the colours of its ICC profile.  False where the profile is none that can be applied.
bool take_icc_profile(std::span<const std::uint8_t> profile, PixelType stored, FileSpec& spec);

/// Whether a packet of XMP says nothing that matters here: no orientation, no colour space and nothing of ours.
bool is_idle_xmp(std::string_view packet);

/// A description as it is handed on: what is ours, at most 4095 bytes up to the first zero, or "".
std::string own_description(std::string_view text);

}  // namespace envconv
